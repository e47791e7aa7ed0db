"""Colours that show the hierarchy. Pure array functions from a store's tables. Read in this order:

    tints       what a colouring is; the model's own colours
    by_object   which triangles are one object
    by_level    which level is drawn

A new one is a file of its own and one line in COLOURINGS. Importing this package imports none of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from player.offers import Offer

if TYPE_CHECKING:
    from player.colouring.tints import Colouring

#: What the colours can show; the first is what they show unless another is asked for.
COLOURINGS: tuple[Offer[Colouring], ...] = (
    Offer("model", "the model's own", "player.colouring.tints:untinted"),
    Offer("objects", "each object and each node above them in another one", "player.colouring.by_object:by_object"),
    Offer(
        "levels",
        "leaves from dark green (finest) to yellow, nodes above them from orange to blue (the root)",
        "player.colouring.by_level:by_level",
    ),
)
