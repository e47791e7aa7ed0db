"""Where to look from at a cluster of occluders, so that they need to be shrunk least.

Based on: J. Chhugani et al.: vLOD, IEEE TVCG 11(1), 2005, section 5.2 and figures 4 and 5.

**The rule, and why it is right.** An occluder O is a convex polygon, and the cell V lies strictly before its plane.
Through each side of O goes its *supporting plane*, with V and O in the half-space m x <= d on its inner side. A point x
behind the plane of O and inside all these half-spaces is hidden: so is every p of V inside them, thus the whole segment
from p to x, and it crosses the plane of O at a point inside all of them, which lies in O. Now let v be any point before
the plane of O and inside the half-spaces, in V or not. The *shrunk* frustum m (x - v) <= 0 lies inside the half-spaces
as m v <= d. So what is seen from v through the shrunk frustum, behind the plane of O, is hidden: O may be drawn from v,
shrunk to the part inside the frustum. Any number of occluders may be drawn from one v that lies in all their
half-spaces.

**The best point.** The shrunk frusta of O for all v are one cone, moved; it cuts the plane of O in an area that grows
with the square of the height of v above it, and with it all of the hidden volume. So O alone wants v as high as the
half-spaces allow, at p with the height h(p); and all O_j together want the least sum of <v - p_j, n_j>^2, n_j the
normals of their planes, which is the paper's convex programme: quadratic, with linear constraints, found by Newton's
method on a logarithmic barrier (after S. Boyd, L. Vandenberghe: Convex Optimization, 2004, chapter 11). Whatever point
inside the half-spaces comes out is right; the best only hides most.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel, kernel

#: Cells are grown by a part of 10^-9 before they come here; half of it is left for rounding.
_GROWN = 1.0 - 5e-10
#: Steps of Newton's method for each weight of the barrier, and how often the barrier becomes weaker, and by how much.
_STEPS, _WEIGHTS, _WEAKER = 8, 6, 20.0


@kernel()
def supporting_plane(
    a: tuple[float, float, float], b: tuple[float, float, float], inner: tuple[float, float, float]
) -> tuple[bool, float, float, float, float]:
    """The plane through a side a-b of a polygon that holds the cell, [-1, 1]^3, and the polygon on its inner side.

    inner: a point inside the polygon.

    Returns (found, mx, my, mz, d): unit normal, m x <= d inside; both ends of the side have m x >= d, however rounded.
    """
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    best, bx, by, bz = -np.inf, 0.0, 0.0, 0.0
    for corner in range(8):
        cx = (1.0 if corner & 1 else -1.0) - a[0]
        cy = (1.0 if corner & 2 else -1.0) - a[1]
        cz = (1.0 if corner & 4 else -1.0) - a[2]
        mx, my, mz = ey * cz - ez * cy, ez * cx - ex * cz, ex * cy - ey * cx
        length = np.sqrt(mx * mx + my * my + mz * mz)
        if length == 0.0:
            continue
        if mx * (inner[0] - a[0]) + my * (inner[1] - a[1]) + mz * (inner[2] - a[2]) > 0.0:
            length = -length
        mx, my, mz = mx / length, my / length, mz / length
        inside = mx * a[0] + my * a[1] + mz * a[2] - abs(mx) - abs(my) - abs(mz)
        if inside > best:
            best, bx, by, bz = inside, mx, my, mz
    at_a = bx * a[0] + by * a[1] + bz * a[2]
    at_b = bx * b[0] + by * b[1] + bz * b[2]
    doubt = 1e-15 * (
        abs(bx) * max(abs(a[0]), abs(b[0])) + abs(by) * max(abs(a[1]), abs(b[1])) + abs(bz) * max(abs(a[2]), abs(b[2]))
    )
    d = min(at_a, at_b) - doubt
    return d >= (abs(bx) + abs(by) + abs(bz)) * _GROWN, bx, by, bz, d


@kernel()
def greatest_height(planes: np.ndarray, n: int, nx: float, ny: float, nz: float) -> float:
    """The greatest n x inside half-spaces, or infinity where there is none: then nothing is hidden far behind.

    planes: (n or more, 4) float64 rows (m, d): m x <= d. By linear programming's duality it is the least sum of
    weights times d over all three planes of which the normal n is a sum with weights of 0 or more.
    """
    least = np.inf
    for i in range(n - 2):
        for j in range(i + 1, n - 1):
            ax, ay, az = planes[i, 0], planes[i, 1], planes[i, 2]
            bx, by, bz = planes[j, 0], planes[j, 1], planes[j, 2]
            abx, aby, abz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            for k in range(j + 1, n):
                cx, cy, cz = planes[k, 0], planes[k, 1], planes[k, 2]
                volume = abx * cx + aby * cy + abz * cz
                if abs(volume) < 1e-12:
                    continue
                of_c = (abx * nx + aby * ny + abz * nz) / volume
                of_a = ((by * cz - bz * cy) * nx + (bz * cx - bx * cz) * ny + (bx * cy - by * cx) * nz) / volume
                of_b = ((cy * az - cz * ay) * nx + (cz * ax - cx * az) * ny + (cx * ay - cy * ax) * nz) / volume
                if of_a >= -1e-12 and of_b >= -1e-12 and of_c >= -1e-12:
                    least = min(least, of_a * planes[i, 3] + of_b * planes[j, 3] + of_c * planes[k, 3])
    return least


@allocating_kernel()
def projection_point(faces: np.ndarray, heights: np.ndarray, sides: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """The point (3,) float64 from which a cluster of occluders is shrunk least.

    Args:
        faces: (k, 4) float64 rows (n, h): the plane n x = h of an occluder, n a unit normal, the cell where n x > h.
        heights: (k,) float64 the greatest n x that each alone allows.
        sides: (k, s, 4) float64 half-spaces (m, d): m x <= d; rows that are not used are (0, 0, 0, 1).
        chosen: (c,) int64 the occluders of the cluster.

    The point lies strictly inside all half-spaces and before all planes; the cell's middle, (0, 0, 0), must.
    """
    v = np.zeros(3, np.float64)
    gradient = np.empty(3, np.float64)
    hessian = np.empty((3, 3), np.float64)
    step = np.empty(3, np.float64)
    loss = _loss(faces, heights, chosen, 0.0, 0.0, 0.0)
    if not loss > 0.0:
        return v
    weight = chosen.shape[0] / loss
    for _ in range(_WEIGHTS):
        for _ in range(_STEPS):
            gradient[:] = 0.0
            hessian[:] = 0.0
            for j in chosen:
                n = faces[j]
                miss = n[0] * v[0] + n[1] * v[1] + n[2] * v[2] - heights[j]
                _add(gradient, hessian, n, 2.0 * weight * miss, 2.0 * weight)
                height = n[0] * v[0] + n[1] * v[1] + n[2] * v[2] - n[3]
                _add(gradient, hessian, n, -1.0 / height, 1.0 / (height * height))
                for s in range(sides.shape[1]):
                    m = sides[j, s]
                    room = m[3] - m[0] * v[0] - m[1] * v[1] - m[2] * v[2]
                    _add(gradient, hessian, m, 1.0 / room, 1.0 / (room * room))
            _solve(hessian, gradient, step)
            decrease = gradient[0] * step[0] + gradient[1] * step[1] + gradient[2] * step[2]
            if not decrease > 1e-6:
                break
            far = _way(faces, sides, chosen, v, step)
            # damped where far from the middle of the way, full near it
            far = min(0.9 * far, 1.0)
            for k in range(3):
                v[k] -= far * step[k]
        weight *= _WEAKER
    return v


@kernel()
def _loss(faces: np.ndarray, heights: np.ndarray, chosen: np.ndarray, x: float, y: float, z: float) -> float:
    total = 0.0
    for j in chosen:
        miss = faces[j, 0] * x + faces[j, 1] * y + faces[j, 2] * z - heights[j]
        total += miss * miss
    return total


@kernel(inline="always")
def _add(gradient: np.ndarray, hessian: np.ndarray, n: np.ndarray, first: float, second: float) -> None:
    """Add a function of n x with these derivatives."""
    for a in range(3):
        gradient[a] += first * n[a]
        for b in range(3):
            hessian[a, b] += second * n[a] * n[b]


@kernel()
def _solve(a: np.ndarray, b: np.ndarray, x: np.ndarray) -> None:
    """Solve a x = b for a symmetric positive definite (3, 3), slightly raised on the diagonal, by Cramer's rule."""
    raised = 1e-12 * (a[0, 0] + a[1, 1] + a[2, 2])
    p, q, r = a[0, 0] + raised, a[1, 1] + raised, a[2, 2] + raised
    s, t, u = a[0, 1], a[0, 2], a[1, 2]
    c0, c1, c2 = q * r - u * u, t * u - s * r, s * u - t * q
    determinant = p * c0 + s * c1 + t * c2
    x[0] = (c0 * b[0] + c1 * b[1] + c2 * b[2]) / determinant
    x[1] = (c1 * b[0] + (p * r - t * t) * b[1] + (s * t - p * u) * b[2]) / determinant
    x[2] = (c2 * b[0] + (s * t - p * u) * b[1] + (p * q - s * s) * b[2]) / determinant


@kernel()
def _way(faces: np.ndarray, sides: np.ndarray, chosen: np.ndarray, v: np.ndarray, step: np.ndarray) -> float:
    """How many times `step` may be subtracted from v until a constraint is met."""
    way = np.inf
    for j in chosen:
        n = faces[j]
        room = n[0] * v[0] + n[1] * v[1] + n[2] * v[2] - n[3]
        closing = n[0] * step[0] + n[1] * step[1] + n[2] * step[2]
        if closing > 0.0:
            way = min(way, room / closing)
        for s in range(sides.shape[1]):
            m = sides[j, s]
            room = m[3] - m[0] * v[0] - m[1] * v[1] - m[2] * v[2]
            closing = -(m[0] * step[0] + m[1] * step[1] + m[2] * step[2])
            if closing > 0.0:
                way = min(way, room / closing)
    return way
