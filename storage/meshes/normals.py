"""Normals of triangles, unit vectors as two small integers, and what a mesh's shape foretells of its normals.

The sphere is folded onto an octahedron and that into a square of (2 * LIMIT + 1)^2 points. A vertex's normal mostly is
the mean of its triangles' normals, so only the difference from that is stored: zero where it is.

Based on: Meyer, Suessmuth, Sussner, Stamminger, Greiner: On Floating-Point Normal Vectors, EGSR 2010 (octahedral
normals); Cigolle et al., A Survey of Efficient Representations for Independent Unit Vectors, JCGT 3(2), 2014.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel, kernel

#: Octahedral coordinates are integers from -LIMIT to LIMIT.
LIMIT = 511


@kernel(inline="always")
def area_normal(points: NDArray[Any], triangles: NDArray[Any], t: int) -> tuple[float, float, float]:
    """The normal of a triangle, as long as twice its area: the cross product of two of its edges.

    points: (n, 3) of any numbers; triangles: (m, 3), indices below n. In float64 without reordering: the same on every
    machine.
    """
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    ux = np.float64(points[b, 0]) - np.float64(points[a, 0])
    uy = np.float64(points[b, 1]) - np.float64(points[a, 1])
    uz = np.float64(points[b, 2]) - np.float64(points[a, 2])
    vx = np.float64(points[c, 0]) - np.float64(points[a, 0])
    vy = np.float64(points[c, 1]) - np.float64(points[a, 1])
    vz = np.float64(points[c, 2]) - np.float64(points[a, 2])
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@allocating_kernel(inline="always")
def _fold(x: float, y: float, z: float) -> tuple[int, int]:
    """Octahedral coordinates of a vector of any length; of +z where it has none."""
    total = abs(x) + abs(y) + abs(z)
    if not total > 0:
        return 0, 0
    u = x / total
    v = y / total
    if z < 0:
        u, v = (1 - abs(v)) * (1.0 if x >= 0 else -1.0), (1 - abs(u)) * (1.0 if y >= 0 else -1.0)
    return math.floor(u * LIMIT + 0.5), math.floor(v * LIMIT + 0.5)


@allocating_kernel()
def to_octahedral(normals: NDArray[np.float32]) -> NDArray[np.int32]:
    """Octahedral coordinates (n, 2) int32 of vectors (n, 3)."""
    out = np.empty((len(normals), 2), np.int32)
    for i in range(len(normals)):
        out[i, 0], out[i, 1] = _fold(np.float64(normals[i, 0]), np.float64(normals[i, 1]), np.float64(normals[i, 2]))
    return out


@allocating_kernel()
def from_octahedral(folded: NDArray[np.int32]) -> NDArray[np.float32]:
    """Unit vectors (n, 3) float32 of octahedral coordinates (n, 2)."""
    out = np.empty((len(folded), 3), np.float32)
    for i in range(len(folded)):
        x = folded[i, 0] / LIMIT
        y = folded[i, 1] / LIMIT
        z = 1 - abs(x) - abs(y)
        if z < 0:
            x, y = (1 - abs(y)) * (1.0 if x >= 0 else -1.0), (1 - abs(x)) * (1.0 if y >= 0 else -1.0)
        length = math.sqrt((x * x + y * y) + z * z)
        out[i, 0] = x / length
        out[i, 1] = y / length
        out[i, 2] = z / length
    return out


@allocating_kernel()
def foretell_normals(positions: NDArray[np.int32], triangles: NDArray[np.uint32]) -> NDArray[np.int32]:
    """Octahedral coordinates (n, 2) int32 of vertices' normals: the mean of their triangles' weighted by area.

    positions: (n, 3); triangles: (m, 3), indices below n. Plain float64 without reordering: the same on every machine.
    """
    sums = np.zeros((len(positions), 3))
    for t in range(len(triangles)):
        x, y, z = area_normal(positions, triangles, t)
        for k in range(3):
            v = triangles[t, k]
            sums[v, 0] += x
            sums[v, 1] += y
            sums[v, 2] += z
    out = np.empty((len(positions), 2), np.int32)
    for i in range(len(positions)):
        out[i, 0], out[i, 1] = _fold(sums[i, 0], sums[i, 1], sums[i, 2])
    return out
