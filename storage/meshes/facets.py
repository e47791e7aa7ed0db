"""Facets: the triangles of closed meshes parted by direction, and the test that finds those that show only their backs.

    part_meshes(...)          the facets of some meshes, with a cone behind all triangles of each
    find_turned_away(...)     which facets of some drawables a view cell sees from behind, if at all

Whoever is behind all triangles of a facet sees none of their fronts, wherever in the cell: the facet is not drawn.
Facets and cones follow from the very positions that are drawn, and are made whenever these are read: whoever asks gets
the same ones, and a store holds nothing of them. Stored with each facet's triangles together, the meshes of a plant and
of offices took 29 % and 12 % more bytes, since strips of triangles end at the borders of facets.

Based on: J. Chhugani et al.: vLOD, IEEE TVCG 11(1), 2005, section 5.1 (hierarchical, normal cones against a cell),
after S. Kumar, D. Manocha, W. Garrett, M. Lin: Hierarchical back-face computation, 1999. The paper takes visibility
cones from the corners of a box around the triangles and halves the set where the test is inconclusive; here the sets
are parted beforehand, and a cone with an apex takes the place of normal cone and box: L. A. Shirman, S. S. Abi-Ezzi:
The Cone of Normals Technique for Fast Processing of Curved Patches, Eurographics 1993.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel, kernel
from storage.meshes.normals import area_normal

#: What one more facet must save on average, in triangles: it often costs a draw command. Cells count triangles by it,
#: so whoever changes it changes the format's number as well.
FACET_COST = 4.0
#: Normals whose components vary less than this (variance) are not parted further.
SAME_DIRECTION = 1e-4
#: Cones wider than this (cosine of the half angle) are of no use: few cells lie behind all of their triangles.
USELESS = 0.02
#: How much the sine of a cone's half angle is widened: far more than rounding in double precision, or in a picture.
WIDENED = 1e-6
#: How much farther back cones begin, in steps of the mesh's positions: far more than rounding in double precision.
SET_BACK = 1e-3
#: Placed positions are rounded to the grid, and drawn in single precision: they are off by at most so many steps of the
#: grid, half its diagonal, ...
SNAPPED = 0.8661
#: ... and by this part of their coordinates, for a rounded matrix, products and sums, times the matrix' condition.
DRAWN = 2.0**-21
#: A triangle's unit normal turns by at most this many times its vertices' displacement over its least height.
TURNS = 5.0

#: Columns of a cone: apex (3), axis (3), sine of the half angle, 1 / least height of a triangle, and the distance of
#: the apex from the farthest vertex. Lengths in steps of the mesh's positions.
CONE = 9


@kernel()
def _normal(points: NDArray[np.int32], triangles: NDArray[np.uint32], t: int) -> tuple[float, float, float, float]:
    """Unit normal (three numbers) and twice the area of a triangle; zeros where it has none.

    Differences of coordinates are below 2^25, their products' differences below 2^51: exact.
    """
    x, y, z = area_normal(points, triangles, t)
    area = np.sqrt((x * x + y * y) + z * z)
    if area == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    return x / area, y / area, z / area, area


@kernel()
def _narrowest(
    normals: NDArray[np.float64], order: NDArray[np.int64], first: int, end: int
) -> tuple[float, float, float, float]:
    """A unit axis (three numbers) and the least cosine between it and the normals order[first:end] that are not zero.

    The better one of the normals' mean and the middle of their box; cosine 0 where neither is of use.
    """
    best_x, best_y, best_z, best = 0.0, 0.0, 1.0, 0.0
    for attempt in range(2):
        x = y = z = 0.0
        if attempt == 0:
            for i in range(first, end):
                t = order[i]
                x, y, z = x + normals[t, 0], y + normals[t, 1], z + normals[t, 2]
        else:
            low_x = low_y = low_z = 1.0
            high_x = high_y = high_z = -1.0
            for i in range(first, end):
                t = order[i]
                low_x, high_x = min(low_x, normals[t, 0]), max(high_x, normals[t, 0])
                low_y, high_y = min(low_y, normals[t, 1]), max(high_y, normals[t, 1])
                low_z, high_z = min(low_z, normals[t, 2]), max(high_z, normals[t, 2])
            x, y, z = low_x + high_x, low_y + high_y, low_z + high_z
        length = np.sqrt((x * x + y * y) + z * z)
        if not length > 1e-6:
            continue
        x, y, z = x / length, y / length, z / length
        least = 1.0
        for i in range(first, end):
            t = order[i]
            if normals[t, 0] != 0.0 or normals[t, 1] != 0.0 or normals[t, 2] != 0.0:
                least = min(least, (normals[t, 0] * x + normals[t, 1] * y) + normals[t, 2] * z)
        if least > best:
            best_x, best_y, best_z, best = x, y, z, least
    return best_x, best_y, best_z, best


@allocating_kernel()
def _part(points: NDArray[np.int32], triangles: NDArray[np.uint32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """An order (m,) of triangles (m, 3), and the numbers of triangles (f,) of the facets that follow each other in it.

    Sets are halved at the mean of the component in which their normals vary most. Then, from the smallest sets up,
    halves stay apart where that saves more than FACET_COST: seen from afar in a random direction, a facet of k normals
    within a half angle a shows only backs with a chance of (1 - sin a) / 2, and so saves k times that. Similar facets
    follow each other, and triangles keep their order within them. One facet, maybe empty, is the least.
    """
    m = len(triangles)
    normals = np.zeros((m, 3))
    for t in range(m):
        normals[t, 0], normals[t, 1], normals[t, 2], _ = _normal(points, triangles, t)
    order = np.arange(m)
    aside = np.empty(m, np.int64)
    sets = np.zeros((2 * m + 1, 3), np.int64)  # first, end, and the first of its two halves (0: it is not halved)
    saved = np.zeros(2 * m + 1)
    sets[0, 1] = m
    found = 1
    at = 0
    while at < found:
        first, end = sets[at, 0], sets[at, 1]
        count = end - first
        cosine = _narrowest(normals, order, first, end)[3]
        if cosine > USELESS:
            saved[at] = count * 0.5 * (1.0 - np.sqrt(max(0.0, 1.0 - cosine * cosine)))
        # the best that two facets can save, half of all triangles, must be worth one facet more
        if 0.5 * count - FACET_COST > saved[at]:
            widest, cut, which = SAME_DIRECTION, 0.0, -1
            for k in range(3):
                total = squares = 0.0
                for i in range(first, end):
                    total += normals[order[i], k]
                    squares += normals[order[i], k] * normals[order[i], k]
                mean = total / count
                if squares / count - mean * mean > widest:
                    widest, cut, which = squares / count - mean * mean, mean, k
            if which >= 0:
                below = first
                above = 0
                for i in range(first, end):
                    if normals[order[i], which] > cut:
                        aside[above] = order[i]
                        above += 1
                    else:
                        order[below] = order[i]
                        below += 1
                order[below:end] = aside[:above]
                sets[at, 2] = found
                sets[found, 0], sets[found, 1] = first, below
                sets[found + 1, 0], sets[found + 1, 1] = below, end
                found += 2
        at += 1
    for at in range(found - 1, -1, -1):
        half = sets[at, 2]
        if half > 0:
            apart = saved[half] + saved[half + 1] - FACET_COST
            if apart > saved[at]:
                saved[at] = apart
            else:
                sets[at, 2] = 0
    facets = np.empty(found, np.int64)
    waiting = np.empty(found, np.int64)
    waiting[0] = 0
    held, count = 1, 0
    while held > 0:
        held -= 1
        at = waiting[held]
        if sets[at, 2] > 0:
            waiting[held], waiting[held + 1] = sets[at, 2] + 1, sets[at, 2]
            held += 2
        else:
            facets[count] = sets[at, 1] - sets[at, 0]
            count += 1
    return order, facets[:count].copy()


@allocating_kernel()
def _cones(
    points: NDArray[np.int32], triangles: NDArray[np.uint32], order: NDArray[np.int64], facets: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Cones (f, CONE) of facets that take `facets` (f,) of the triangles (m, 3) each, in the order (m,).

    A facet's normals lie within the half angle a of the cone's axis, and the apex on or behind the planes of all its
    triangles. The sine is 2, which no test passes, where the normals spread too far. Triangles without area, which
    nobody sees, do not count.
    """
    cones = np.zeros((len(facets), CONE))
    normals = np.zeros((len(triangles), 3))
    end = 0
    for f in range(len(facets)):
        first, end = end, end + facets[f]
        thin = 0.0
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for i in range(first, end):
            t = order[i]
            normals[t, 0], normals[t, 1], normals[t, 2], area = _normal(points, triangles, t)
            if area == 0.0:
                continue
            longest = 0.0
            for e in range(3):
                a, b = triangles[t, e], triangles[t, (e + 1) % 3]
                square = 0.0
                for k in range(3):
                    low[k], high[k] = min(low[k], points[a, k]), max(high[k], points[a, k])
                    step = np.float64(points[b, k]) - np.float64(points[a, k])
                    square += step * step
                longest = max(longest, square)
            thin = max(thin, np.sqrt(longest) / area)
        x, y, z, cosine = _narrowest(normals, order, first, end)
        cones[f, 3], cones[f, 4], cones[f, 5], cones[f, 6] = x, y, z, 2.0
        if not (cosine > USELESS and thin > 0.0):
            continue
        back = 0.0
        for i in range(first, end):
            t = order[i]
            across = (normals[t, 0] * x + normals[t, 1] * y) + normals[t, 2] * z
            if across > 0.0:
                v = triangles[t, 0]
                ahead = 0.0
                for k in range(3):
                    ahead += normals[t, k] * (0.5 * (low[k] + high[k]) - points[v, k])
                back = max(back, ahead / across)
        square = 0.0
        for k in range(3):
            cones[f, k] = 0.5 * (low[k] + high[k]) - back * cones[f, 3 + k]
            away = max(high[k] - cones[f, k], cones[f, k] - low[k])
            square += away * away
        cones[f, 6] = np.sqrt(max(0.0, 1.0 - cosine * cosine))
        cones[f, 7], cones[f, 8] = thin, np.sqrt(square)
    return cones


@allocating_kernel()
def part_meshes(
    points: NDArray[np.int32],
    triangles: NDArray[np.uint32],
    vertex_counts: NDArray[np.int64],
    triangle_counts: NDArray[np.int64],
    one_sided: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """The facets of meshes that lie one after the other.

    Args:
        points (n, 3): positions, within +-2^23 steps; triangles (m, 3): counting vertices from their mesh's first.
        vertex_counts, triangle_counts (k,): of each mesh.
        one_sided (k,): only the fronts of the mesh count. Other meshes are one facet, which is never turned away.

    Returns:
        An order (m,) of the triangles, in which meshes stay where they are and the triangles of a facet follow each
        other; how many facets each mesh has (k,), one or more; the triangles of each facet (f,); its cone (f, CONE).
    """
    order = np.arange(len(triangles))
    counts = np.ones(len(one_sided), np.int64)
    # each facet but one a mesh saves more than FACET_COST, all together at most half of the triangles
    facets = np.zeros(int(0.5 * len(triangles) / FACET_COST) + len(one_sided), np.int64)
    cones = np.zeros((len(facets), CONE))
    found = vertex = triangle = 0
    for mesh in range(len(one_sided)):
        last_vertex, last = vertex + vertex_counts[mesh], triangle + triangle_counts[mesh]
        if one_sided[mesh]:
            own_points, own = points[vertex:last_vertex], triangles[triangle:last]
            parted, sizes = _part(own_points, own)
            counts[mesh] = len(sizes)
            facets[found : found + len(sizes)] = sizes
            cones[found : found + len(sizes)] = _cones(own_points, own, parted, sizes)
            for t in range(len(parted)):
                order[triangle + t] = triangle + parted[t]
        else:
            facets[found] = last - triangle
            cones[found, 6] = 2.0
        found += counts[mesh]
        vertex, triangle = last_vertex, last
    return order, counts, facets[:found].copy(), cones[:found].copy()


@kernel()
def is_turned_away(cone: NDArray[np.float64], corners: NDArray[np.float64], slack: float, drawn: float) -> bool:
    """Whether nobody in the hull of `corners` (8, 3) sees a front of a facet whose cone (CONE,) is given.

    Everything in steps of the mesh's positions. The mesh's vertices may lie off by `slack`, and by `drawn` times their
    coordinates.

    *Why it is right.* Let n be the unit normal of one of the facet's triangles, a the cone's axis and s the sine of its
    half angle, x a point of the triangle, v the apex, q a corner, w = v - q. By the definition of the apex
    n·(x - q) >= n·(v - q) = n·w. The test says w·a > |w| (s + e) + d. So w lies at an angle of b above the plane at
    right angles to a with sin b > s + e + d / |w|; n is at most the half angle, h, away from a, and therefore
    n·w >= |w| sin(b - h). For angles h < b up to a right angle sin(b - h) >= sin b - sin h, and so
    n·(x - q) > |w| e + d >= 0: q is strictly behind the triangle. What is strictly behind a plane is convex: with all
    eight corners the whole cell is.

    *Displaced vertices.* Let each vertex be off by at most o. Twice the triangle's area is its longest edge l times its
    least height h; the cross product of two edges changes by at most 4 o l + 4 o^2, that is by 4 (o / h)(1 + o / l) of
    itself, and with o / h <= 1/20 the unit normal n' differs from n by less than TURNS o / h =: e; where o / h is more,
    fronts are taken to be seen. Then n'·(x' - q) >= n·(x - q) - o - e |x' - q|, which is more than
    |w| e + d - o - e (|w| + r + o) = 0 with d = o + e (r + o), where r is the distance of the apex from the farthest
    vertex.

    WIDENED and SET_BACK come on top, for rounding here and in pictures.
    """
    sine, radius = cone[6], cone[8]
    if sine > 1.0:
        return False
    offset = slack + drawn * (radius + (abs(cone[0]) + abs(cone[1]) + abs(cone[2])))
    turn = TURNS * offset * cone[7]
    if turn > 0.25:
        return False
    sine += turn + WIDENED
    behind = offset + turn * (radius + offset) + SET_BACK
    for i in range(8):
        x, y, z = cone[0] - corners[i, 0], cone[1] - corners[i, 1], cone[2] - corners[i, 2]
        along = (x * cone[3] + y * cone[4]) + z * cone[5]
        if not along > np.sqrt((x * x + y * y) + z * z) * sine + behind:
            return False
    return True


@kernel()
def local_corners(
    matrix: NDArray[np.float64], scale: float, lo: NDArray[np.float64], hi: NDArray[np.float64],
    corners: NDArray[np.float64],
) -> float:  # fmt: skip
    """Fills corners (8, 3) with those of the box lo ... hi (3,), in steps of a mesh that `matrix` (3, 4) places.

    A step is `scale` local units. Fronts stay fronts: placing a mesh keeps who is behind which plane, and the corners
    of what is mirrored are turned round. Returns an upper bound of the steps that one unit of model space is; infinite
    where the matrix flattens the mesh.
    """
    ax, ay, az = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    bx, by, bz = matrix[1, 0], matrix[1, 1], matrix[1, 2]
    cx, cy, cz = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    # columns of the adjugate: cross products of the rows
    px, py, pz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    qx, qy, qz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    rx, ry, rz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    determinant = (ax * px + ay * py) + az * pz
    if determinant == 0.0:
        return np.inf
    factor = 1.0 / (determinant * scale)
    for i in range(8):
        x = (hi[0] if i & 1 else lo[0]) - matrix[0, 3]
        y = (hi[1] if i & 2 else lo[1]) - matrix[1, 3]
        z = (hi[2] if i & 4 else lo[2]) - matrix[2, 3]
        corners[i, 0] = ((px * x + qx * y) + rx * z) * factor
        corners[i, 1] = ((py * x + qy * y) + ry * z) * factor
        corners[i, 2] = ((pz * x + qz * y) + rz * z) * factor
    squares = (px * px + py * py + pz * pz) + (qx * qx + qy * qy + qz * qz) + (rx * rx + ry * ry + rz * rz)
    steps: float = np.sqrt(squares) * abs(factor)
    return steps


@kernel()
def _size(matrix: NDArray[np.float64]) -> float:
    """An upper bound of the factor by which a placement (3, 4) lengthens."""
    squares = 0.0
    for i in range(3):
        for j in range(3):
            squares += matrix[i, j] * matrix[i, j]
    size: float = np.sqrt(squares)
    return size


@allocating_kernel()
def find_turned_away(
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    instance: NDArray[np.int64],
    scale: NDArray[np.float64],
    cones: NDArray[np.float64],
    matrices: NDArray[np.float64],
    step: float,
    lo: NDArray[np.float64],
    hi: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Which facets of some drawables show nothing but backs to a whole cell, as stored and as drawn.

    Args:
        first, count (d,): each drawable's facets are rows first ... first + count - 1 of `cones` (f, CONE).
        instance (d,): row of `matrices`, -1 where it lies in model space.
        scale (d,): local units per step of its mesh's positions; matrices (n, 3, 4): placements of instances.
        step: model units per grid unit; lo, hi (3,): the cell in model units, lo <= hi.

    Returns:
        (sum of count,) bool, one drawable after the other.
    """
    away = np.zeros(count.sum(), np.bool_)
    corners = np.empty((8, 3))
    here = np.zeros((3, 4))
    here[0, 0] = here[1, 1] = here[2, 2] = 1.0
    at = 0
    for d in range(len(first)):
        placed = instance[d] >= 0
        steps = local_corners(matrices[instance[d]] if placed else here, scale[d], lo, hi, corners)
        if steps < np.inf:
            slack = drawn = 0.0
            if placed:
                slack = SNAPPED * step * steps
                drawn = DRAWN * _size(matrices[instance[d]]) * scale[d] * steps
            for f in range(count[d]):
                away[at + f] = is_turned_away(cones[first[d] + f], corners, slack, drawn)
        at += count[d]
    return away
