"""Which polygons a fan from their first corner does not cover rightly.

Based on: Newell's normal, in Sutherland, Sproull, Schumacker: A Characterization of Ten Hidden-Surface Algorithms, ACM
Computing Surveys 6 (1974): it is the sum of the fan's triangles' own.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import kernel

#: A triangle of a fan that turns back by no more than this share of its polygon's area is a seam of collinear corners.
SEAM = 1e-9


@kernel()
def turning_back(
    positions: np.ndarray, corners: np.ndarray, counts: np.ndarray, found: np.ndarray, normals: np.ndarray
) -> None:
    """Mark polygons whose fan has a triangle that faces away from their normal, or triangles whose areas cancel out.

    positions (n, 3) float64; corners (c,) any integer, indices of positions, polygon after polygon; counts (f,) int64
    corners of each; found (f,) bool: the result, False where an index is out of range, a position is not finite, or
    there are fewer than four corners; normals (k, 3) float64 to write in, as many as a polygon has corners, or more.
    """
    first = 0
    for face in range(len(counts)):
        count = counts[face]
        found[face] = False
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
            b, c = corners[start + k + 1], corners[start + k + 2]
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
            i, j, w = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            normals[k, 0], normals[k, 1], normals[k, 2] = i, j, w
            x, y, z = x + i, y + j, z + w
            parts += i * i + j * j + w * w
        square = x * x + y * y + z * z
        if not np.isfinite(square):
            continue
        turned = square < SEAM * SEAM * parts
        for k in range(count - 2):
            along = normals[k, 0] * x + normals[k, 1] * y + normals[k, 2] * z
            turned = turned or along < -SEAM * square
        found[face] = turned
