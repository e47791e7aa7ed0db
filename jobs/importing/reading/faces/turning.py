"""Which polygons a fan from their first corner does not cover rightly.

Based on: Newell's normal, in Sutherland, Sproull, Schumacker: A Characterization of Ten Hidden-Surface Algorithms, ACM
Computing Surveys 6 (1974): it is the sum of the fan's triangles' own.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import kernel

#: A triangle of a fan that turns back by no more than this share of its polygon's area is a seam of collinear corners.
SEAM = 1e-9


#: A fan covers the polygon; a quad is to be split along its other diagonal; the polygon is to be cut by ears.
FAN, DIAGONAL, EARS = 0, 1, 2


@kernel()
def _cross(positions: np.ndarray, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Twice a triangle's area as a vector along its normal."""
    ux, uy, uz = (
        positions[b, 0] - positions[a, 0],
        positions[b, 1] - positions[a, 1],
        positions[b, 2] - positions[a, 2],
    )
    vx, vy, vz = (
        positions[c, 0] - positions[a, 0],
        positions[c, 1] - positions[a, 1],
        positions[c, 2] - positions[a, 2],
    )
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@kernel()
def how_to_cut(
    positions: np.ndarray,
    corners: np.ndarray,
    counts: np.ndarray,
    found: np.ndarray,
    crossing: np.ndarray,
    normals: np.ndarray,
) -> None:
    """Find how polygons become triangles.

    A fan does unless one of its triangles faces away from the polygon's normal, or their areas cancel out. Of quads
    that cannot be split either way it is known already that their outline crosses itself.

    positions (n, 3) float64; corners (c,) any integer, indices of positions, polygon after polygon; counts (f,) int64
    corners of each; found (f,) uint8: the result, FAN where an index is out of range, a position is not finite, or
    there are fewer than four corners; crossing (f,) bool: the result, of quads; normals (k, 3) float64 to write in, as
    many as a polygon has corners, or more.
    """
    first = 0
    for face in range(len(counts)):
        count = counts[face]
        found[face], crossing[face] = FAN, False
        start, first = first, first + count
        if count < 4:
            continue
        sound = True
        for corner in range(start, first):
            if corners[corner] < 0 or corners[corner] >= len(positions):
                sound = False
        if not sound:
            continue
        a = corners[start]
        x, y, z, parts = 0.0, 0.0, 0.0, 0.0
        for k in range(count - 2):
            i, j, w = _cross(positions, a, corners[start + k + 1], corners[start + k + 2])
            normals[k, 0], normals[k, 1], normals[k, 2] = i, j, w
            x, y, z = x + i, y + j, z + w
            parts += i * i + j * j + w * w
        square = x * x + y * y + z * z
        if not np.isfinite(square):
            continue
        least = square
        for k in range(count - 2):
            least = min(least, normals[k, 0] * x + normals[k, 1] * y + normals[k, 2] * z)
        nothing = square < SEAM * SEAM * parts
        if least >= -SEAM * square and not nothing:
            continue
        if count > 4:
            found[face] = EARS
            continue
        b, c, d = corners[start + 1], corners[start + 2], corners[start + 3]
        i, j, w = _cross(positions, b, c, d)
        other = i * x + j * y + w * z
        i, j, w = _cross(positions, b, d, a)
        other = min(other, i * x + j * y + w * z)
        if other > least:
            found[face] = DIAGONAL
        crossing[face] = nothing or max(other, least) < -SEAM * square
