"""Thin things: kept as wide as they were, or how wide what was lost is. Distances between surfaces do not tell.

A pipe may become a flat strip, or a single triangle: no point of it is farther off than the pipe's radius, and yet it
is gone where one looks along the strip. So each connected thing is weighed from all sides: the sum of
area * n n^T over its triangles, with unit normals n, is a quadratic form that says how much surface faces each
direction; half of it, over the length of a closed thing, is about its width as seen from there. A direction in which a
level keeps less than KEPT of that is one in which the thing is lost, and its width in this direction is what the level
must answer for. Widths are at most twice the distance between the surfaces: what is wider cannot be lost.

Before that, points of thin closed things are moved outward by about as much as they lie inside of what they stand for.

Based on: A. L. Cauchy, Memoire sur la rectification des courbes et la quadrature des surfaces courbes, 1832 (a convex
body's shadow is half of the sum of its faces' shadows); C. G. J. Jacobi, Ueber ein leichtes Verfahren, die in der
Theorie der Saecularstoerungen vorkommenden Gleichungen numerisch aufzuloesen, Crelle 30, 1846 (axes of a form).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.objects.weld import OPEN
from storage.base.kernels import allocating_kernel, kernel

#: A thing is lost in a direction in which less than this part of its surface is left.
KEPT = 0.5
#: Of a round thing's form in a direction, this part over its length is its width: half of it faces away.
ROUND = 2.0 / np.pi
#: What is closed and has fewer triangles than a prism ends in a point or in an edge: from some side it is half gone.
SOLID = 8
#: A level must not be shown where what it has lost is wider than this part of the allowed error.
PART = 1.0
#: Things are thin where they are less wide than so many times what their points have been moved by.
THIN = 10.0
#: They are widened by at most this part of their width on each side.
SWELL = 0.25
#: What holds points in the plane of their triangles, as a part of what holds them to these.
LOOSE = 1e-3
#: A point at a corner goes at most this many times as far as the planes of its triangles.
LONGEST = 2.0
#: The least that a form has in any direction, as a part of the most: a flat sheet has nothing along itself.
FLAT = 1e-6
#: Rounds of rotations: each squares what is left beside the diagonal.
ROUNDS = 6


class Things(NamedTuple):
    """The connected things of a mesh, as they are before it is simplified."""

    label: np.ndarray  # (m,) int32: the thing that each triangle belongs to
    form: np.ndarray  # (k, 3, 3) float64: sum of area * n n^T
    length: np.ndarray  # (k,) float64: diagonal of the box
    closed: np.ndarray  # (k,) bool: no edge is open, so that half of the surface faces away
    width: np.ndarray  # (k,) float64: of what is seen from the side from which it is thin, about
    triangles: np.ndarray  # (k,) int32: how many


@allocating_kernel()
def make_things(points: np.ndarray, triangles: np.ndarray, twin: np.ndarray, label: np.ndarray, count: int) -> Things:
    """The `count` things of points (n, 3) int32, triangles (m, 3) int32, twin (3 m,), label (m,): see `components`."""
    length = np.zeros(count)
    closed = np.ones(count, np.bool_)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    for t in range(len(triangles)):
        thing = label[t]
        for e in range(3):
            closed[thing] = closed[thing] and twin[3 * t + e] != OPEN
            for c in range(3):
                low[thing, c] = min(low[thing, c], points[triangles[t, e], c])
                high[thing, c] = max(high[thing, c], points[triangles[t, e], c])
    for thing in range(count):
        total = 0.0
        for c in range(3):
            total += (high[thing, c] - low[thing, c]) ** 2
        length[thing] = np.sqrt(total)
    every = np.arange(len(triangles)).astype(np.int32)
    form = _forms(points, triangles, label, every, count)
    width = np.empty(count)
    now, axes = np.empty((3, 3)), np.empty((3, 3))
    for thing in range(count):
        now[:] = form[thing]
        _axes(now, axes)
        x, y, z = now[0, 0], now[1, 1], now[2, 2]
        second = max(min(x, y), min(max(x, y), z))
        width[thing] = (ROUND if closed[thing] else 1.0) * second / max(length[thing], 1.0)
    return Things(label, form, length, closed, width, _counts(label, every, count))


@allocating_kernel()
def _counts(label: np.ndarray, source: np.ndarray, count: int) -> np.ndarray:
    """How many triangles (count,) int32 each thing has; label[source] is their thing."""
    triangles = np.zeros(count, np.int32)
    for s in source:
        triangles[label[s]] += 1
    return triangles


@allocating_kernel()
def widen(things: Things, points: np.ndarray, triangles: np.ndarray, source: np.ndarray, reach: np.ndarray) -> None:
    """Move the points (n, 3) int32 of thin closed things outward, so that they stay as wide as they were.

    Where edges have been collapsed, some of the surface lies inside of the former one, by about `reach` (n,) at each
    point, and some outside; what is thinner than a pixel must not get thinner still. triangles (m, 3), source (m,): as
    in `lost_width`. A point moves by its reach from the planes of all its triangles, as well as may be; by SWELL of the
    thing's width at most, and not at all where that is more than THIN times its reach.
    """
    matrix, vector = np.zeros((len(points), 6)), np.zeros((len(points), 3))
    amount = np.zeros(len(points))
    for t in range(len(triangles)):
        thing = things.label[source[t]]
        if not things.closed[thing]:
            continue
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        width = things.width[thing]
        thin = False
        for v in (a, b, c):
            if reach[v] > 0.0 and width < THIN * reach[v]:
                amount[v] = min(reach[v], SWELL * width)
                thin = True
        if not thin:
            continue
        ux, uy, uz = (
            np.float64(points[b, 0]) - points[a, 0],
            np.float64(points[b, 1]) - points[a, 1],
            np.float64(points[b, 2]) - points[a, 2],
        )
        vx, vy, vz = (
            np.float64(points[c, 0]) - points[a, 0],
            np.float64(points[c, 1]) - points[a, 1],
            np.float64(points[c, 2]) - points[a, 2],
        )
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(x * x + y * y + z * z)
        if length <= 0.0:
            continue
        x, y, z = x / length, y / length, z / length
        for v in (a, b, c):
            if amount[v] > 0.0:
                matrix[v, 0] += x * x
                matrix[v, 1] += x * y
                matrix[v, 2] += x * z
                matrix[v, 3] += y * y
                matrix[v, 4] += y * z
                matrix[v, 5] += z * z
                vector[v, 0] += x
                vector[v, 1] += y
                vector[v, 2] += z
    for v in range(len(points)):
        if amount[v] == 0.0:
            continue
        xx, xy, xz, yy, yz, zz = matrix[v]
        little = LOOSE * (xx + yy + zz)
        xx, yy, zz = xx + little, yy + little, zz + little
        cx, cy, cz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        determinant = xx * cx + xy * cy + xz * cz
        if determinant <= 0.0:
            continue
        bx, by, bz = vector[v]
        gx = (cx * bx + cy * by + cz * bz) / determinant
        gy = (cy * bx + (xx * zz - xz * xz) * by + (xy * xz - xx * yz) * bz) / determinant
        gz = (cz * bx + (xy * xz - xx * yz) * by + (xx * yy - xy * xy) * bz) / determinant
        length = np.sqrt(gx * gx + gy * gy + gz * gz)
        part = amount[v] * (LONGEST / length if length > LONGEST else 1.0)
        points[v, 0] += np.int32(np.rint(part * gx))
        points[v, 1] += np.int32(np.rint(part * gy))
        points[v, 2] += np.int32(np.rint(part * gz))


@allocating_kernel()
def _forms(points: np.ndarray, triangles: np.ndarray, label: np.ndarray, source: np.ndarray, count: int) -> np.ndarray:
    """The sum of area * n n^T (count, 3, 3) over the triangles (m, 3) of each thing; label[source] is their thing."""
    form = np.zeros((count, 3, 3))
    normal = np.empty(3)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, uy, uz = (
            np.float64(points[b, 0]) - points[a, 0],
            np.float64(points[b, 1]) - points[a, 1],
            np.float64(points[b, 2]) - points[a, 2],
        )
        vx, vy, vz = (
            np.float64(points[c, 0]) - points[a, 0],
            np.float64(points[c, 1]) - points[a, 1],
            np.float64(points[c, 2]) - points[a, 2],
        )
        normal[0], normal[1], normal[2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        twice = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        if twice > 0.0:
            thing = label[source[t]]
            for i in range(3):
                for j in range(3):
                    form[thing, i, j] += normal[i] * normal[j] / (2.0 * twice)
    return form


@kernel()
def _axes(form: np.ndarray, axes: np.ndarray) -> None:
    """Turn a symmetric form (3, 3) into a diagonal one, in place; axes (3, 3): gets its unit axes as columns."""
    for i in range(3):
        for j in range(3):
            axes[i, j] = 1.0 if i == j else 0.0
    for _ in range(ROUNDS):
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if abs(form[p, q]) <= 1e-15 * (abs(form[p, p]) + abs(form[q, q])):
                continue
            theta = (form[q, q] - form[p, p]) / (2.0 * form[p, q])
            t = (1.0 if theta >= 0.0 else -1.0) / (abs(theta) + np.sqrt(theta * theta + 1.0))
            c = 1.0 / np.sqrt(t * t + 1.0)
            s = t * c
            for k in range(3):
                kp, kq = form[k, p], form[k, q]
                form[k, p], form[k, q] = c * kp - s * kq, s * kp + c * kq
            for k in range(3):
                pk, qk = form[p, k], form[q, k]
                form[p, k], form[q, k] = c * pk - s * qk, s * pk + c * qk
            for k in range(3):
                kp, kq = axes[k, p], axes[k, q]
                axes[k, p], axes[k, q] = c * kp - s * kq, s * kp + c * kq


@allocating_kernel()
def lost_width(things: Things, points: np.ndarray, triangles: np.ndarray, source: np.ndarray) -> float:
    """The largest width, in grid steps, of a thing in a direction in which it is lost; 0 if nothing is.

    points (n, 3) int32, triangles (m, 3) int32: what was made of the things, as it is before triangles that are there
    twice are left out; source (m,) int32: which of the former triangles each one was.
    """
    count = len(things.length)
    left = _forms(points, triangles, things.label, source, count)
    triangles_left = _counts(things.label, source, count)
    before, axes = np.empty((3, 3)), np.empty((3, 3))
    white, now, turn, squares = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    widest = 0.0
    for thing in range(count):
        if things.closed[thing] and triangles_left[thing] < SOLID <= things.triangles[thing]:
            widest = max(widest, things.width[thing])
        for i in range(3):
            for j in range(3):
                before[i, j] = things.form[thing, i, j]
        _axes(before, axes)
        most = max(before[0, 0], before[1, 1], before[2, 2])
        if most <= 0.0:
            continue
        for i in range(3):
            for j in range(3):
                white[i, j] = axes[i, j] / np.sqrt(max(before[j, j], FLAT * most))
        for i in range(3):
            for j in range(3):
                now[i, j] = 0.0
                for k in range(3):
                    for n in range(3):
                        now[i, j] += white[k, i] * left[thing, k, n] * white[n, j]
        _axes(now, turn)
        # of all directions between those in which too little is left, the one from which the thing is widest
        for i in range(3):
            for j in range(3):
                squares[i, j] = 0.0
                if now[i, i] < KEPT and now[j, j] < KEPT:
                    for k in range(3):
                        along = white[k, 0] * turn[0, i] + white[k, 1] * turn[1, i] + white[k, 2] * turn[2, i]
                        across = white[k, 0] * turn[0, j] + white[k, 1] * turn[1, j] + white[k, 2] * turn[2, j]
                        squares[i, j] += along * across
        _axes(squares, axes)
        least = np.inf
        for i in range(3):
            if squares[i, i] * most > 0.5:  # none is below 1 / most, but for directions that keep enough: these are 0
                least = min(least, squares[i, i])
        width = 1.0 / (least * max(things.length[thing], 1.0))
        widest = max(widest, ROUND * width if things.closed[thing] else width)
    return widest


def shown_error(error: float, lost: float) -> float:
    """From which error on a level may be shown: its own, or more where it has lost something wide.

    error: two-sided Hausdorff bound; lost: the largest width of a thing that is lost; all in the same unit.
    """
    return max(error, min(lost, 2.0 * error) / PART)
