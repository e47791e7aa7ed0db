"""Shows which level of the hierarchy is drawn: of leaves the level, above them the height in the tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from player.colouring.tints import opaque
from storage.model.tree import heights, leaves

#: Leaves' levels, from the finest on: dark green to yellow over so many of them.
_LEAF_STOPS = np.array([(20, 105, 110), (60, 175, 70), (185, 215, 60), (250, 236, 110)], np.float64)
_LEAF_STEPS = 8
#: Inner nodes, from the lowest to the root: orange, red, violet, blue.
_INNER_STOPS = np.array([(244, 150, 50), (214, 48, 58), (140, 60, 170), (50, 80, 200)], np.float64)


def by_level(nodes: np.ndarray, drawables: np.ndarray) -> NDArray[np.uint8]:
    """Tints of each drawable: of a leaf by its level, of a node above leaves by its height."""
    node = drawables["node"]
    height = heights(nodes)
    leaf = _between(_LEAF_STOPS, drawables["level"] / (_LEAF_STEPS - 1))
    inner = _between(_INNER_STOPS, (height[node] - 1) / max(int(height.max(initial=0)) - 1, 1))
    return opaque(np.where(leaves(nodes)[node][:, None], leaf, inner))


def _between(stops: NDArray[np.float64], where: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours (n, 3) at places (n,) from 0 to 1 between evenly spaced stops (k, 3)."""
    at = np.linspace(0, 1, len(stops))
    return np.stack([np.rint(np.interp(where, at, stops[:, c])) for c in range(3)], axis=1).astype(np.uint8)
