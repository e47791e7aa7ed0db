"""Planes of triangles, and on which side of them things lie.

Corners are integers of at most 24 bits, so that differences of corners and the normals made of them are exact in
float64.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import kernel


@kernel(inline="always")
def plane_of(vertices: np.ndarray, triangles: np.ndarray, t: int) -> tuple[float, float, float, float, float, float]:
    """The first corner of triangle t and its normal, twice the area long, exact: (x, y, z, nx, ny, nz).

    vertices: (n, 3) int32 grid units; triangles: (m, 3) int32.
    """
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    x, y, z = float(vertices[a, 0]), float(vertices[a, 1]), float(vertices[a, 2])
    ux, uy, uz = vertices[b, 0] - x, vertices[b, 1] - y, vertices[b, 2] - z
    wx, wy, wz = vertices[c, 0] - x, vertices[c, 1] - y, vertices[c, 2] - z
    return x, y, z, uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx


@kernel()
def side_of(vertices: np.ndarray, triangles: np.ndarray, t: int, centre: np.ndarray, half: np.ndarray) -> int:
    """On which side of triangle t's plane a whole box lies: 1 before it, -1 behind it, 0 where it may meet the plane.

    centre, half: (3,) float64 the box in grid units.
    """
    x, y, z, nx, ny, nz = plane_of(vertices, triangles, t)
    dx, dy, dz = centre[0] - x, centre[1] - y, centre[2] - z
    o = nx * dx + ny * dy + nz * dz
    reach = abs(nx) * half[0] + abs(ny) * half[1] + abs(nz) * half[2]
    doubt = 1e-14 * (abs(nx * dx) + abs(ny * dy) + abs(nz * dz) + reach)
    if o > reach + doubt:
        return 1
    if -o > reach + doubt:
        return -1
    return 0
