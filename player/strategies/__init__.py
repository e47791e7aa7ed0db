"""Culling strategies: which drawables for this view? Read in this order:

    strategy   what a strategy is, and what it answers
    none       everything at full detail: what all others are compared with
    frustum    culling at run time
    vlod       the precomputed lists of the cells

A new one is a file of its own and one line in STRATEGIES. Importing this package imports none of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from player.offers import Offer

if TYPE_CHECKING:
    from player.strategies.strategy import MakeStrategy

#: The strategies in the order of their keys, 1 and on; the first is what is drawn unless another is asked for.
STRATEGIES: tuple[Offer[MakeStrategy], ...] = (
    Offer("vlod", "the cells' vLODs", "player.strategies.vlod:Vlod"),
    Offer("frustum", "culling at run time", "player.strategies.frustum:Frustum"),
    Offer("none", "everything at full detail", "player.strategies.none:NoCulling"),
)

#: The one that all others are compared with: it draws the full model.
FULL = "none"
