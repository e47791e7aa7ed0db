"""What a colouring is: a tint for each drawable, which the renderer shades as it shades the model's own colours."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Colouring(Protocol):
    """Tints from a store's tables."""

    def __call__(self, nodes: np.ndarray, drawables: np.ndarray) -> NDArray[np.uint8]:
        """Red, green, blue (sRGB) and alpha of each drawable: (drawables, 4) uint8; alpha 0 keeps its own colours.

        What can be seen through stays so, whatever its tint.

        nodes, drawables: a store's NODE and DRAWABLE arrays.
        """
        ...


def opaque(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Tints (n, 4) that hide what colours the drawables have themselves, of colours (n, 3)."""
    return np.concatenate([colours, np.full((len(colours), 1), 255, np.uint8)], axis=1)


def untinted(nodes: np.ndarray, drawables: np.ndarray) -> NDArray[np.uint8]:  # noqa: ARG001
    """The model's own colours: no tints."""
    return np.zeros((len(drawables), 4), np.uint8)
