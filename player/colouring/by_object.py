"""Shows which triangles are one object: each object, and each node above them, in a colour of its own.

Based on: W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, figure 4 (clusters in different colours).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from player.colouring.tints import opaque

#: The golden ratio: multiples of it lie far apart on a wheel.
_GOLDEN = 0.6180339887498949


def by_object(nodes: np.ndarray, drawables: np.ndarray) -> NDArray[np.uint8]:  # noqa: ARG001
    """Tints of each drawable: hues of consecutive nodes lie far apart, and so do their shades."""
    number = drawables["node"].astype(np.float64) + 1
    hue = number * _GOLDEN % 1
    saturation = 0.45 + 0.45 * (number * np.sqrt(2) % 1)
    value = 0.62 + 0.36 * (number * np.sqrt(3) % 1)
    wheel = np.clip(np.abs((hue[:, None] * 6 + (0, 4, 2)) % 6 - 3) - 1, 0, 1)
    rgb = value[:, None] * (1 - saturation[:, None] * (1 - wheel))
    return opaque(np.rint(255 * rgb).astype(np.uint8))
