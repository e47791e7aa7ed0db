"""A bound by covering: how far a triangle T lies from a surface that extends above all of it.

Seen along T's normal, take any set C of triangles of the surface. An edge of C's rim is one that not exactly two of C's
triangles share. Where no edge of the rim is seen in front of a convex region, each two points of the region (of those
that no edge is seen in front of) lie behind the same number of C's triangles, modulo two: on the way from one to the
other the number only changes where an edge is crossed, and at an edge inside C by 0 or 2. If that number is odd for one
point, it is so for all, so that each point of the region has a point of C straight above or below it, no farther than
the largest height of C above the region. C is found by a flood that crosses every edge seen in front of the region.

The region is T made slightly smaller, for the surface often ends or turns away right at its edges; how far its points
may be from the region's is added to the bound. Rounding moves what is seen by about 1e-15 of the meshes' extent: edges
that come nearer to the region than TOLERANCE are taken to be in front of it.

Based on: the degree modulo two of a piecewise linear map, e.g. J. Milnor, Topology from the Differentiable Viewpoint,
1965, section 4; compare J. Cohen, D. Manocha, M. Olano, Simplifying Polygonal Models Using Successive Mappings,
IEEE Visualization 1997 (bounds by projection onto a plane).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.detail.bounds.closest import Surface
from storage.base.kernels import kernel

#: T shrinks by at most this part of the error that is allowed ...
MARGIN = 0.02
#: ... and at least so much that its edges move by this (in the meshes' units, grid steps); else there is no bound.
THINNEST = 1e-4
#: Edges that come nearer than this to the region count as in front of it.
TOLERANCE = 1e-6
#: Where it is looked whether the number is odd: weights of T's corners, such that no edge is there by chance.
PROBES = ((0.4371, 0.3418, 0.2211), (0.2809, 0.2623, 0.4568))


class Cover(NamedTuple):
    """What is flooded for a triangle."""

    seen: np.ndarray  # (m,) int32 the last triangle for which one of the surface was taken in
    queue: np.ndarray  # (m,) int32 what was taken in
    clipped: np.ndarray  # (2, 16, 3) float64 scratch


class Frame(NamedTuple):
    """Coordinates along a triangle T's plane, from its first corner on, and above it."""

    origin: tuple[float, float, float]
    u: tuple[float, float, float]  # unit vectors: along T's first edge, across it, T's normal
    w: tuple[float, float, float]
    n: tuple[float, float, float]


class Flat(NamedTuple):
    """T in its plane: corners (0, 0), (base, 0) and (x, y)."""

    base: float
    x: float
    y: float
    area: float  # twice its area


class Region(NamedTuple):
    """A triangle in T's plane, and the lines along its edges: e_x x + e_y y >= offset on the inner side."""

    p: tuple[float, float]
    q: tuple[float, float]
    r: tuple[float, float]
    pq: tuple[float, float, float]  # (e_x, e_y, offset)
    qr: tuple[float, float, float]
    rp: tuple[float, float, float]


@kernel()
def covered(
    points: np.ndarray, corner: np.ndarray, surface: Surface, limit: float, cover: Cover, stamp: int, count: int
) -> float:
    """How far the triangle `corner` (3,) of `points` (n, 3) lies from a surface, at most; infinite if above `limit`.

    The flood begins with the `count` triangles in `cover.queue`, each marked with `stamp` in `cover.seen`.
    """
    seen, queue = cover.seen, cover.queue
    frame, flat = _flattened(points, corner)
    if not (flat.area > 0.0 and flat.base > 0.0):
        return np.inf
    region, margin, moved = _shrunk(flat, limit)
    if moved < THINNEST:
        return np.inf
    allowed = limit - margin
    s0x, s0y = PROBES[0][1] * flat.base + PROBES[0][2] * flat.x, PROBES[0][2] * flat.y
    s1x, s1y = PROBES[1][1] * flat.base + PROBES[1][2] * flat.x, PROBES[1][2] * flat.y
    sure0, sure1, odd0, odd1 = True, True, False, False
    height = 0.0
    at = 0
    while at < count:
        k = queue[at]
        at += 1
        a, b, c = _placed(surface, k, 0, frame), _placed(surface, k, 1, frame), _placed(surface, k, 2, frame)
        highest = _height_above(region, a, b, c, allowed, cover.clipped)
        if highest > allowed:
            return np.inf
        height = max(height, highest)
        lengths = (_length(a, b), _length(b, c), _length(c, a))
        if sure0:
            where = _inside(a, b, c, lengths, s0x, s0y)
            odd0 = odd0 != (where == 1)
            sure0 = where != 0
        if sure1:
            where = _inside(a, b, c, lengths, s1x, s1y)
            odd1 = odd1 != (where == 1)
            sure1 = where != 0
        for e in range(3):
            if e == 0:
                in_front = _in_front(region, a, b, lengths[0])
            elif e == 1:
                in_front = _in_front(region, b, c, lengths[1])
            else:
                in_front = _in_front(region, c, a, lengths[2])
            if not in_front:
                continue
            beyond = surface.twin[3 * k + e]
            if beyond < 0:
                return np.inf
            beyond = beyond // 3
            if seen[beyond] != stamp:
                seen[beyond] = stamp
                queue[count] = beyond
                count += 1
    if (sure0 and odd0) or (not sure0 and sure1 and odd1):
        return height + margin + TOLERANCE
    return np.inf


@kernel(inline="always")
def _flattened(points: np.ndarray, corner: np.ndarray) -> tuple[Frame, Flat]:
    """A triangle's plane, and the triangle in it; without meaning where its area or its first edge is nothing."""
    ax, ay, az = points[corner[0], 0], points[corner[0], 1], points[corner[0], 2]
    ux, uy, uz = points[corner[1], 0] - ax, points[corner[1], 1] - ay, points[corner[1], 2] - az
    vx, vy, vz = points[corner[2], 0] - ax, points[corner[2], 1] - ay, points[corner[2], 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = np.sqrt(nx * nx + ny * ny + nz * nz)
    base = np.sqrt(ux * ux + uy * uy + uz * uz)
    nx, ny, nz = nx / area, ny / area, nz / area
    ux, uy, uz = ux / base, uy / base, uz / base
    wx, wy, wz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    flat = Flat(base, vx * ux + vy * uy + vz * uz, vx * wx + vy * wy + vz * wz, area)
    return Frame((ax, ay, az), (ux, uy, uz), (wx, wy, wz), (nx, ny, nz)), flat


@kernel(inline="always")
def _shrunk(flat: Flat, limit: float) -> tuple[Region, float, float]:
    """T made smaller, how far its points may be from the region's then, and how far its edges have moved."""
    base, cx, cy, area = flat
    opposite_a = np.sqrt((cx - base) * (cx - base) + cy * cy)
    opposite_b = np.sqrt(cx * cx + cy * cy)
    around = base + opposite_a + opposite_b
    inner = area / around  # radius of the inscribed circle
    mx, my = (opposite_b * base + base * cx) / around, base * cy / around  # and its centre
    far2 = max(mx * mx + my * my, (mx - base) ** 2 + my * my, (mx - cx) ** 2 + (my - cy) ** 2)
    share = min(MARGIN * limit / np.sqrt(far2), 0.5)
    keep = 1.0 - share
    px, py = mx + keep * (0.0 - mx), my + keep * (0.0 - my)
    qx, qy = mx + keep * (base - mx), my + keep * (0.0 - my)
    rx, ry = mx + keep * (cx - mx), my + keep * (cy - my)
    e1x, e1y = -cy / opposite_a, (cx - base) / opposite_a
    e2x, e2y = cy / opposite_b, -cx / opposite_b
    region = Region(
        (px, py), (qx, qy), (rx, ry),
        (0.0, 1.0, 0.0 * px + 1.0 * py), (e1x, e1y, e1x * qx + e1y * qy), (e2x, e2y, e2x * rx + e2y * ry),
    )  # fmt: skip
    return region, share * np.sqrt(far2), share * inner


@kernel(inline="always")
def _placed(surface: Surface, k: int, e: int, frame: Frame) -> tuple[float, float, float]:
    """Corner e of the surface's triangle k in T's plane, and its height above it."""
    i = surface.triangles[k, e]
    ax, ay, az = frame.origin
    ux, uy, uz = frame.u
    wx, wy, wz = frame.w
    nx, ny, nz = frame.n
    x, y, z = surface.points[i, 0] - ax, surface.points[i, 1] - ay, surface.points[i, 2] - az
    return x * ux + y * uy + z * uz, x * wx + y * wy + z * wz, x * nx + y * ny + z * nz


@kernel(inline="always")
def _length(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """Of an edge as it is seen along T's normal."""
    return float(np.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2))


@kernel(inline="always")
def _height_above(
    region: Region,
    a: tuple[float, float, float],
    b: tuple[float, float, float],
    c: tuple[float, float, float],
    allowed: float,
    polygon: np.ndarray,
) -> float:
    """The largest height of a triangle above the region, or above all of the plane where that is allowed.

    polygon: (2, 16, 3) scratch.
    """
    highest = max(abs(a[2]), abs(b[2]), abs(c[2]))
    if highest > allowed:
        polygon[0, 0, 0], polygon[0, 0, 1], polygon[0, 0, 2] = a
        polygon[0, 1, 0], polygon[0, 1, 1], polygon[0, 1, 2] = b
        polygon[0, 2, 0], polygon[0, 2, 1], polygon[0, 2, 2] = c
        n = _clipped(polygon, 3, 0, region.pq)
        n = _clipped(polygon, n, 1, region.qr)
        n = _clipped(polygon, n, 0, region.rp)
        highest = 0.0
        for i in range(n):
            highest = max(highest, abs(polygon[1, i, 2]))
    return highest


@kernel(inline="always")
def _inner(line: tuple[float, float, float], a: tuple[float, float, float]) -> float:
    """How far a point lies on a line's inner side."""
    return line[0] * a[0] + line[1] * a[1] - line[2]


@kernel(inline="always")
def _in_front(region: Region, a: tuple[float, float, float], b: tuple[float, float, float], length: float) -> bool:
    """Whether an edge from a to b is seen in front of the region, or nearly so."""
    if (
        max(_inner(region.pq, a), _inner(region.pq, b)) < -TOLERANCE
        or max(_inner(region.qr, a), _inner(region.qr, b)) < -TOLERANCE
        or max(_inner(region.rp, a), _inner(region.rp, b)) < -TOLERANCE
    ):
        return False
    fx, fy = a[0], a[1]
    tx, ty = b[0] - fx, b[1] - fy
    p = tx * (region.p[1] - fy) - ty * (region.p[0] - fx)
    q = tx * (region.q[1] - fy) - ty * (region.q[0] - fx)
    r = tx * (region.r[1] - fy) - ty * (region.r[0] - fx)
    near = TOLERANCE * length
    return not (min(p, q, r) > near or max(p, q, r) < -near)


@kernel()
def _inside(
    p: tuple[float, float, float],
    q: tuple[float, float, float],
    r: tuple[float, float, float],
    lengths: tuple[float, float, float],
    x: float,
    y: float,
) -> int:
    """1 where a point lies inside a triangle in the plane, with edges of some lengths; -1 outside; 0 unclear."""
    l0, l1, l2 = lengths
    a = (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
    b = (r[0] - q[0]) * (y - q[1]) - (r[1] - q[1]) * (x - q[0])
    c = (p[0] - r[0]) * (y - r[1]) - (p[1] - r[1]) * (x - r[0])
    above = int(a > TOLERANCE * l0) + int(b > TOLERANCE * l1) + int(c > TOLERANCE * l2)
    below = int(a < -TOLERANCE * l0) + int(b < -TOLERANCE * l1) + int(c < -TOLERANCE * l2)
    if above == 3 or below == 3:
        return 1
    if above > 0 and below > 0:
        return -1
    return 0


@kernel()
def _clipped(polygon: np.ndarray, n: int, side: int, line: tuple[float, float, float]) -> int:
    """Clip the n corners polygon[side] to a line's inner side, into polygon[1 - side]; how many corners are left."""
    count = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        f = line[0] * polygon[side, i, 0] + line[1] * polygon[side, i, 1] - line[2]
        g = line[0] * polygon[side, j, 0] + line[1] * polygon[side, j, 1] - line[2]
        if f >= 0.0:
            for c in range(3):
                polygon[1 - side, count, c] = polygon[side, i, c]
            count += 1
        if (f < 0.0 < g) or (g < 0.0 < f):
            s = f / (f - g)
            for c in range(3):
                polygon[1 - side, count, c] = polygon[side, i, c] + s * (polygon[side, j, c] - polygon[side, i, c])
            count += 1
    return count
