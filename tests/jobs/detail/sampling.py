"""The oracle for certified errors: points sampled on both surfaces, and their exact distances to the other one.

Shares no code with the bound: every triangle is tried (unless a ball around it is too far away), by projecting on its
plane and asking on which side of its edges the foot lies, else by its three edges.
"""

from __future__ import annotations

import numpy as np
from numba import njit


def sample(points: np.ndarray, triangles: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    (
        """About `count` points, (k, 3): half of them spread by area, half evenly over triangles, and corners.

    All corners if they are not more than `count`, else some.
    """
        ""
    )
    p = points[triangles]
    areas = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    each = rng.integers(0, len(triangles), count - count // 2)
    if areas.sum() > 0:
        by_area = rng.choice(len(triangles), count // 2, p=areas / areas.sum())
        chosen = np.concatenate([by_area, each])
    else:
        chosen = each
    u, v = rng.random((2, len(chosen)))
    flip = u + v > 1
    u[flip], v[flip] = 1 - u[flip], 1 - v[flip]
    # every fourth point on an edge, where distances often peak
    v[::4] = 0
    corners = np.unique(triangles)
    if len(corners) > count:
        corners = rng.choice(corners, max(1, count // 8), replace=False)
    t = p[chosen]
    inner = t[:, 0] + u[:, None] * (t[:, 1] - t[:, 0]) + v[:, None] * (t[:, 2] - t[:, 0])
    return np.concatenate([inner, points[corners]])


@njit(cache=True, nogil=True)
def _distance_to_edge(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    edge = b - a
    length2 = np.sum(edge * edge)
    s = 0.0
    if length2 > 0:
        s = min(1.0, max(0.0, np.sum((p - a) * edge) / length2))
    gap = p - (a + s * edge)
    return np.sqrt(np.sum(gap * gap))


@njit(cache=True, nogil=True)
def _distances(queries: np.ndarray, corners: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    result = np.empty(len(queries))
    guess = 0
    for i in range(len(queries)):
        p = queries[i]
        best = np.inf
        for step in range(len(corners) + 1):
            t = guess if step == 0 else step - 1
            x, y, z = p[0] - centres[t, 0], p[1] - centres[t, 1], p[2] - centres[t, 2]
            reach = best + radii[t]
            if x * x + y * y + z * z > reach * reach:
                continue
            a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
            d = min(_distance_to_edge(p, a, b), _distance_to_edge(p, b, c), _distance_to_edge(p, c, a))
            normal = np.cross(b - a, c - a)
            length = np.sqrt(np.sum(normal * normal))
            if length > 0:
                inside = (
                    np.sum(np.cross(b - a, p - a) * normal) >= 0
                    and np.sum(np.cross(c - b, p - b) * normal) >= 0
                    and np.sum(np.cross(a - c, p - c) * normal) >= 0
                )
                if inside:
                    d = min(d, abs(np.sum((p - a) * normal)) / length)
            if d < best:
                best = d
                guess = t
        result[i] = best
    return result


def distances(queries: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The distance of each query point (k, 3) to the nearest of the triangles (m, 3) over points (n, 3): (k,)."""
    corners = np.ascontiguousarray(points[triangles], np.float64)
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1) * (1 + 1e-9)
    return _distances(np.ascontiguousarray(queries, np.float64), corners, centres, radii)


def measured(
    a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray], count: int, rng: np.random.Generator
) -> float:
    """The largest distance found from `count` points of each of two meshes (points, triangles) to the other."""
    there = distances(sample(*a, count, rng), *b).max()
    back = distances(sample(*b, count, rng), *a).max()
    return float(max(there, back))
