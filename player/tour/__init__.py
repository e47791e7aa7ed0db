"""Automatic tours: what is seen of a model when nobody steers. Read in this order:

    survey      the model on a grid of voxels, and the height of a walker's eyes
    occupancy   kernels on that grid: distances, free runs, ways
    tour        what a kind of tour is, and which one a model gets
    rooms       a walk through rooms
    orbit       a turn around the model

A new kind is a file of its own and one line in TOURS. Importing this package imports none of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from player.offers import Offer

if TYPE_CHECKING:
    from player.tour.tour import MakeTour

#: The kinds of tour; the first that a model allows is its automatic tour.
TOURS: tuple[Offer[MakeTour], ...] = (
    Offer("rooms", "a walk through the most interesting rooms", "player.tour.rooms:walk_through_rooms"),
    Offer("orbit", "a turn around the model", "player.tour.orbit:turn_around"),
)
