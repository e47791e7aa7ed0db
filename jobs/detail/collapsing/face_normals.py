"""Normals of triangles, and angles between them."""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel
from storage.meshes.normals import area_normal


@allocating_kernel()
def arc_cosine(x: float) -> float:
    """Arc cosine within 7e-5 radians, by arithmetic that gives the same bits on every machine.

    Based on: M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions, 1964, 4.4.45.
    """
    a = min(abs(x), 1.0)
    angle = np.sqrt(1.0 - a) * (1.5707288 + a * (-0.2121144 + a * (0.0742610 - 0.0187293 * a)))
    return angle if x >= 0.0 else np.pi - angle


@allocating_kernel()
def face_normals(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (m, 3) float64 and twice the areas (m,) of triangles (m, 3) over points (n, 3)."""
    normals = np.zeros((len(triangles), 3))
    areas = np.zeros(len(triangles))
    for t in range(len(triangles)):
        x, y, z = area_normal(points, triangles, t)
        length = np.sqrt(x * x + y * y + z * z)
        areas[t] = length
        if length > 0.0:
            normals[t, 0], normals[t, 1], normals[t, 2] = x / length, y / length, z / length
    return normals, areas
