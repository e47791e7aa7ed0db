"""How far a triangle lies from a surface, by parts: branch and bound.

A triangle is parted, first into pieces no larger than the triangles they face, then along the edges of the triangle
that they face, and each is tried again. Cut along those edges, a piece lies above the inside of the triangle, and its
bound is its height above it. No point of a piece is farther from the surface than its centre is, and the way from
there: that settles small pieces.

Based on: M. Tang, M. Lee, Y. J. Kim, Interactive Hausdorff distance computation for general polygonal models, SIGGRAPH
2009 (branch and bound by Voronoi subdivision).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.detail.bounds.closest import SLIM, Surface, closest, distance2
from storage.base.kernels import allocating_kernel, kernel

#: Polygons with this many corners are halved instead of being cut along a triangle's edges.
MANY_CORNERS = 12
#: A polygon is cut along a triangle's edges if its extent squared is below this times the triangle's, else halved.
LARGE2 = 30.0
#: Neighbours that are walked to before the closest triangle is looked up.
MANY_WALKS = 6
#: In place of the number of walks: the polygon was cut along all edges of its triangle and lies above it.
ABOVE = MANY_WALKS + 1
#: Pieces whose radius squared is at most this part of what is allowed are settled by where their centre lies.
COMPACT2 = 0.4
#: Where a point lies is not looked up more closely than this part of the squared distance that is known to be reached;
#: of pieces that are hard to bound, it is: they must find the triangle that they lie above.
NEAR2 = 0.6
#: Room for a polygon's corners: a cut adds one at most to each of its parts.
MAX_CORNERS = 20
#: Polygons cut more often than this are halved only, which makes them small for certain, and then given up.
MAX_CUTS = 96
MAX_DEPTH = 144
#: Polygons waiting to be bounded; each cut replaces one by at most four, each halving by two.
MAX_STACK = 4 * MAX_CUTS + MAX_DEPTH - MAX_CUTS + 8
#: Cuts spared where the cut-off part would be thinner than this, in the meshes' units (grid steps).
THIN = 1e-6
#: The bound need not be as close as was asked for where effort runs out, but squared may be this many times as large;
#: and again, as often as it takes.
LOOSER = 1.5


class Wanted(NamedTuple):
    """How close a bound must come: all squared."""

    lower2: float  # a distance that some point is known to have
    slack2: float  # how many times that the bound may be
    floor2: float  # what it may be in any case
    loosened: float  # how many times as large it may be for want of effort
    effort: int  # pieces to try before that grows


class Parts(NamedTuple):
    """Polygons that wait, and what they are cut in."""

    query: np.ndarray  # (128,) int32
    stack: np.ndarray  # (MAX_STACK, MAX_CORNERS, 3) float64 polygons that wait
    sizes: np.ndarray  # (MAX_STACK,) int32 their corners
    hints: np.ndarray  # (MAX_STACK,) int32 a triangle to try for each
    depths: np.ndarray  # (MAX_STACK,) int32 how often they were cut
    walks: np.ndarray  # (MAX_STACK,) int32 triangles tried in vain since the closest one was last looked up
    polygon: np.ndarray  # (MAX_CORNERS, 3) float64
    side: np.ndarray  # (MAX_CORNERS,) float64
    rest: np.ndarray  # (MAX_CORNERS, 3) float64
    other: np.ndarray  # (MAX_CORNERS, 3) float64


@allocating_kernel()
def make_parts() -> Parts:
    """Room for them."""
    return Parts(
        np.empty(128, np.int32), np.empty((MAX_STACK, MAX_CORNERS, 3)), np.empty(MAX_STACK, np.int32),
        np.empty(MAX_STACK, np.int32), np.empty(MAX_STACK, np.int32), np.empty(MAX_STACK, np.int32),
        np.empty((MAX_CORNERS, 3)), np.empty(MAX_CORNERS), np.empty((MAX_CORNERS, 3)), np.empty((MAX_CORNERS, 3)),
    )  # fmt: skip


@kernel(inline="always")
def enough2(wanted: Wanted) -> float:
    """The squared distance that a bound may be."""
    return max(wanted.slack2 * wanted.lower2, wanted.floor2) * wanted.loosened


@kernel(inline="always")
def reached(wanted: Wanted, distance2: float) -> Wanted:
    """The same where a point is known to have a squared distance."""
    return Wanted(max(wanted.lower2, distance2), wanted.slack2, wanted.floor2, wanted.loosened, wanted.effort)


@kernel(inline="always")
def _tried(wanted: Wanted, whole_effort: int) -> Wanted:
    """The same after one piece more; less close where effort has run out."""
    if wanted.effort > 0:
        return Wanted(wanted.lower2, wanted.slack2, wanted.floor2, wanted.loosened, wanted.effort - 1)
    return Wanted(wanted.lower2, wanted.slack2, wanted.floor2, wanted.loosened * LOOSER, whole_effort)


@kernel(inline="always")
def _copy(polygon: np.ndarray, n: int, to: np.ndarray) -> None:
    """Copy the n corners of a polygon."""
    for i in range(n):
        for c in range(3):
            to[i, c] = polygon[i, c]


@kernel()
def _corner_bound(frames: np.ndarray, k: int, polygon: np.ndarray, n: int) -> tuple[float, int]:
    """The largest squared distance of the polygon's n corners to triangle k, and which corner has it."""
    worst = 0
    bound2 = -1.0
    for i in range(n):
        d2 = distance2(frames, k, polygon[i, 0], polygon[i, 1], polygon[i, 2])
        if d2 > bound2:
            bound2 = d2
            worst = i
    return bound2, worst


@kernel()
def _within(frames: np.ndarray, k: int, polygon: np.ndarray, n: int, enough2: float) -> float:
    """The largest squared distance of the polygon's n corners to triangle k; infinite as soon as it exceeds enough2."""
    bound2 = 0.0
    for i in range(n):
        bound2 = max(bound2, distance2(frames, k, polygon[i, 0], polygon[i, 1], polygon[i, 2]))
        if bound2 > enough2:
            return np.inf
    return bound2


@kernel()
def _around2(polygon: np.ndarray, n: int, corner: int, d2: float) -> float:
    """The largest squared distance of a polygon's points, if one of its n corners has the squared distance d2.

    No point is farther from a corner than the farthest other corner.
    """
    far2 = 0.0
    for i in range(n):
        x, y, z = (
            polygon[i, 0] - polygon[corner, 0],
            polygon[i, 1] - polygon[corner, 1],
            polygon[i, 2] - polygon[corner, 2],
        )
        far2 = max(far2, x * x + y * y + z * z)
    return (np.sqrt(d2) + np.sqrt(far2)) ** 2


@kernel()
def _ball(polygon: np.ndarray, n: int) -> tuple[float, float, float, float]:
    """The mean of a polygon's n corners, and the largest squared distance of a corner from it."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(n):
        x += polygon[i, 0]
        y += polygon[i, 1]
        z += polygon[i, 2]
    x, y, z = x / n, y / n, z / n
    radius2 = 0.0
    for i in range(n):
        dx, dy, dz = polygon[i, 0] - x, polygon[i, 1] - y, polygon[i, 2] - z
        radius2 = max(radius2, dx * dx + dy * dy + dz * dz)
    return x, y, z, radius2


@kernel()
def _height(planes: np.ndarray, k: int, polygon: np.ndarray, n: int) -> float:
    """The largest squared height above triangle k of the n corners of a polygon that was cut along k's edges.

    Its corners may lie beyond the edges by THIN, so by SLIM * THIN from above the triangle: that is added. Infinite for
    slim triangles.
    """
    x, y, z, offset = planes[k, 3, 0], planes[k, 3, 1], planes[k, 3, 2], planes[k, 3, 3]
    if x == 0.0 and y == 0.0 and z == 0.0:
        return np.inf
    height = 0.0
    for i in range(n):
        height = max(height, abs(x * polygon[i, 0] + y * polygon[i, 1] + z * polygon[i, 2] - offset))
    height += SLIM * THIN
    return height * height


@kernel()
def _cut(
    polygon: np.ndarray,
    n: int,
    x: float,
    y: float,
    z: float,
    offset: float,
    side: np.ndarray,
    inside: np.ndarray,
    outside: np.ndarray,
) -> tuple[int, int]:
    """Part a convex polygon at a plane, unit normal (x, y, z): the corners of the parts on its two sides.

    Returns the numbers of corners of `inside` (normal . p >= offset) and `outside`; (n, 0) or (0, n), with nothing
    written, where the other part would be thinner than THIN. side (MAX_CORNERS,) is scratch space.
    """
    low, high = np.inf, -np.inf
    for i in range(n):
        f = x * polygon[i, 0] + y * polygon[i, 1] + z * polygon[i, 2] - offset
        side[i] = f
        low = min(low, f)
        high = max(high, f)
    if low >= -THIN:
        return n, 0
    if high <= THIN:
        return 0, n
    n_in = 0
    n_out = 0
    for i in range(n):
        f = side[i]
        if f >= 0.0:
            inside[n_in, 0], inside[n_in, 1], inside[n_in, 2] = polygon[i, 0], polygon[i, 1], polygon[i, 2]
            n_in += 1
        if f <= 0.0:
            outside[n_out, 0], outside[n_out, 1], outside[n_out, 2] = polygon[i, 0], polygon[i, 1], polygon[i, 2]
            n_out += 1
        j = i + 1 if i + 1 < n else 0
        g = side[j]
        if (f < 0.0 < g) or (g < 0.0 < f):
            s = f / (f - g)
            for c in range(3):
                p = polygon[i, c] + s * (polygon[j, c] - polygon[i, c])
                inside[n_in, c] = p
                outside[n_out, c] = p
            n_in += 1
            n_out += 1
    return n_in, n_out


@kernel()
def _longest(polygon: np.ndarray, n: int) -> tuple[float, int, int]:
    """The largest squared distance between two corners, and which corners they are."""
    best, p, q = -1.0, 0, 0
    for i in range(n):
        for j in range(i + 1, n):
            dx = polygon[i, 0] - polygon[j, 0]
            dy = polygon[i, 1] - polygon[j, 1]
            dz = polygon[i, 2] - polygon[j, 2]
            d2 = dx * dx + dy * dy + dz * dz
            if d2 > best:
                best, p, q = d2, i, j
    return best, p, q


@kernel()
def _size2(corners: np.ndarray, k: int) -> float:
    """The squared length of triangle k's longer edge at its first corner."""
    ab = corners[k, 3] * corners[k, 3] + corners[k, 4] * corners[k, 4] + corners[k, 5] * corners[k, 5]
    ac = corners[k, 6] * corners[k, 6] + corners[k, 7] * corners[k, 7] + corners[k, 8] * corners[k, 8]
    return max(ab, ac)


@kernel()
def _part_along_edges(b: Surface, k: int, parts: Parts, n: int, top: int) -> tuple[int, int, int]:
    """Cut the n corners of `parts.polygon` along triangle k's edges; let what lies outside wait, with the one there.

    Returns the new top of the stack; how many corners of the polygon, overwritten, are left; and the triangle to try
    for what is left: k itself where it lies above that, else the neighbour beyond the edge that all of it lies beyond,
    -1 where there is none.
    """
    polygon, rest, other = parts.polygon, parts.rest, parts.other
    for edge in range(3):
        x, y, z = b.planes[k, edge, 0], b.planes[k, edge, 1], b.planes[k, edge, 2]
        n_in, n_out = _cut(polygon, n, x, y, z, b.planes[k, edge, 3], parts.side, rest, other)
        if n_out == 0:
            continue
        beyond = b.twin[3 * k + edge]
        if n_in == 0:
            return top, n, beyond // 3 if beyond >= 0 else -1
        _wait(parts, top, other, n_out, beyond // 3 if beyond >= 0 else k, 0)
        top += 1
        n = n_in
        _copy(rest, n, polygon)
    return top, n, k


@kernel()
def _halve(parts: Parts, n: int, k: int, top: int) -> int:
    """Cut the n corners of `parts.polygon` across the middle of their longest extent, and let both halves wait.

    k: the triangle to try for them. Returns the new top of the stack, the old one where there is nothing to cut.
    """
    polygon, rest, other = parts.polygon, parts.rest, parts.other
    long2, p, q = _longest(polygon, n)
    length = np.sqrt(long2)
    if not length > 0.0:
        return top
    x = (polygon[p, 0] - polygon[q, 0]) / length
    y = (polygon[p, 1] - polygon[q, 1]) / length
    z = (polygon[p, 2] - polygon[q, 2]) / length
    px, py, pz = polygon[p, 0] + polygon[q, 0], polygon[p, 1] + polygon[q, 1], polygon[p, 2] + polygon[q, 2]
    n_in, n_out = _cut(polygon, n, x, y, z, (x * px + y * py + z * pz) / 2.0, parts.side, rest, other)
    if n_in == 0 or n_out == 0:
        return top
    _wait(parts, top, rest, n_in, k, 0)
    _wait(parts, top + 1, other, n_out, k, 0)
    return top + 2


@kernel(inline="always")
def _wait(parts: Parts, at: int, polygon: np.ndarray, n: int, k: int, walked: int) -> None:
    """Put the n corners of a polygon at a place of the stack; k: the triangle to try; walked: see `Parts.walks`."""
    _copy(polygon, n, parts.stack[at])
    parts.sizes[at], parts.hints[at], parts.walks[at] = n, k, walked


@kernel(inline="always")
def _look_up(b: Surface, k: int, parts: Parts, n: int, wanted: Wanted) -> tuple[float, int, Wanted]:
    """Bound `parts.polygon` by triangle k and the one that is closest to the corner that is farthest from k.

    Returns the squared bound, the closest triangle, and what is wanted from now on.
    """
    frames, polygon = b.tree.frames, parts.polygon
    bound2, worst = _corner_bound(frames, k, polygon, n)
    nearest, d2 = closest(b.tree, parts.query, polygon[worst, 0], polygon[worst, 1], polygon[worst, 2], k, 0.0)
    bound2 = min(bound2, _around2(polygon, n, worst, d2))
    if nearest != k:
        bound2 = min(bound2, _corner_bound(frames, nearest, polygon, n)[0])
    return bound2, nearest, reached(wanted, d2)


@kernel(inline="always")
def _part(b: Surface, k: int, parts: Parts, n: int, top: int, walked: int, cut: bool, looked_up: bool) -> int:
    """Part the n corners of `parts.polygon` and let the parts wait; the old top of the stack if that cannot be done.

    cut: along the edges of triangle k if it can be, else in two halves; walked: see `Parts.walks`; looked_up: whether k
    is the closest triangle, so that no other is to be tried for all of the polygon.
    """
    if cut:
        onto, n, onward = _part_along_edges(b, k, parts, n, top)
        if onto > top or not looked_up:
            if onward == k:
                walked = ABOVE
            else:
                walked = walked + 1 if onward >= 0 else MANY_WALKS
            _wait(parts, onto, parts.polygon, n, onward if onward >= 0 else k, walked)
            return onto + 1
    return _halve(parts, n, k, top)


@kernel()
def bound_by_parts(
    points: np.ndarray, triangles: np.ndarray, t: int, b: Surface, start: int, wanted: Wanted, whole_effort: int,
    parts: Parts,
) -> tuple[float, Wanted]:  # fmt: skip
    """Bound the squared distance of triangle t's points to surface `b`, of which triangle `start` is near.

    whole_effort: what effort grows by where it runs out. Returns what is wanted of later ones too.
    """
    frames, polygon, depths = b.tree.frames, parts.polygon, parts.depths
    bound2 = 0.0
    limit2 = enough2(wanted)
    for e in range(3):
        for c in range(3):
            polygon[e, c] = points[triangles[t, e], c]
    _wait(parts, 0, polygon, 3, start, 0)
    depths[0] = 0
    whole2 = _longest(polygon, 3)[0]
    top = 1
    while top > 0:
        top -= 1
        n, k, depth, walked = parts.sizes[top], parts.hints[top], depths[top], parts.walks[top]
        _copy(parts.stack[top], n, polygon)
        here2 = _height(b.planes, k, polygon, n) if walked == ABOVE else np.inf
        if here2 > limit2:
            here2 = _within(frames, k, polygon, n, limit2)
        if here2 <= limit2:
            bound2 = max(bound2, here2)
            continue
        # of a piece that is small compared with what is allowed, its centre tells enough
        x, y, z, radius2 = _ball(polygon, n)
        if radius2 <= COMPACT2 * limit2:
            _, d2 = closest(b.tree, parts.query, x, y, z, k, NEAR2 * wanted.lower2)
            wanted = reached(wanted, d2)
            limit2 = enough2(wanted)
            here2 = (np.sqrt(d2) + np.sqrt(radius2)) ** 2
            if here2 <= limit2:
                bound2 = max(bound2, here2)
                continue
        large2 = LARGE2 * _size2(b.corners, k)
        cut = depth < MAX_CUTS and n <= MANY_CORNERS and (whole2 <= large2 or _longest(polygon, n)[0] <= large2)
        look_up = walked >= MANY_WALKS or not cut
        if look_up:
            here2, nearest, wanted = _look_up(b, k, parts, n, wanted)
            limit2 = enough2(wanted)
            cut = cut and nearest != k
            k = nearest
            if here2 <= limit2:
                bound2 = max(bound2, here2)
                continue
        wanted = _tried(wanted, whole_effort)
        limit2 = enough2(wanted)
        onto = top
        if depth >= MAX_DEPTH or top + 5 > MAX_STACK or n + 2 > MAX_CORNERS:
            x, y, z = polygon[0, 0], polygon[0, 1], polygon[0, 2]
            _, d2 = closest(b.tree, parts.query, x, y, z, k, NEAR2 * wanted.lower2)
            here2 = min(here2, _around2(polygon, n, 0, d2))
        else:
            onto = _part(b, k, parts, n, top, walked, cut, look_up)
        if onto == top:
            bound2 = max(bound2, min(here2, _corner_bound(frames, k, polygon, n)[0]))
        for s in range(top, onto):
            depths[s] = depth + 1
        top = onto
    return bound2, wanted
