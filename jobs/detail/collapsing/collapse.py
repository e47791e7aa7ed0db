"""Edge collapses in the order of their error, on meshes of any topology.

The error of a collapse is the distance of the new vertex from the planes that its region had in the beginning (the root
of their mean square, by quadrics); or, where that is much larger, the distance of the two old vertices from the
triangles around the new one, which sees what planes do not: a pipe that loses its end. Vertices stay on the grid, where
the quadric is least; locked ones stay in place. Nothing connected ever vanishes: one triangle of it stays at least.
Besides edges, pairs of vertices that nothing joins may be collapsed: so things grow together.

A collapse is a continuous map, so what was closed has no hole afterwards, whatever its topology.

Based on: M. Garland, P. S. Heckbert, Surface Simplification Using Quadric Error Metrics, SIGGRAPH 1997 (quadrics,
planes at right angles along borders, no normal may turn over); P. Lindstrom, G. Turk, Fast and Memory Efficient
Polygonal Simplification, IEEE Visualization 1998 (placing vertices with little change of what is flat).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.detail.bounds.closest import closest_weights
from jobs.objects.weld import OPEN
from storage.base.kernels import allocating_kernel, kernel

#: Planes along open edges and along edges where colours change weigh this much of a triangle's.
RIM_WEIGHT = 2.0
SEAM_WEIGHT = 0.5
#: A plane weighs the triangle's area to this power: small triangles count as errors that are as large as any.
AREA_POWER = 0.5
#: Vertices are drawn towards the middle of the collapsed edge by this part of the weight: where planes leave it open.
PULL = 1e-5
#: The distance from the planes tells what matters as long as the old vertices are not this many times farther away.
TRUST = 3.0
#: A triangle may turn by an angle of at most this cosine.
TURN = 0.2

#: No pairs besides edges.
NO_PAIRS = np.zeros((0, 2), np.int32)

# Columns of a quadric: the matrix's upper triangle, the vector, the constant, and the weight.
_XX, _XY, _XZ, _YY, _YZ, _ZZ, _X, _Y, _Z, _ONE, _WEIGHT = range(11)

# Rows of `State.counts`.
_HEAP, _LEFT, _TICK = range(3)


class State(NamedTuple):
    """A mesh that is being simplified. Positions are grid coordinates less the mesh's centre."""

    centre: np.ndarray  # (3,) int64
    positions: np.ndarray  # (n, 3) float64, whole numbers
    quadrics: np.ndarray  # (n, 11)
    locked: np.ndarray  # (n,) bool
    triangles: np.ndarray  # (m, 3) int32
    alive: np.ndarray  # (m,) bool
    first: np.ndarray  # (n,) int32: first corner around each vertex, -1 where there is none
    following: np.ndarray  # (3 m,) int32: the next corner around the same vertex, -1 behind the last
    pair_first: np.ndarray  # (n,) int32: first end of a pair at each vertex, -1 where there is none
    pair_following: np.ndarray  # (2 p,) int32: the next end at the same vertex, -1 behind the last
    pair_vertex: np.ndarray  # (2 p,) int32: the vertex at each end; ends 2 i and 2 i + 1 belong together
    version: np.ndarray  # (n,) int32: changes whenever the vertex does; -1 once it is gone
    mark: np.ndarray  # (n,) int64: scratch
    heap: np.ndarray  # (h,) float64: errors of collapses, a binary heap
    heap_edge: np.ndarray  # (h, 4) int32: the vertices and the versions that they had
    counts: np.ndarray  # (3,) int64
    error: np.ndarray  # (1,) float64: largest error of a collapse so far
    reach: np.ndarray  # (n,) float64: how far each vertex has come from the planes of its region, about


@kernel()
def _push(heap: np.ndarray, edge: np.ndarray, size: int, cost: float, u: int, v: int, vu: int, vv: int) -> int:
    i = size
    while i > 0:
        above = (i - 1) >> 1
        if heap[above] <= cost:
            break
        heap[i] = heap[above]
        for c in range(4):
            edge[i, c] = edge[above, c]
        i = above
    heap[i] = cost
    edge[i, 0], edge[i, 1], edge[i, 2], edge[i, 3] = u, v, vu, vv
    return size + 1


@kernel()
def _sink(heap: np.ndarray, edge: np.ndarray, size: int, i: int) -> None:
    """Restore the order below entry i."""
    cost = heap[i]
    u, v, vu, vv = edge[i, 0], edge[i, 1], edge[i, 2], edge[i, 3]
    while True:
        below = 2 * i + 1
        if below >= size:
            break
        if below + 1 < size and heap[below + 1] < heap[below]:
            below += 1
        if heap[below] >= cost:
            break
        heap[i] = heap[below]
        for c in range(4):
            edge[i, c] = edge[below, c]
        i = below
    heap[i] = cost
    edge[i, 0], edge[i, 1], edge[i, 2], edge[i, 3] = u, v, vu, vv


@kernel()
def _add_plane(q: np.ndarray, x: float, y: float, z: float, d: float, weight: float) -> None:
    """Add the plane x p_x + y p_y + z p_z = d, with a unit normal, to a quadric (11,)."""
    q[_XX] += weight * x * x
    q[_XY] += weight * x * y
    q[_XZ] += weight * x * z
    q[_YY] += weight * y * y
    q[_YZ] += weight * y * z
    q[_ZZ] += weight * z * z
    q[_X] -= weight * x * d
    q[_Y] -= weight * y * d
    q[_Z] -= weight * z * d
    q[_ONE] += weight * d * d
    q[_WEIGHT] += weight


@kernel(inline="always")
def _measure(q: np.ndarray, r: np.ndarray, x: float, y: float, z: float) -> float:
    """Mean squared distance of a point from the planes of two quadrics (11,)."""
    xx, xy, xz = q[_XX] + r[_XX], q[_XY] + r[_XY], q[_XZ] + r[_XZ]
    yy, yz, zz = q[_YY] + r[_YY], q[_YZ] + r[_YZ], q[_ZZ] + r[_ZZ]
    total = x * (xx * x + 2.0 * (xy * y + xz * z + q[_X] + r[_X])) + y * (yy * y + 2.0 * (yz * z + q[_Y] + r[_Y]))
    total += z * (zz * z + 2.0 * (q[_Z] + r[_Z])) + q[_ONE] + r[_ONE]
    weight = q[_WEIGHT] + r[_WEIGHT]
    return max(total, 0.0) / weight if weight > 0.0 else 0.0


@kernel()
def _place(
    p: np.ndarray, quadrics: np.ndarray, locked: np.ndarray, u: int, v: int
) -> tuple[float, float, float, float]:
    """Where the collapsed edge's vertex goes, and its squared distance from the planes; infinite if it may not be."""
    q, r = quadrics[u], quadrics[v]
    if locked[u] and locked[v]:
        return 0.0, 0.0, 0.0, np.inf
    at_u = _measure(q, r, p[u, 0], p[u, 1], p[u, 2])
    if locked[u]:
        return p[u, 0], p[u, 1], p[u, 2], at_u
    at_v = _measure(q, r, p[v, 0], p[v, 1], p[v, 2])
    if locked[v]:
        return p[v, 0], p[v, 1], p[v, 2], at_v
    mx, my, mz = (p[u, 0] + p[v, 0]) / 2.0, (p[u, 1] + p[v, 1]) / 2.0, (p[u, 2] + p[v, 2]) / 2.0
    pull = PULL * (q[_WEIGHT] + r[_WEIGHT])
    xx, xy, xz = q[_XX] + r[_XX] + pull, q[_XY] + r[_XY], q[_XZ] + r[_XZ]
    yy, yz, zz = q[_YY] + r[_YY] + pull, q[_YZ] + r[_YZ], q[_ZZ] + r[_ZZ] + pull
    bx = pull * mx - q[_X] - r[_X]
    by = pull * my - q[_Y] - r[_Y]
    bz = pull * mz - q[_Z] - r[_Z]
    cx, cy, cz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * cx + xy * cy + xz * cz
    best, x, y, z = at_u, p[u, 0], p[u, 1], p[u, 2]
    if at_v < best:
        best, x, y, z = at_v, p[v, 0], p[v, 1], p[v, 2]
    if best > 0.0 and determinant > 0.0:
        sx = np.rint((cx * bx + cy * by + cz * bz) / determinant)
        sy = np.rint((cy * bx + (xx * zz - xz * xz) * by + (xy * xz - xx * yz) * bz) / determinant)
        sz = np.rint((cz * bx + (xy * xz - xx * yz) * by + (xx * yy - xy * xy) * bz) / determinant)
        there = _measure(q, r, sx, sy, sz)
        ex, ey, ez = p[u, 0] - p[v, 0], p[u, 1] - p[v, 1], p[u, 2] - p[v, 2]
        dx, dy, dz = sx - mx, sy - my, sz - mz
        near = dx * dx + dy * dy + dz * dz <= 4.0 * (ex * ex + ey * ey + ez * ez)
        if near and there < best:
            best, x, y, z = there, sx, sy, sz
    return x, y, z, best


@kernel()
def _apart(p: np.ndarray, u: int, v: int, cost2: float) -> float:
    """The error of collapsing a pair that no edge joins: half of its length at least, which its middle moves."""
    x, y, z = p[u, 0] - p[v, 0], p[u, 1] - p[v, 1], p[u, 2] - p[v, 2]
    return np.sqrt(max(cost2, (x * x + y * y + z * z) / 4.0))


@allocating_kernel()
def begin(
    points: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    locked: np.ndarray,
    colours: np.ndarray,
    pairs: np.ndarray,
) -> State:
    """A state for points (n, 3) int32, triangles (m, 3) int32, twin (3 m,) from `twins`, locked (n,) bool.

    colours (3 m, 4) uint8 of the corners: edges between triangles of different colours count as borders.
    pairs (p, 2) int32: vertices that may be joined though no edge does.
    """
    n, m = len(points), len(triangles)
    centre, p = _around_centre(points)
    quadrics = np.zeros((n, 11))
    normals, weights = _add_faces(p, triangles, quadrics)
    _add_borders(p, triangles, twin, colours, normals, weights, quadrics)
    first, following = _lists(triangles.reshape(-1), n)
    pair_first, pair_following = _lists(pairs.reshape(-1), n)
    capacity = 12 * m + 4 * len(pairs) + 64
    state = State(
        centre,
        p,
        quadrics,
        locked.copy(),
        triangles.copy(),
        np.ones(m, np.bool_),
        first,
        following,
        pair_first,
        pair_following,
        pairs.reshape(-1).copy(),
        np.zeros(n, np.int32),
        np.zeros(n, np.int64),
        np.empty(capacity),
        np.empty((capacity, 4), np.int32),
        np.zeros(3, np.int64),
        np.zeros(1),
        np.zeros(n),
    )
    state.counts[_LEFT] = m
    _fill_heap(state, twin, pairs)
    return state


@allocating_kernel()
def _around_centre(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle (3,) int64 of the box around points (n, 3) int32, and the points less that, (n, 3) float64."""
    n = len(points)
    centre = np.zeros(3, np.int64)
    for c in range(3):
        low, high = np.int64(points[0, c]), np.int64(points[0, c])
        for i in range(n):
            low, high = min(low, np.int64(points[i, c])), max(high, np.int64(points[i, c]))
        centre[c] = (low + high) // 2
    p = np.empty((n, 3))
    for i in range(n):
        for c in range(3):
            p[i, c] = points[i, c] - centre[c]
    return centre, p


@allocating_kernel()
def _add_faces(p: np.ndarray, triangles: np.ndarray, quadrics: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Add each triangle's plane to the quadrics of its corners.

    Returns unit normals (m, 3) float64 and weights (m,), 0 where a triangle has no area.
    """
    m = len(triangles)
    normals, weights = np.zeros((m, 3)), np.zeros(m)
    for t in range(m):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, uy, uz = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
        vx, vy, vz = p[c, 0] - p[a, 0], p[c, 1] - p[a, 1], p[c, 2] - p[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
            normals[t, 0], normals[t, 1], normals[t, 2] = x, y, z
            weights[t] = length**AREA_POWER
            d = x * p[a, 0] + y * p[a, 1] + z * p[a, 2]
            for e in range(3):
                _add_plane(quadrics[triangles[t, e]], x, y, z, d, weights[t])
    return normals, weights


@kernel()
def _add_borders(
    p: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    colours: np.ndarray,
    normals: np.ndarray,
    weights: np.ndarray,
    quadrics: np.ndarray,
) -> None:
    """Add planes at right angles to the triangles along open edges, and along those where colours change."""
    for h in range(3 * len(triangles)):
        t, o = h // 3, twin[h]
        seam = False
        if o >= 0:
            f, g = 3 * t + (h + 1) % 3, 3 * (o // 3) + (o + 1) % 3
            for i in range(4):
                seam = seam or colours[h, i] != colours[g, i] or colours[f, i] != colours[o, i]
        if o != OPEN and not seam:
            continue
        a, b = triangles[t, h % 3], triangles[t, (h + 1) % 3]
        ex, ey, ez = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
        x = ey * normals[t, 2] - ez * normals[t, 1]
        y = ez * normals[t, 0] - ex * normals[t, 2]
        z = ex * normals[t, 1] - ey * normals[t, 0]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            x, y, z = x / length, y / length, z / length
            d = x * p[a, 0] + y * p[a, 1] + z * p[a, 2]
            weight = weights[t] * (SEAM_WEIGHT if seam else RIM_WEIGHT)
            _add_plane(quadrics[a], x, y, z, d, weight)
            _add_plane(quadrics[b], x, y, z, d, weight)


@allocating_kernel()
def _lists(vertex: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The places in vertex (k,) int32 that each of n vertices has, as lists: see `State.first` and `following`."""
    first, following = np.full(n, -1, np.int32), np.empty(len(vertex), np.int32)
    for place in range(len(vertex)):
        following[place] = first[vertex[place]]
        first[vertex[place]] = place
    return first, following


@kernel()
def _fill_heap(state: State, twin: np.ndarray, pairs: np.ndarray) -> None:
    """Weigh all edges and pairs, and put those that may be collapsed in order."""
    p, triangles, entries = state.positions, state.triangles, 0
    for h in range(3 * len(triangles)):
        if 0 <= twin[h] < h:
            continue
        u, v = triangles[h // 3, h % 3], triangles[h // 3, (h + 1) % 3]
        cost2 = _place(p, state.quadrics, state.locked, u, v)[3]
        if cost2 < np.inf:
            _set_entry(state, entries, np.sqrt(cost2), u, v)
            entries += 1
    for i in range(len(pairs)):
        u, v = pairs[i, 0], pairs[i, 1]
        cost2 = _place(p, state.quadrics, state.locked, u, v)[3]
        if cost2 < np.inf:
            _set_entry(state, entries, _apart(p, u, v, cost2), u, v)
            entries += 1
    for i in range(entries // 2 - 1, -1, -1):
        _sink(state.heap, state.heap_edge, entries, i)
    state.counts[_HEAP] = entries


@kernel(inline="always")
def _set_entry(state: State, at: int, cost: float, u: int, v: int) -> None:
    """Entry `at` of the heap: the collapse of two vertices as they are in the beginning."""
    state.heap[at] = cost
    state.heap_edge[at, 0], state.heap_edge[at, 1] = min(u, v), max(u, v)
    state.heap_edge[at, 2], state.heap_edge[at, 3] = 0, 0


@kernel()
def _true_error(state: State, u: int, v: int, x: float, y: float, z: float, at: np.ndarray) -> tuple[float, bool]:
    """How far u and v lie from what is left around them, at least, and whether no triangle joins them.

    Infinite where it may not be.

    A triangle may not turn over, a locked edge may not lose its only triangle, and nothing connected may vanish.
    at (1, 9): scratch.
    """
    p = state.positions
    near_u, near_v = np.inf, np.inf
    still_u = p[u, 0] == x and p[u, 1] == y and p[u, 2] == z
    still_v = p[v, 0] == x and p[v, 1] == y and p[v, 2] == z
    rest = 0
    apart = True
    beyond_u, beyond_v, bare = np.inf, np.inf, 0.0
    for side in range(2):
        w, other = (u, v) if side == 0 else (v, u)
        moves = not (still_u if side == 0 else still_v)
        corner = state.first[w]
        while corner >= 0:
            t, e = corner // 3, corner % 3
            corner = state.following[corner]
            if not state.alive[t]:
                continue
            b, c = state.triangles[t, (e + 1) % 3], state.triangles[t, (e + 2) % 3]
            if other in (b, c):
                apart = False
                if side == 0:
                    third = c if b == other else b
                    if state.locked[third] and (state.locked[u] or state.locked[v]):
                        moving = v if state.locked[u] else u
                        if not _other_triangle(state, moving, third, t):
                            return np.inf, False
                    du, dv, dw = 0.0, 0.0, 0.0
                    for i in range(3):
                        du += (p[u, i] - p[third, i]) ** 2
                        dv += (p[v, i] - p[third, i]) ** 2
                    dw = (x - p[third, 0]) ** 2 + (y - p[third, 1]) ** 2 + (z - p[third, 2]) ** 2
                    outside, beside = _beyond(state, third, u, v)
                    if outside:
                        beyond_u, beyond_v = min(beyond_u, du), min(beyond_v, dv)
                    if not beside:
                        bare = max(bare, dw / 4.0)
                continue
            rest += 1
            bx, by, bz = p[b, 0], p[b, 1], p[b, 2]
            fx, fy, fz = p[c, 0] - bx, p[c, 1] - by, p[c, 2] - bz
            nx, ny, nz = x - bx, y - by, z - bz
            qx, qy, qz = fy * nz - fz * ny, fz * nx - fx * nz, fx * ny - fy * nx
            if moves:
                ox, oy, oz = p[w, 0] - bx, p[w, 1] - by, p[w, 2] - bz
                rx, ry, rz = fy * oz - fz * oy, fz * ox - fx * oz, fx * oy - fy * ox
                dot = qx * rx + qy * ry + qz * rz
                qq, rr = qx * qx + qy * qy + qz * qz, rx * rx + ry * ry + rz * rz
                if dot <= 0.0 or dot * dot < TURN * TURN * qq * rr:
                    return np.inf, apart
            at[0, 0], at[0, 1], at[0, 2] = x, y, z
            at[0, 3], at[0, 4], at[0, 5] = -nx, -ny, -nz
            at[0, 6], at[0, 7], at[0, 8] = fx - nx, fy - ny, fz - nz
            if not still_u and near_u > 0.0:
                near_u = min(near_u, closest_weights(at, 0, p[u, 0], p[u, 1], p[u, 2])[0])
            if not still_v and near_v > 0.0:
                near_v = min(near_v, closest_weights(at, 0, p[v, 0], p[v, 1], p[v, 2])[0])
    if rest == 0:
        return np.sqrt(max(beyond_u, beyond_v)), apart
    return np.sqrt(max(0.0 if still_u else near_u, 0.0 if still_v else near_v, bare)), apart


@kernel()
def _other_triangle(state: State, a: int, b: int, besides: int) -> bool:
    """Whether vertices a and b have another triangle in common."""
    corner = state.first[a]
    while corner >= 0:
        t = corner // 3
        if t != besides and state.alive[t]:
            for e in range(3):
                if state.triangles[t, e] == b:
                    return True
        corner = state.following[corner]
    return False


@kernel()
def _beyond(state: State, a: int, u: int, v: int) -> tuple[bool, bool]:
    """Whether vertex a has a triangle that is not one of edge u, v; and one with just one of u and v.

    Where it has none with one of them, what is left of the triangle a, u, v is a bare line.
    """
    outside = False
    corner = state.first[a]
    while corner >= 0:
        t = corner // 3
        if state.alive[t]:
            both = 0
            for e in range(3):
                both += state.triangles[t, e] in (u, v)
            if both == 1:
                return True, True
            outside = outside or both == 0
        corner = state.following[corner]
    return outside, False


@allocating_kernel()
def collapse(state: State, target: int, limit: float) -> None:
    """Collapse edges until at most `target` triangles are left, or the next error is above `limit` (grid steps)."""
    heap, edge, p = state.heap, state.heap_edge, state.positions
    version, triangles, alive = state.version, state.triangles, state.alive
    quadrics, locked = state.quadrics, state.locked
    at = np.empty((1, 9))
    while state.counts[_LEFT] > target and state.counts[_HEAP] > 0:
        cost = heap[0]
        if cost > limit:
            break
        u, v = edge[0, 0], edge[0, 1]
        valid = version[u] == edge[0, 2] and version[v] == edge[0, 3]
        size = state.counts[_HEAP] - 1
        heap[0] = heap[size]
        for c in range(4):
            edge[0, c] = edge[size, c]
        state.counts[_HEAP] = size
        if size > 0:
            _sink(heap, edge, size, 0)
        if not valid:
            continue
        x, y, z, cost2 = _place(p, quadrics, locked, u, v)
        away, apart = _true_error(state, u, v, x, y, z, at)
        error = _apart(p, u, v, cost2) if apart else np.sqrt(cost2)
        if away > TRUST * error:
            error = away
        if error == np.inf:
            continue
        if size > 0 and error > cost and error > heap[0]:
            state.counts[_HEAP] = _push(heap, edge, size, error, u, v, version[u], version[v])
            continue
        state.error[0] = max(state.error[0], error)
        state.reach[u] = max(state.reach[u], state.reach[v], np.sqrt(cost2))

        # v becomes u
        p[u, 0], p[u, 1], p[u, 2] = x, y, z
        state.locked[u] = state.locked[u] or state.locked[v]
        for c in range(11):
            state.quadrics[u, c] += state.quadrics[v, c]
        version[u] += 1
        version[v] = -1
        state.counts[_TICK] += 1
        tick = state.counts[_TICK]
        corner = state.first[v]
        head = np.int32(-1)
        while corner >= 0:
            t, after = corner // 3, state.following[corner]
            if alive[t]:
                if u in (triangles[t, 0], triangles[t, 1], triangles[t, 2]):
                    alive[t] = False
                    state.counts[_LEFT] -= 1
                else:
                    triangles[t, corner % 3] = u
                    state.following[corner] = head
                    head = corner
            corner = after
        corner = state.first[u]
        while corner >= 0:
            after = state.following[corner]
            if alive[corner // 3]:
                state.following[corner] = head
                head = corner
            corner = after
        state.first[u] = head
        state.first[v] = -1

        if state.counts[_HEAP] + 3 * 64 > len(heap):
            _drop_stale(state)
        state.mark[u] = tick
        corner = head
        while corner >= 0:
            for step in range(1, 3):
                w = triangles[corner // 3, (corner % 3 + step) % 3]
                if state.mark[w] != tick:
                    state.mark[w] = tick
                    low, high = min(u, w), max(u, w)
                    cost2 = _place(p, quadrics, locked, low, high)[3]
                    if cost2 < np.inf and state.counts[_HEAP] < len(heap):
                        state.counts[_HEAP] = _push(
                            heap, edge, state.counts[_HEAP], np.sqrt(cost2), low, high, version[low], version[high]
                        )
            corner = state.following[corner]
        _join_pairs(state, u, v, tick)


@kernel()
def _join_pairs(state: State, u: int, v: int, tick: int) -> None:
    """Give u the pairs of v, which has become u, and weigh all of them anew; those that edges join now are dropped.

    Neighbours of u are marked with `tick`.
    """
    p, following, vertex, version = state.positions, state.pair_following, state.pair_vertex, state.version
    head = np.int32(-1)
    for side in range(2):
        end = state.pair_first[v if side == 0 else u]
        while end >= 0:
            after = following[end]
            vertex[end] = u
            w = vertex[end ^ 1]
            if version[w] >= 0 and state.mark[w] != tick:
                state.mark[w] = tick
                following[end] = head
                head = end
                low, high = min(u, w), max(u, w)
                cost2 = _place(p, state.quadrics, state.locked, low, high)[3]
                if cost2 < np.inf and state.counts[_HEAP] < len(state.heap):
                    cost = _apart(p, low, high, cost2)
                    state.counts[_HEAP] = _push(
                        state.heap, state.heap_edge, state.counts[_HEAP], cost, low, high, version[low], version[high]
                    )
            end = after
    state.pair_first[u] = head
    state.pair_first[v] = -1


@kernel()
def _drop_stale(state: State) -> None:
    """Take entries of the past out of the heap."""
    heap, edge, version = state.heap, state.heap_edge, state.version
    size = 0
    for i in range(state.counts[_HEAP]):
        if version[edge[i, 0]] == edge[i, 2] and version[edge[i, 1]] == edge[i, 3]:
            heap[size] = heap[i]
            for c in range(4):
                edge[size, c] = edge[i, c]
            size += 1
    state.counts[_HEAP] = size
    for i in range(size // 2 - 1, -1, -1):
        _sink(heap, edge, size, i)


@allocating_kernel()
def snapshot(state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What is left: grid points (n, 3) int32, triangles (m, 3) int32, and the original of each triangle (m,) int32.

    And how far each point has come from the planes of its region, (n,) float64, about; 0 for locked ones.
    """
    number = np.full(len(state.positions), -1, np.int32)
    left = state.counts[_LEFT]
    points = np.empty((min(len(number), 3 * left), 3), np.int32)
    triangles = np.empty((left, 3), np.int32)
    source = np.empty(left, np.int32)
    reach = np.empty(len(points))
    used, count = 0, 0
    for t in range(len(state.alive)):
        if not state.alive[t]:
            continue
        source[count] = t
        for e in range(3):
            v = state.triangles[t, e]
            if number[v] < 0:
                number[v] = used
                reach[used] = 0.0 if state.locked[v] else state.reach[v]
                for c in range(3):
                    points[used, c] = np.int32(np.int64(state.positions[v, c]) + state.centre[c])
                used += 1
            triangles[count, e] = number[v]
        count += 1
    return points[:used].copy(), triangles, source, reach[:used].copy()
