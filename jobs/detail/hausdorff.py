"""A certified upper bound of the two-sided Hausdorff distance between two triangle meshes.

The distance to one triangle K is convex, so over a convex polygon P it is largest in a corner of P: the largest corner
distance to any single K bounds how far P lies from the whole mesh. Triangles for which the best K near their corners
gives a bound above `slack` times the running lower bound (the largest distance found for any point) are parted, first
into pieces no larger than the triangles they face, then along the edges of the triangle they face, and tried again:
branch and bound. Cut along those edges, a piece lies above the inside of K, and its bound is its height above K.

Any partition gives a valid bound; choosing it well only makes it tight. Rounding enters only through the coordinates
of the cut points and of the closest points, about 1e-15 of the mesh's size; callers add a margin for it.

Based on: N. Aspert, D. Santa-Cruz, T. Ebrahimi, MESH: Measuring errors between surfaces using the Hausdorff distance,
ICME 2002 (sampling, without bounds); M. Tang, M. Lee, Y. J. Kim, Interactive Hausdorff distance computation for general
polygonal models, SIGGRAPH 2009 (branch and bound by Voronoi subdivision).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from jobs.detail.closest import Surface, closest, distance2

#: Polygons with this many corners are halved instead of being cut along a triangle's edges.
MANY_CORNERS = 12
#: Room for a polygon's corners: cuts along three edges add at most one each.
MAX_CORNERS = 20
#: Polygons waiting to be bounded; each step replaces one by at most four, to the depth below.
MAX_STACK = 400
MAX_DEPTH = 96
#: Cuts spared where the cut-off part would be thinner than this, in the meshes' units (grid steps).
THIN = 1e-6
#: Pieces tried per triangle, on average, before what is left keeps the bound it has.
EFFORT = 40


@njit(cache=True, nogil=True)
def point_distances(points: np.ndarray, surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    """The closest triangle (n,) int32 of `surface` to each of points (n, 3), and the squared distance (n,)."""
    stack = np.empty(128, np.int32)
    nearest = np.empty(len(points), np.int32)
    squared = np.empty(len(points))
    hint = 0
    for i in range(len(points)):
        hint, squared[i] = closest(
            surface.corners, surface.box, surface.child, stack, points[i, 0], points[i, 1], points[i, 2], hint
        )
        nearest[i] = hint
    return nearest, squared


@njit(cache=True, nogil=True)
def _corner_bound(corners: np.ndarray, k: int, polygon: np.ndarray, n: int) -> tuple[float, int]:
    """The largest squared distance of the polygon's n corners to triangle k, and which corner has it."""
    worst = 0
    bound2 = -1.0
    for i in range(n):
        d2 = distance2(corners, k, polygon[i, 0], polygon[i, 1], polygon[i, 2])
        if d2 > bound2:
            bound2 = d2
            worst = i
    return bound2, worst


@njit(cache=True, nogil=True)
def _cut(
    polygon: np.ndarray, n: int, plane: tuple[float, float, float, float], inside: np.ndarray, outside: np.ndarray
) -> tuple[int, int]:
    """Part a convex polygon at a plane (unit normal, offset): the corners of the parts on its two sides.

    Returns the numbers of corners of `inside` (normal . p >= offset) and `outside`; (n, 0) or (0, n), with nothing
    written, where the other part would be thinner than THIN.
    """
    low, high = np.inf, -np.inf
    for i in range(n):
        f = plane[0] * polygon[i, 0] + plane[1] * polygon[i, 1] + plane[2] * polygon[i, 2] - plane[3]
        low = min(low, f)
        high = max(high, f)
    if low >= -THIN:
        return n, 0
    if high <= THIN:
        return 0, n
    n_in = 0
    n_out = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        f = plane[0] * polygon[i, 0] + plane[1] * polygon[i, 1] + plane[2] * polygon[i, 2] - plane[3]
        g = plane[0] * polygon[j, 0] + plane[1] * polygon[j, 1] + plane[2] * polygon[j, 2] - plane[3]
        if f >= 0.0:
            for c in range(3):
                inside[n_in, c] = polygon[i, c]
            n_in += 1
        if f <= 0.0:
            for c in range(3):
                outside[n_out, c] = polygon[i, c]
            n_out += 1
        if (f < 0.0 < g) or (g < 0.0 < f):
            s = f / (f - g)
            for c in range(3):
                p = polygon[i, c] + s * (polygon[j, c] - polygon[i, c])
                inside[n_in, c] = p
                outside[n_out, c] = p
            n_in += 1
            n_out += 1
    return n_in, n_out


@njit(cache=True, nogil=True)
def _edge_plane(corners: np.ndarray, k: int, edge: int) -> tuple[float, float, float, float]:
    """The plane through an edge of triangle k at right angles to it, facing inward; the zero plane for a needle."""
    abx, aby, abz = corners[k, 3], corners[k, 4], corners[k, 5]
    acx, acy, acz = corners[k, 6], corners[k, 7], corners[k, 8]
    nx, ny, nz = aby * acz - abz * acy, abz * acx - abx * acz, abx * acy - aby * acx
    px, py, pz = corners[k, 0], corners[k, 1], corners[k, 2]
    if edge == 0:
        ex, ey, ez = abx, aby, abz
    elif edge == 1:
        ex, ey, ez = acx - abx, acy - aby, acz - abz
        px, py, pz = px + abx, py + aby, pz + abz
    else:
        ex, ey, ez = -acx, -acy, -acz
    ux, uy, uz = ny * ez - nz * ey, nz * ex - nx * ez, nx * ey - ny * ex
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    if not length > 0.0:
        return 0.0, 0.0, 0.0, 0.0
    ux, uy, uz = ux / length, uy / length, uz / length
    return ux, uy, uz, ux * px + uy * py + uz * pz


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def _size2(corners: np.ndarray, k: int) -> float:
    """The squared length of triangle k's longer edge at its first corner."""
    ab = corners[k, 3] * corners[k, 3] + corners[k, 4] * corners[k, 4] + corners[k, 5] * corners[k, 5]
    ac = corners[k, 6] * corners[k, 6] + corners[k, 7] * corners[k, 7] + corners[k, 8] * corners[k, 8]
    return max(ab, ac)


@njit(cache=True, nogil=True)
def directed_bound(
    a: Surface, nearest: np.ndarray, b: Surface, lower2: float, floor2: float, slack2: float
) -> tuple[float, float]:
    """Bound the largest squared distance of any point of `a` to `b`.

    nearest (n,) int32: a triangle of `b` near each point of `a`. lower2: a known squared distance that the result need
    not undercut by refining; floor2: the same, without the slack. Returns the bound and the improved lower2.
    """
    corners, box, child = b.corners, b.box, b.child
    query = np.empty(128, np.int32)
    stack = np.empty((MAX_STACK, MAX_CORNERS, 3))
    sizes = np.empty(MAX_STACK, np.int32)
    hints = np.empty(MAX_STACK, np.int32)
    depths = np.empty(MAX_STACK, np.int32)
    polygon = np.empty((MAX_CORNERS, 3))
    rest = np.empty((MAX_CORNERS, 3))
    other = np.empty((MAX_CORNERS, 3))
    bound2 = 0.0
    enough2 = max(slack2 * lower2, floor2)
    effort = EFFORT * (len(a.triangles) + len(b.triangles)) + 1000
    last = 0
    for t in range(len(a.triangles)):
        # most triangles lie above a single one, and often above the one that the last triangle lay above
        accepted = False
        for attempt in range(4):
            if attempt == 0:
                k = last
            else:
                k = nearest[a.triangles[t, attempt - 1]]
                if k == last:
                    continue
            worst2 = 0.0
            for e in range(3):
                i = a.triangles[t, e]
                worst2 = max(worst2, distance2(corners, k, a.points[i, 0], a.points[i, 1], a.points[i, 2]))
                if worst2 > enough2:
                    break
            if worst2 <= enough2:
                bound2 = max(bound2, worst2)
                accepted = True
                last = k
                break
        if accepted:
            continue
        for e in range(3):
            for c in range(3):
                stack[0, e, c] = a.points[a.triangles[t, e], c]
        sizes[0] = 3
        hints[0] = nearest[a.triangles[t, 0]]
        depths[0] = 0
        top = 1
        while top > 0:
            top -= 1
            n = sizes[top]
            depth = depths[top]
            hint = hints[top]
            for i in range(n):
                for c in range(3):
                    polygon[i, c] = stack[top, i, c]
            here2, worst = _corner_bound(corners, hint, polygon, n)
            if here2 <= enough2:
                bound2 = max(bound2, here2)
                continue
            k, d2 = closest(
                corners, box, child, query, polygon[worst, 0], polygon[worst, 1], polygon[worst, 2], hint
            )
            if d2 > lower2:
                lower2 = d2
                enough2 = max(slack2 * lower2, floor2)
            if k != hint:
                there2, _ = _corner_bound(corners, k, polygon, n)
                here2 = min(here2, there2)
            if here2 <= enough2:
                bound2 = max(bound2, here2)
                last = k
                continue
            effort -= 1
            if effort < 0 or depth >= MAX_DEPTH or top + 5 > MAX_STACK:
                bound2 = max(bound2, here2)
                continue
            long2, p, q = _longest(polygon, n)
            parted = False
            if n <= MANY_CORNERS and long2 <= 6.0 * _size2(corners, k):
                for attempt in range(2):
                    face = k if attempt == 0 else hint
                    if attempt == 1 and k == hint:
                        break
                    for edge in range(3):
                        n_in, n_out = _cut(polygon, n, _edge_plane(corners, face, edge), rest, other)
                        if n_out == 0:
                            continue
                        if n_in == 0:
                            break
                        for i in range(n_out):
                            for c in range(3):
                                stack[top, i, c] = other[i, c]
                        sizes[top], hints[top], depths[top] = n_out, face, depth + 1
                        top += 1
                        n = n_in
                        for i in range(n):
                            for c in range(3):
                                polygon[i, c] = rest[i, c]
                        parted = True
                    if parted:
                        for i in range(n):
                            for c in range(3):
                                stack[top, i, c] = polygon[i, c]
                        sizes[top], hints[top], depths[top] = n, face, depth + 1
                        top += 1
                        break
            if parted:
                continue
            if not long2 > 0.0:
                bound2 = max(bound2, here2)
                continue
            length = np.sqrt(long2)
            x = (polygon[p, 0] - polygon[q, 0]) / length
            y = (polygon[p, 1] - polygon[q, 1]) / length
            z = (polygon[p, 2] - polygon[q, 2]) / length
            offset = (
                x * (polygon[p, 0] + polygon[q, 0])
                + y * (polygon[p, 1] + polygon[q, 1])
                + z * (polygon[p, 2] + polygon[q, 2])
            ) / 2.0
            n_in, n_out = _cut(polygon, n, (x, y, z, offset), rest, other)
            if n_in == 0 or n_out == 0:
                bound2 = max(bound2, here2)
                continue
            for i in range(n_in):
                for c in range(3):
                    stack[top, i, c] = rest[i, c]
            sizes[top], hints[top], depths[top] = n_in, k, depth + 1
            for i in range(n_out):
                for c in range(3):
                    stack[top + 1, i, c] = other[i, c]
            sizes[top + 1], hints[top + 1], depths[top + 1] = n_out, k, depth + 1
            top += 2
    return bound2, lower2


@njit(cache=True, nogil=True)
def hausdorff_bound(a: Surface, b: Surface, lower: float, floor: float, slack: float) -> tuple[float, float]:
    """An upper bound of the two-sided Hausdorff distance between two surfaces, and the lower bound that was found.

    The result is at most `slack` (> 1) times the true distance or `floor`, whichever is larger, unless the meshes are so
    hard that the effort ran out. `lower` is a distance known to be reached, 0 if none is.
    """
    near_a, squared_a = point_distances(a.points, b)
    near_b, squared_b = point_distances(b.points, a)
    lower2 = max(lower * lower, max(squared_a.max(), squared_b.max()))
    there2, lower2 = directed_bound(a, near_a, b, lower2, floor * floor, slack * slack)
    back2, lower2 = directed_bound(b, near_b, a, lower2, floor * floor, slack * slack)
    return np.sqrt(max(there2, back2)), np.sqrt(lower2)
