"""The closest triangle to a point: a bounding volume hierarchy over one piece's triangles.

Distances are measured in a frame of the triangle's own, where it lies in a plane, without branches and divisions.
Frames are right to FLAT of the triangle's size, however thin it is (see `frames`), and distances to that and a few
2^-52 of how far the point is from the triangle's corners.

Based on: M. W. Jones, 3D Distance from a Point to a Triangle, University of Wales Swansea CSR-5-95, 1995 (in the
triangle's plane); Christer Ericson, Real-Time Collision Detection, 2005, section 5.1.5 (closest point on a triangle).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from storage.base.kernels import allocating_kernel, kernel

#: A triangle whose squared sine between two edges is below this is a needle: rounding spoils its inside.
NEEDLE = 1e-10
#: How much farther from a triangle's inside a point may be than from its edges' inner sides: see `prisms`.
SLIM = 200.0
#: Triangles in a leaf of the hierarchy.
LEAF = 8
#: A triangle's corner that is no farther than this part of the triangle's size from its longest edge lies on it.
FLAT = 2.0**-45
#: Numbers of a triangle's frame.
FRAME = 20


class Tree(NamedTuple):
    """A hierarchy of boxes over a surface's triangles."""

    frames: np.ndarray  # (m, FRAME) float64: what distances to triangles are measured by, see `frames`
    box: np.ndarray  # (k, 6) float64: lo, hi of each node, the root first
    child: np.ndarray  # (k, 2) int32: the right child (the left one is the next node) and 0; or first triangle, count


class Surface(NamedTuple):
    """A piece's triangles in an order that is coherent in space, ready for closest-triangle queries."""

    points: np.ndarray  # (n, 3) float64
    triangles: np.ndarray  # (m, 3) int32
    source: np.ndarray  # (m,) int32: index of the triangle in the order in which it was given
    twin: np.ndarray  # (3 m,) int32: the half-edge on the other side of each, negative where there is not just one
    corners: np.ndarray  # (m, 9) float64: first corner, and the edges from it to the second and the third
    planes: np.ndarray  # (m, 4, 4) float64: the planes of the triangle's prism, see `prisms`
    tree: Tree


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


@kernel(inline="always")
def _from_edge2(u: float, v: float, fu: float, fv: float, length: float) -> float:
    """Squared distance in the plane of (u, v) to an edge from the origin along the unit vector (fu, fv)."""
    s = u * fu + v * fv
    s = s if s > 0.0 else 0.0
    s = s if s < length else length
    du, dv = u - s * fu, v - s * fv
    return du * du + dv * dv


@kernel(inline="always")
def distance2(frames: np.ndarray, k: int, x: float, y: float, z: float) -> float:
    """Squared distance of a point to triangle k of frames (m, FRAME)."""
    x, y, z = x - frames[k, 0], y - frames[k, 1], z - frames[k, 2]
    height = x * frames[k, 3] + y * frames[k, 4] + z * frames[k, 5]
    u = x * frames[k, 6] + y * frames[k, 7] + z * frames[k, 8]
    v = x * frames[k, 9] + y * frames[k, 10] + z * frames[k, 11]
    base = frames[k, 12]
    best2 = _from_edge2(u, v, 1.0, 0.0, base)
    fu, fv = frames[k, 13], frames[k, 14]
    inside = (v > 0.0) & (fu * v < fv * u)
    d2 = _from_edge2(u, v, fu, fv, frames[k, 15])
    best2 = best2 if best2 < d2 else d2
    u -= base
    fu, fv = frames[k, 16], frames[k, 17]
    inside &= fu * v > fv * u
    d2 = _from_edge2(u, v, fu, fv, frames[k, 18])
    best2 = best2 if best2 < d2 else d2
    best2 = 0.0 if inside else best2
    return best2 + height * height


@kernel()
def box_distance2(box: np.ndarray, node: int, x: float, y: float, z: float) -> float:
    """Squared distance of a point to a node's box."""
    lx, ly, lz = box[node, 0] - x, box[node, 1] - y, box[node, 2] - z
    hx, hy, hz = x - box[node, 3], y - box[node, 4], z - box[node, 5]
    dx = lx if lx > hx else hx
    dy = ly if ly > hy else hy
    dz = lz if lz > hz else hz
    dx = dx if dx > 0.0 else 0.0
    dy = dy if dy > 0.0 else 0.0
    dz = dz if dz > 0.0 else 0.0
    return dx * dx + dy * dy + dz * dz


@kernel()
def closest(
    tree: Tree, stack: np.ndarray, x: float, y: float, z: float, hint: int, enough2: float
) -> tuple[int, float]:
    """The closest triangle and its squared distance; `hint` is a triangle that may be near, `stack` (128,) int32.

    The first one found that is within the squared distance enough2 will do as well; 0 where it must be the closest.
    """
    frames, box, child = tree.frames, tree.box, tree.child
    best = hint
    best2 = distance2(frames, hint, x, y, z)
    top = 0
    node = 0
    if best2 <= enough2 or box_distance2(box, 0, x, y, z) >= best2:
        return best, best2
    while True:
        count = child[node, 1]
        if count > 0:
            first = child[node, 0]
            for k in range(first, first + count):
                d2 = distance2(frames, k, x, y, z)
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
def frames(corners: np.ndarray) -> np.ndarray:
    """Frames (m, FRAME) of triangles with corners (m, 9): how `distance2` sees them.

    The longest edge goes from the origin to (base, 0) in the plane, the third corner is above it. A row has: the corner
    at the origin; unit vectors across the plane, along the longest edge, and away from it; base; and for each of the
    other two edges, from the origin and from (base, 0) on, its direction and its length.

    The vector away from the longest edge is what the third corner has beside that edge. Rounding spoils it by a few
    2^-52 of the triangle's size, in all directions; it is made square to the edge once more, which takes no more than
    that from the corner. Where it is not much longer than that, any vector square to the edge will do, and the corner
    counts as on the edge. So the third corner is where the frame says, to FLAT of the triangle's size.
    """
    made = np.zeros((len(corners), FRAME))
    for k in range(len(corners)):
        ax, ay, az = corners[k, 0], corners[k, 1], corners[k, 2]
        ex, ey, ez = corners[k, 3], corners[k, 4], corners[k, 5]
        fx, fy, fz = corners[k, 6], corners[k, 7], corners[k, 8]
        ee, ff = ex * ex + ey * ey + ez * ez, fx * fx + fy * fy + fz * fz
        gg = (fx - ex) ** 2 + (fy - ey) ** 2 + (fz - ez) ** 2
        if gg > ee and gg > ff:  # from the second corner to the third
            ax, ay, az = ax + ex, ay + ey, az + ez
            ex, ey, ez, fx, fy, fz = fx - ex, fy - ey, fz - ez, -ex, -ey, -ez
        elif ff > ee:
            ex, ey, ez, fx, fy, fz = fx, fy, fz, ex, ey, ez
        base = np.sqrt(ex * ex + ey * ey + ez * ez)
        ux, uy, uz = (ex / base, ey / base, ez / base) if base > 0.0 else (1.0, 0.0, 0.0)
        along = fx * ux + fy * uy + fz * uz
        vx, vy, vz = fx - along * ux, fy - along * uy, fz - along * uz
        length = np.sqrt(vx * vx + vy * vy + vz * vz)
        flat = length <= FLAT * (abs(fx) + abs(fy) + abs(fz))
        if flat:
            vx, vy, vz = (0.0, 1.0, 0.0) if abs(ux) > abs(uy) else (1.0, 0.0, 0.0)
            length = 1.0
        for _ in range(2):
            vx, vy, vz = vx / length, vy / length, vz / length
            off = vx * ux + vy * uy + vz * uz
            vx, vy, vz = vx - off * ux, vy - off * uy, vz - off * uz
            length = np.sqrt(vx * vx + vy * vy + vz * vz)
        vx, vy, vz = vx / length, vy / length, vz / length
        cu, cv = along, 0.0 if flat else fx * vx + fy * vy + fz * vz
        row = made[k]
        row[0], row[1], row[2] = ax, ay, az
        row[3], row[4], row[5] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        row[6], row[7], row[8] = ux, uy, uz
        row[9], row[10], row[11] = vx, vy, vz
        row[12] = base
        for at in (13, 16):
            length = np.sqrt(cu * cu + cv * cv)
            if length > 0.0:
                row[at], row[at + 1], row[at + 2] = cu / length, cv / length, length
            cu -= base
    return made


@allocating_kernel()
def make_surface(points: np.ndarray, triangles: np.ndarray, twin: np.ndarray) -> Surface:
    """The hierarchy over triangles (m, 3) int32, m > 0, with vertices points (n, 3) float64: median splits.

    twin (3 m,) int32: see `jobs.objects.weld.twins`.
    """
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
    for node in range(nodes - 1, -1, -1):  # what is below a node comes after it
        first, count = child[node, 0], child[node, 1]
        for i in range(3):
            low, high = np.inf, -np.inf
            if count > 0:
                for s in range(first, first + count):
                    for e in range(3):
                        p = points[ordered[s, e], i]
                        low = min(low, p)
                        high = max(high, p)
            else:
                low = min(box[node + 1, i], box[first, i])
                high = max(box[node + 1, 3 + i], box[first, 3 + i])
            box[node, i], box[node, 3 + i] = low, high
    tree = Tree(frames(corners), box[:nodes].copy(), child[:nodes].copy())
    return Surface(points, ordered, order, _moved(twin, order), corners, prisms(corners), tree)


@allocating_kernel()
def _moved(twin: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Twins (3 m,) int32 of the half-edges of triangles that come in another order (m,) int32."""
    m = len(order)
    where = np.empty(m, np.int32)
    for s in range(m):
        where[order[s]] = s
    moved = np.empty(3 * m, np.int32)
    for s in range(m):
        for e in range(3):
            h = twin[3 * order[s] + e]
            moved[3 * s + e] = h if h < 0 else 3 * where[h // 3] + h % 3
    return moved
