"""A cone that holds the normals of all triangles of a mesh.

Based on: L. A. Shirman, S. S. Abi-Ezzi, The Cone of Normals Technique for Fast Processing of Curved Patches,
Eurographics 1993; used per cell in the vLOD paper (section 5).
"""

from __future__ import annotations

import numpy as np

from storage.kernels import allocating_kernel

#: Cones wider than this (cosine of the half angle) cannot lead to a culled drawable: any view sees some front.
USELESS = 0.02


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
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux = np.float64(points[b, 0]) - points[a, 0]
        uy = np.float64(points[b, 1]) - points[a, 1]
        uz = np.float64(points[b, 2]) - points[a, 2]
        vx = np.float64(points[c, 0]) - points[a, 0]
        vy = np.float64(points[c, 1]) - points[a, 1]
        vz = np.float64(points[c, 2]) - points[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(x * x + y * y + z * z)
        areas[t] = length
        if length > 0.0:
            normals[t, 0], normals[t, 1], normals[t, 2] = x / length, y / length, z / length
    return normals, areas


@allocating_kernel()
def normal_cones(normals: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cones around the unit normals (m, 3) of each group start (groups + 1,).

    Returns axes (groups, 3) float32 and half angles (groups,) float32 in radians, rounded up; pi (and some axis) where
    the normals spread so far that no view sees only backs. The axis is the better one of the normals' mean and the
    middle of their box.
    """
    groups = len(start) - 1
    axes = np.zeros((groups, 3), np.float32)
    angles = np.full(groups, np.float32(np.pi), np.float32)
    for g in range(groups):
        axes[g, 2] = 1.0
        best = USELESS
        for attempt in range(2):
            axis = np.zeros(3)
            for i in range(3):
                low, high, total = 1.0, -1.0, 0.0
                for t in range(start[g], start[g + 1]):
                    low, high = min(low, normals[t, i]), max(high, normals[t, i])
                    total += normals[t, i]
                axis[i] = total if attempt == 0 else low + high
            length = np.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
            if not length > 1e-6:
                continue
            x, y, z = np.float32(axis[0] / length), np.float32(axis[1] / length), np.float32(axis[2] / length)
            smallest = 1.0
            for t in range(start[g], start[g + 1]):
                cosine = normals[t, 0] * x + normals[t, 1] * y + normals[t, 2] * z
                smallest = min(smallest, cosine)
                if smallest <= best:
                    break
            if smallest > best:
                best = smallest
                axes[g, 0], axes[g, 1], axes[g, 2] = x, y, z
                angles[g] = np.float32(arc_cosine(smallest) + 2e-4)
    return axes, angles
