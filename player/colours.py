"""Colours that show the hierarchy: which triangles are one object, and which level of the tree is drawn.

Pure array functions from a store's tables to a tint for each drawable; the renderer shades tints as it shades the
model's own colours.

Based on: W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, figure 4 (clusters in different colours).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from storage.model.tree import heights, leaves

Colours = Literal["model", "objects", "levels"]

COLOURS: tuple[Colours, ...] = ("model", "objects", "levels")

#: What they show.
COLOURS_SHOW: dict[Colours, str] = {
    "model": "the model's own",
    "objects": "each object and each node above them in another one",
    "levels": "leaves from dark green (finest) to yellow, nodes above them from orange to blue (the root)",
}

_GOLDEN = 0.6180339887498949

#: Leaves' levels, from the finest on: dark green to yellow over so many of them.
_LEAF_STOPS = np.array([(20, 105, 110), (60, 175, 70), (185, 215, 60), (250, 236, 110)], np.float64)
_LEAF_STEPS = 8
#: Inner nodes, from the lowest to the root: orange, red, violet, blue.
_INNER_STOPS = np.array([(244, 150, 50), (214, 48, 58), (140, 60, 170), (50, 80, 200)], np.float64)


def tints(colours: Colours, nodes: np.ndarray, drawables: np.ndarray) -> NDArray[np.uint8]:
    """Red, green, blue (sRGB) and alpha of each drawable: (drawables, 4) uint8; alpha is 255, or 0: its own colours.

    nodes, drawables: a store's NODE and DRAWABLE arrays.
    """
    found = np.zeros((len(drawables), 4), np.uint8)
    if colours != "model":
        found[:, :3] = _by_object(drawables["node"]) if colours == "objects" else _by_level(nodes, drawables)
        found[:, 3] = 255
    return found


def _by_object(node: np.ndarray) -> NDArray[np.uint8]:
    """A colour (n, 3) for each of nodes (n,): hues of consecutive ones lie far apart, and so do their shades."""
    number = node.astype(np.float64) + 1
    hue = number * _GOLDEN % 1
    saturation = 0.45 + 0.45 * (number * np.sqrt(2) % 1)
    value = 0.62 + 0.36 * (number * np.sqrt(3) % 1)
    wheel = np.clip(np.abs((hue[:, None] * 6 + (0, 4, 2)) % 6 - 3) - 1, 0, 1)
    rgb = value[:, None] * (1 - saturation[:, None] * (1 - wheel))
    return np.rint(255 * rgb).astype(np.uint8)


def _by_level(nodes: np.ndarray, drawables: np.ndarray) -> NDArray[np.uint8]:
    """A colour (n, 3) for each drawable."""
    node = drawables["node"]
    height = heights(nodes)
    leaf = _between(_LEAF_STOPS, drawables["level"] / (_LEAF_STEPS - 1))
    inner = _between(_INNER_STOPS, (height[node] - 1) / max(int(height.max(initial=0)) - 1, 1))
    return np.where(leaves(nodes)[node][:, None], leaf, inner)


def _between(stops: NDArray[np.float64], where: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours (n, 3) at places (n,) from 0 to 1 between evenly spaced stops (k, 3)."""
    at = np.linspace(0, 1, len(stops))
    return np.stack([np.rint(np.interp(where, at, stops[:, c])) for c in range(3)], axis=1).astype(np.uint8)
