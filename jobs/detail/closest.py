"""The closest triangle to a point: a bounding volume hierarchy over one piece's triangles.

Every distance given out is the distance to a point that lies on the triangle, so it is an upper bound of the true
distance whatever rounding did to the choice of that point; that is what the certified error rests on.

Based on: Christer Ericson, Real-Time Collision Detection, 2005, section 5.1.5 (closest point on a triangle).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.objects.weld import twins
from storage.kernels import allocating_kernel, kernel

#: A triangle whose squared sine between two edges is below this is a needle: rounding spoils its inside.
NEEDLE = 1e-10
#: How much farther from a triangle's inside a point may be than from its edges' inner sides: see `prisms`.
SLIM = 200.0
#: Triangles in a leaf of the hierarchy.
LEAF = 4


class Surface(NamedTuple):
    """A piece's triangles in an order that is coherent in space, ready for closest-triangle queries."""

    points: np.ndarray  # (n, 3) float64
    triangles: np.ndarray  # (m, 3) int32
    source: np.ndarray  # (m,) int32: index of the triangle in the order in which it was given
    twin: np.ndarray  # (3 m,) int32: the half-edge on the other side of each, negative where there is not just one
    corners: np.ndarray  # (m, 9) float64: first corner, and the edges from it to the second and the third
    planes: np.ndarray  # (m, 4, 4) float64: the planes of the triangle's prism, see `prisms`
    box: np.ndarray  # (k, 6) float64: lo, hi of each node, the root first
    child: np.ndarray  # (k, 2) int32: the right child (the left one is the next node) and 0; or first triangle, count


@kernel()
def closest_on_edges(
    abx: float, aby: float, abz: float, acx: float, acy: float, acz: float, apx: float, apy: float, apz: float
) -> tuple[float, float, float]:
    """`closest_weights` for a triangle that is hardly more than its three edges, given as vectors from its corner."""
    best, best_v, best_w = np.inf, 0.0, 0.0
    for edge in range(3):
        if edge == 0:
            length2, along = abx * abx + aby * aby + abz * abz, abx * apx + aby * apy + abz * apz
        elif edge == 1:
            length2, along = acx * acx + acy * acy + acz * acz, acx * apx + acy * apy + acz * apz
        else:
            ex, ey, ez = acx - abx, acy - aby, acz - abz
            length2, along = ex * ex + ey * ey + ez * ez, ex * (apx - abx) + ey * (apy - aby) + ez * (apz - abz)
        s = min(max(along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
        v = s if edge == 0 else (1.0 - s if edge == 2 else 0.0)
        w = 0.0 if edge == 0 else s
        dx = apx - v * abx - w * acx
        dy = apy - v * aby - w * acy
        dz = apz - v * abz - w * acz
        d2 = dx * dx + dy * dy + dz * dz
        if d2 < best:
            best, best_v, best_w = d2, v, w
    return best, best_v, best_w


@kernel()
def closest_weights(corners: np.ndarray, k: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Squared distance of a point to triangle k of corners (m, 9) and the weights of its second and third corner.

    The weights are clamped, so they name a point of the triangle even where the triangle is a needle or has no area.
    """
    abx, aby, abz = corners[k, 3], corners[k, 4], corners[k, 5]
    acx, acy, acz = corners[k, 6], corners[k, 7], corners[k, 8]
    apx, apy, apz = x - corners[k, 0], y - corners[k, 1], z - corners[k, 2]
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    v = 0.0
    w = 0.0
    if d1 > 0.0 or d2 > 0.0:
        bpx, bpy, bpz = apx - abx, apy - aby, apz - abz
        d3 = abx * bpx + aby * bpy + abz * bpz
        d4 = acx * bpx + acy * bpy + acz * bpz
        cpx, cpy, cpz = apx - acx, apy - acy, apz - acz
        d5 = abx * cpx + aby * cpy + abz * cpz
        d6 = acx * cpx + acy * cpy + acz * cpz
        va = d3 * d6 - d5 * d4
        vb = d5 * d2 - d1 * d6
        vc = d1 * d4 - d3 * d2
        if d3 >= 0.0 and d4 <= d3:
            v = 1.0
        elif d6 >= 0.0 and d5 <= d6:
            w = 1.0
        elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
            v = d1 / (d1 - d3) if d1 > d3 else 0.0
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
            w = d2 / (d2 - d6) if d2 > d6 else 0.0
        elif va <= 0.0 and d4 >= d3 and d5 >= d6:
            w = (d4 - d3) / ((d4 - d3) + (d5 - d6)) if d4 - d3 + d5 - d6 > 0.0 else 0.0
            v = 1.0 - w
        else:
            total = va + vb + vc
            if total > NEEDLE * (d1 - d3) * (d2 - d6):
                v = min(max(vb / total, 0.0), 1.0)
                w = min(max(vc / total, 0.0), 1.0 - v)
            else:
                return closest_on_edges(abx, aby, abz, acx, acy, acz, apx, apy, apz)
    dx = apx - v * abx - w * acx
    dy = apy - v * aby - w * acy
    dz = apz - v * abz - w * acz
    return dx * dx + dy * dy + dz * dz, v, w


@kernel()
def distance2(corners: np.ndarray, k: int, x: float, y: float, z: float) -> float:
    """Squared distance of a point to triangle k of corners (m, 9)."""
    return closest_weights(corners, k, x, y, z)[0]


@kernel()
def box_distance2(box: np.ndarray, node: int, x: float, y: float, z: float) -> float:
    """Squared distance of a point to a node's box."""
    dx = max(box[node, 0] - x, x - box[node, 3], 0.0)
    dy = max(box[node, 1] - y, y - box[node, 4], 0.0)
    dz = max(box[node, 2] - z, z - box[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel()
def closest(
    corners: np.ndarray,
    box: np.ndarray,
    child: np.ndarray,
    stack: np.ndarray,
    x: float,
    y: float,
    z: float,
    hint: int,
    enough2: float,
) -> tuple[int, float]:
    """The closest triangle and its squared distance; `hint` is a triangle that may be near, `stack` (128,) int32.

    The first one found that is within the squared distance enough2 will do as well; 0 where it must be the closest.
    """
    best = hint
    best2 = distance2(corners, hint, x, y, z)
    top = 0
    node = 0
    if best2 <= enough2 or box_distance2(box, 0, x, y, z) >= best2:
        return best, best2
    while True:
        count = child[node, 1]
        if count > 0:
            first = child[node, 0]
            for k in range(first, first + count):
                d2 = distance2(corners, k, x, y, z)
                if d2 < best2:
                    best2 = d2
                    best = k
            if best2 <= enough2:
                return best, best2
        else:
            left, right = node + 1, child[node, 0]
            dl = box_distance2(box, left, x, y, z)
            dr = box_distance2(box, right, x, y, z)
            if dr < dl:
                left, right = right, left
                dl, dr = dr, dl
            if dl < best2:
                if dr < best2:
                    stack[top] = right
                    top += 1
                node = left
                continue
        node = -1
        while top > 0 and node < 0:
            top -= 1
            if box_distance2(box, stack[top], x, y, z) < best2:
                node = stack[top]
        if node < 0:
            return best, best2


@allocating_kernel()
def partition_by(key: np.ndarray, order: np.ndarray, first: int, last: int, middle: int) -> None:
    """Quickselect: reorder order[first:last] so that keys before `middle` are not above those from `middle` on."""
    last -= 1
    while first < last:
        pivot = key[order[(first + last) // 2]]
        i, j = first, last
        while i <= j:
            while key[order[i]] < pivot:
                i += 1
            while key[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            return


@allocating_kernel()
def prisms(corners: np.ndarray) -> np.ndarray:
    """Planes (m, 4, 4), unit normal and offset each, of triangles with corners (m, 9).

    The first three go through the edges at right angles to the triangle and face inward; all zero for a triangle
    without area. The last is the triangle's own; all zero also for slim triangles: for others, a point within d of the
    inner side of the first three is within SLIM d of a point above the triangle.
    """
    planes = np.zeros((len(corners), 4, 4))
    for k in range(len(corners)):
        abx, aby, abz = corners[k, 3], corners[k, 4], corners[k, 5]
        acx, acy, acz = corners[k, 6], corners[k, 7], corners[k, 8]
        nx, ny, nz = aby * acz - abz * acy, abz * acx - abx * acz, abx * acy - aby * acx
        longest2 = 0.0
        for edge in range(3):
            px, py, pz = corners[k, 0], corners[k, 1], corners[k, 2]
            ex, ey, ez = abx, aby, abz
            if edge == 1:
                ex, ey, ez = acx - abx, acy - aby, acz - abz
                px, py, pz = px + abx, py + aby, pz + abz
            elif edge == 2:
                ex, ey, ez = -acx, -acy, -acz
            longest2 = max(longest2, ex * ex + ey * ey + ez * ez)
            ux, uy, uz = ny * ez - nz * ey, nz * ex - nx * ez, nx * ey - ny * ex
            length = np.sqrt(ux * ux + uy * uy + uz * uz)
            if length > 0.0:
                ux, uy, uz = ux / length, uy / length, uz / length
                planes[k, edge, 0], planes[k, edge, 1], planes[k, edge, 2] = ux, uy, uz
                planes[k, edge, 3] = ux * px + uy * py + uz * pz
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if length * SLIM > 4.0 * longest2:
            nx, ny, nz = nx / length, ny / length, nz / length
            planes[k, 3, 0], planes[k, 3, 1], planes[k, 3, 2] = nx, ny, nz
            planes[k, 3, 3] = nx * corners[k, 0] + ny * corners[k, 1] + nz * corners[k, 2]
    return planes


@allocating_kernel()
def make_surface(points: np.ndarray, triangles: np.ndarray) -> Surface:
    """The hierarchy over triangles (m, 3) int32, m > 0, with vertices points (n, 3) float64: median splits."""
    m = len(triangles)
    centre = np.empty((3, m))
    for t in range(m):
        for i in range(3):
            centre[i, t] = points[triangles[t, 0], i] + points[triangles[t, 1], i] + points[triangles[t, 2], i]
    order = np.arange(m).astype(np.int32)
    box = np.empty((2 * m, 6))
    child = np.zeros((2 * m, 2), np.int32)
    todo = np.empty((128, 3), np.int32)  # first, last, the node whose right child this is
    todo[0, 0], todo[0, 1], todo[0, 2] = 0, m, -1
    top = 1
    nodes = 0
    while top > 0:
        top -= 1
        first, last, above = todo[top, 0], todo[top, 1], todo[top, 2]
        node = nodes
        nodes += 1
        if above >= 0:
            child[above, 0] = node
        for i in range(3):
            box[node, i] = np.inf
            box[node, 3 + i] = -np.inf
        for s in range(first, last):
            t = order[s]
            for e in range(3):
                for i in range(3):
                    p = points[triangles[t, e], i]
                    box[node, i] = min(box[node, i], p)
                    box[node, 3 + i] = max(box[node, 3 + i], p)
        if last - first <= LEAF:
            child[node, 0], child[node, 1] = first, last - first
            continue
        axis = 0
        widest = -1.0
        for i in range(3):
            low, high = np.inf, -np.inf
            for s in range(first, last):
                low = min(low, centre[i, order[s]])
                high = max(high, centre[i, order[s]])
            if high - low > widest:
                widest = high - low
                axis = i
        middle = (first + last) // 2
        partition_by(centre[axis], order, first, last, middle)
        todo[top, 0], todo[top, 1], todo[top, 2] = middle, last, node
        todo[top + 1, 0], todo[top + 1, 1], todo[top + 1, 2] = first, middle, -1
        top += 2
    ordered = np.empty((m, 3), np.int32)
    corners = np.empty((m, 9))
    for s in range(m):
        t = order[s]
        for e in range(3):
            ordered[s, e] = triangles[t, e]
        for i in range(3):
            a = points[triangles[t, 0], i]
            corners[s, i] = a
            corners[s, 3 + i] = points[triangles[t, 1], i] - a
            corners[s, 6 + i] = points[triangles[t, 2], i] - a
    return Surface(
        points, ordered, order, twins(ordered), corners, prisms(corners), box[:nodes].copy(), child[:nodes].copy()
    )
