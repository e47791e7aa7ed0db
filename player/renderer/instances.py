"""Placements of meshes on the GPU: one record per instance, kept in a texture that every OpenGL 3.3 can read.

Record 0 is the identity, for meshes that lie in model space already; instance i is record i + 1. A translation is split
into whole grid units and the rest, so that eye and translation subtract without loss however large the coordinates.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

RECORDS_PER_ROW = 1024
TEXELS_PER_RECORD = 4


def records(matrices: NDArray[np.float64], step: float) -> NDArray[np.float32]:
    """Records (n + 1, 4, 4) float32 of placements (n, 3, 4): local grid units to model grid units.

    Rows 0 to 2: the matrix' row, then the whole part of the translation; row 3: the rest of the translation, then 0.
    step: model units per grid unit.
    """
    table = np.zeros((len(matrices) + 1, TEXELS_PER_RECORD, 4), np.float32)
    table[0, :3, :3] = np.eye(3)
    translation = matrices[:, :, 3] / step
    whole = np.rint(translation)
    table[1:, :3, :3] = matrices[:, :, :3]
    table[1:, :3, 3] = whole
    table[1:, 3, :3] = translation - table[1:, :3, 3].astype(np.float64)
    return table


def record_texture(context: moderngl.Context, table: NDArray[np.float32]) -> moderngl.Texture:
    """A float texture of `records`: RECORDS_PER_ROW records a row, four texels a record."""
    rows = -(-len(table) // RECORDS_PER_ROW)
    padded = np.zeros((rows * RECORDS_PER_ROW, TEXELS_PER_RECORD, 4), np.float32)
    padded[: len(table)] = table
    texture = context.texture((RECORDS_PER_ROW * TEXELS_PER_RECORD, rows), 4, padded.tobytes(), dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


def split(position: NDArray[np.float64], step: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A model position (3,) in grid units as the sum of whole numbers and a small rest, both exact in float32."""
    units = position / step
    whole = np.rint(units).astype(np.float32)
    return whole, (units - whole.astype(np.float64)).astype(np.float32)


def mirrored(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which placements (n, 3, 4) turn a mesh inside out: (n,) bool."""
    m = matrices[:, :, :3]
    determinant = (
        m[:, 0, 0] * (m[:, 1, 1] * m[:, 2, 2] - m[:, 1, 2] * m[:, 2, 1])
        - m[:, 0, 1] * (m[:, 1, 0] * m[:, 2, 2] - m[:, 1, 2] * m[:, 2, 0])
        + m[:, 0, 2] * (m[:, 1, 0] * m[:, 2, 1] - m[:, 1, 1] * m[:, 2, 0])
    )
    return determinant < 0
