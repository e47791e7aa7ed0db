"""Ways to steer: what held keys and the mouse do to the camera. Read in this order:

    steering   what a way to steer is, and what it may ask its surroundings
    fly        freely, through everything
    walk       over floors, stopped by what is in the way

A new one is a file of its own and one line in STEERINGS. Importing this package imports none of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from player.offers import Offer

if TYPE_CHECKING:
    from player.camera.steering.steering import MakeSteering

#: The ways to steer, in the order in which a key goes through them; the first is the one to begin with.
STEERINGS: tuple[Offer[MakeSteering], ...] = (
    Offer("fly", "flying", "player.camera.steering.fly:Fly"),
    Offer("walk", "walking", "player.camera.steering.walk:Walk"),
)
