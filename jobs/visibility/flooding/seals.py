"""Floods that go on where a narrow gap would stop them: the approximation behind `vlod build --seal DISTANCE`.

**Strips.** Let S be a set of triangles as in `occluders`, e an edge of a triangle t of S at which S has nothing
strictly on the other side, and T another triangle of S. A part of e is *closed* by T where each of its points y has a
point c(y) of T no farther away than DISTANCE, such that the segment from y to c(y) lies strictly on the other side of
e than t as seen from all of the cell V. The segments of that part make up a strip. With y, c moves along a line, so
the strip is right if it is right at its two ends: T is convex, lengths are convex, and on which side of e a point
lies is linear.

Which side is asked for is what tells a gap from two surfaces one behind the other. The front edge of a table that
stands a little before a wall has the wall near it, but for somebody who looks over the table, no part of the wall is
near enough and above the edge: nothing is closed. Where a table stands before a wall and one looks down into the
slit, it is.

**Theorem.** Let S' be S and some strips. The theorem of `occluders` holds for S' if all that follows counts as
unsafe: the unsafe edges of S where they are not closed, and the ends of strips, the segments from y to c(y) there.
*Proof.* It is the theorem for the surface S'. Along e the triangle t and the strip lie on opposite sides. Along its
other long side a strip ends in T, inside of which no segment leaves S', and at whose edges it is their own safety
that counts. V touches no strip, since it lies strictly on one side of every plane through e and a c(y). So what S'
hides and can be seen is seen through strips: **between two points of surfaces that are no farther apart than
DISTANCE**, and nothing that can be seen past all such gaps is lost.

**Depths.** Who goes on S' from the middle of a pixel to another point of it goes over safe edges and strips inside
the pixel's square. So what is deeper than the triangles that hang together with the core by safe edges is deeper than
S' in all pixels that no strip touches; only where one does must it be deeper than all triangles of S' there.
Otherwise a floor that closes the gap below a wall would keep the wall from hiding what stands on the floor behind it.
The strips beside a core cover pixels as the core does: else each pixel with its middle in a gap would stay open.

**Where this is not all.** Two strips that meet, along an edge or at a corner, may end at different triangles T and
T'. Their ends then count as one: the hole between c and c', at most twice DISTANCE wide and within DISTANCE of a
point of an edge, is closed as well, and who can look past it from within this hole but not past T or T' themselves is
not asked for. Elsewhere ends are unsafe, so wide gaps that begin where narrow ones end are open. This is no proof, so
the rays that measure what a cell misses have the last word.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.flooding.flood import (
    Flood,
    Flooded,
    Goal,
    Reach,
    begin_flood,
    edge_touches,
    find_partner,
    spoils_all,
    spread,
)
from jobs.visibility.surfaces.seen_mesh import Mesh, may_occlude
from storage.base.kernels import kernel

#: Rows that a mesh's q has beyond its vertices: ends of parts of edges and of strips.
ROWS = 8192
#: Of these, those that strips beside a core may take, so that enough are left for all that a flood adds.
CORE_ROWS = 2048
#: How often the end of what a triangle closes is looked for between a place where it does and one where it does not.
HALVINGS = 4
#: Sides of strips are only told where they are clearer than this.
DOUBT = 1e-9
#: What is known of a gap in a cell.
UNKNOWN, CLOSED, OPEN = 0, 1, -1


class Seals(NamedTuple):
    """The narrow gaps of a soup, and what is known of them for a cell: worked out when it is first asked for."""

    start: np.ndarray  # (e + 1,) int64, see gaps.find_gaps
    near: np.ndarray  # (g,) int32
    part: np.ndarray  # (g, 2) float32
    state: np.ndarray  # (g,) int8 UNKNOWN before the cell is begun
    closed: np.ndarray  # (g, 2) float64 the part of the edge that is closed where the state is CLOSED
    half: np.ndarray  # (3,) float64 the cell's half extents, in grid units
    distance: np.ndarray  # (1,) float64 in grid units


class Sealing(NamedTuple):
    """Scratch of floods that go on at narrow gaps."""

    stops: np.ndarray  # (3 largest, 2) int32 edges at which nothing of the set is on the other side
    ends: np.ndarray  # (n, 4) int32 for each vertex, the last flood in which an edge is open there, in which one is
    # closed there, which one, and in which two are
    spans: np.ndarray  # (MOST, 2) float64 the closed parts of an edge
    gap: np.ndarray  # (MOST,) int64 of which gaps
    core_gaps: np.ndarray  # (ROWS,) int64 gaps of the strips beside a core
    strips: np.ndarray  # (ROWS, 3) int32 triangles of strips
    point: np.ndarray  # (3,) float64


class Edge(NamedTuple):
    """An edge, as it belongs to a triangle that the whole cell sees from one side."""

    low: int  # its vertices, the one with the lower number first
    high: int
    side: int  # +1 or -1, on which the triangle is: that of orient3d(p, low, high, c) for p in the cell, c on it


class Taken(NamedTuple):
    """How much there is of what a flood leaves behind."""

    unsafe: int  # edges in `Flood.unsafe`; -1 where the set is of no use, see `flood_sealed`
    strips: int  # triangles in `Sealing.strips`
    rows: int  # the first row of q that is free


@kernel(inline="always")
def _edge_of(mesh: Mesh, t: int, i: int) -> Edge:
    """Edge i of triangle t, which was looked at."""
    a, b = mesh.triangles[t, i], mesh.triangles[t, (i + 1) % 3]
    side = mesh.side[t]
    return Edge(min(a, b), max(a, b), side if a < b else -side)


@kernel()
def core_strips(mesh: Mesh, seals: Seals, sealing: Sealing, core: np.ndarray, seen: np.ndarray) -> int:
    """The strips at the edges of a core, two triangles for each gap in `sealing.core_gaps`, into `sealing.strips`.

    They cover pixels as the core does, or a gap would be seen where a pixel's middle lies in it. Returns the number of
    triangles. core: (c,) int32 triangles; seen: (m,) int32, not negative.
    """
    start, near = seals.start, seals.near
    taken, count = mesh.q.shape[0] - ROWS + 2, 0
    last = taken + CORE_ROWS
    for at in range(core.shape[0]):
        t = core[at]
        for i in range(3):
            e = mesh.triangle_edges[t, i]
            if start[e] == start[e + 1]:
                continue
            if find_partner(mesh, t, i, -1, seen) >= 0:
                continue
            edge = _edge_of(mesh, t, i)
            for k in range(start[e], start[e + 1]):
                if taken + 4 > last:
                    return count
                if may_occlude(mesh, near[k]) and _closes(mesh.q, mesh.triangles, seals, k, edge, sealing.point):
                    _put_strip(mesh, seals, sealing, k, edge, taken, count)
                    sealing.core_gaps[count // 2] = k
                    taken += 4
                    count += 2
    return count


@kernel()
def _put_strip(mesh: Mesh, seals: Seals, sealing: Sealing, k: int, edge: Edge, row: int, at: int) -> None:
    """Write the strip of gap k of an edge to four rows of q from `row` on, and its triangles to two of strips."""
    q, strips = mesh.q, sealing.strips
    for end in range(2):
        place, t = seals.closed[k, end], seals.near[k]
        _put(q, row + end, edge, place)
        closes_at(q, mesh.triangles, t, edge, place, seals.half, seals.distance[0], sealing.point)
        for axis in range(3):
            q[row + 2 + end, axis] = sealing.point[axis] / seals.half[axis]
    strips[at, 0], strips[at, 1], strips[at, 2] = row, row + 2, row + 1
    strips[at + 1, 0], strips[at + 1, 1], strips[at + 1, 2] = row + 1, row + 2, row + 3


@kernel()
def flood_sealed(
    mesh: Mesh, flood: Flood, goal: Goal, core: np.ndarray, seals: Seals, sealing: Sealing, n_core_strips: int
) -> Flooded:
    """As `flood.flood_from`, but going on at narrow gaps.

    Args:
        mesh: its q has ROWS rows beyond the vertices, which are written to.
        seals: of the cell; sealing: scratch, receives strips.
        n_core_strips: what `core_strips` gave for the core: these strips belong to the set.

    Returns:
        No unsafe edges but -1 where one of them alone spoils the whole window, where there is no room for all, and
        where no gap was closed, so that this set was drawn before.
    """
    stops, start, near = sealing.stops, seals.start, seals.near
    triangles, seen = flood.triangles, flood.seen
    free = mesh.q.shape[0] - ROWS
    reach = begin_flood(flood, core, goal.epoch)
    any_closed = False
    looked, sure = 0, -1
    while True:
        if reach.gone < reach.size:
            reach = spread(mesh, flood, goal, core.shape[0], reach, stops, False)
        size = reach.size
        if sure < 0:
            sure = reach.drawn
            for k in range(n_core_strips // 2):
                other = near[sealing.core_gaps[k]]
                if seen[other] == goal.epoch:
                    continue
                if size == triangles.shape[0]:
                    return Flooded(size, 0, 0, -1, 0)
                triangles[size] = other
                seen[other] = goal.epoch
                size += 1
            any_closed = n_core_strips > 0
        elif looked == reach.stops:
            break
        else:
            t, i = stops[looked, 0], stops[looked, 1]
            looked += 1
            if i > 2:
                continue
            e = mesh.triangle_edges[t, i]
            edge = _edge_of(mesh, t, i)
            for k in range(start[e], start[e + 1]):
                other = near[k]
                if (
                    not may_occlude(mesh, other)
                    or (seen[other] != goal.epoch and size == triangles.shape[0])
                    or not _closes(mesh.q, mesh.triangles, seals, k, edge, sealing.point)
                ):
                    continue
                _put(mesh.q, free, edge, seals.closed[k, 0])
                _put(mesh.q, free + 1, edge, seals.closed[k, 1])
                if edge_touches(mesh.q, free, free + 1, goal, flood.sweep):
                    any_closed = True
                    if seen[other] != goal.epoch:
                        triangles[size] = other
                        seen[other] = goal.epoch
                        size += 1
        reach = Reach(size, reach.gone, reach.drawn, reach.stops)
    if not any_closed:
        return Flooded(reach.size, 0, 0, -1, 0)
    for stop in range(reach.stops):
        _mark_ends(mesh, seals, sealing, stops[stop, 0], stops[stop, 1], goal.epoch, seen)
    taken = Taken(0, 0, free + 2)
    for stop in range(reach.stops):
        taken = _edges_and_strips(mesh, flood, goal, seals, sealing, stops[stop, 0], stops[stop, 1], taken)
        if taken.unsafe < 0:
            return Flooded(reach.size, 0, 0, -1, 0)
    return Flooded(reach.size, sure, reach.drawn, taken.unsafe, taken.strips)


@kernel()
def _find_spans(seals: Seals, sealing: Sealing, e: int, epoch: int, seen: np.ndarray) -> int:
    """What triangles of the set close of edge e, into `sealing.spans` and `gap`, by their beginnings; how many."""
    spans, gap, near, state, closed = sealing.spans, sealing.gap, seals.near, seals.state, seals.closed
    count = 0
    for k in range(seals.start[e], seals.start[e + 1]):
        if seen[near[k]] != epoch or state[k] != CLOSED:
            continue
        at = count
        while at > 0 and spans[at - 1, 0] > closed[k, 0]:
            spans[at, 0], spans[at, 1], gap[at] = spans[at - 1, 0], spans[at - 1, 1], gap[at - 1]
            at -= 1
        spans[at, 0], spans[at, 1], gap[at] = closed[k, 0], closed[k, 1], k
        count += 1
    return count


@kernel()
def _mark_ends(mesh: Mesh, seals: Seals, sealing: Sealing, t: int, i: int, epoch: int, seen: np.ndarray) -> None:
    """Mark the vertices of edge i % 3 of triangle t as open or closed, see `Sealing.ends`; i > 2: nothing closes it."""
    ends = sealing.ends
    edge, e = _edge_of(mesh, t, i % 3), mesh.triangle_edges[t, i % 3]
    count = _find_spans(seals, sealing, e, epoch, seen) if i < 3 else 0
    least, most = 1.0, 0.0
    for k in range(count):
        least, most = min(least, sealing.spans[k, 0]), max(most, sealing.spans[k, 1])
    for end in range(2):
        v = edge.high if end else edge.low
        if (most < 1.0) if end else (least > 0.0):
            ends[v, 0] = epoch
        elif ends[v, 1] != epoch:
            ends[v, 1], ends[v, 2] = epoch, e
        elif ends[v, 2] != e:
            ends[v, 3] = epoch


@kernel()
def _edges_and_strips(
    mesh: Mesh, flood: Flood, goal: Goal, seals: Seals, sealing: Sealing, t: int, i: int, taken: Taken
) -> Taken:
    """Add what is unsafe of edge i % 3 of triangle t, and the strips that close the rest of it."""
    q, spans, gap, ends = mesh.q, sealing.spans, sealing.gap, sealing.ends
    edge = _edge_of(mesh, t, i % 3)
    count = _find_spans(seals, sealing, mesh.triangle_edges[t, i % 3], goal.epoch, flood.seen) if i < 3 else 0
    n_unsafe, n_strips, row = taken
    if row + 6 * (count + 1) > q.shape[0]:  # four for each strip, two for each part between them
        return Taken(-1, 0, row)
    place = 0.0
    for k in range(count + 1):
        begin = spans[k, 0] if k < count else 1.0
        if begin > place:
            first, last = edge.low, edge.high
            if place > 0.0:
                first = row
                row += 1
                _put(q, first, edge, place)
            if begin < 1.0:
                last = row
                row += 1
                _put(q, last, edge, begin)
            n_unsafe = _add_unsafe(q, first, last, flood, goal, n_unsafe)
            if n_unsafe < 0:
                return Taken(-1, 0, row)
        if k == count:
            break
        end = spans[k, 1]
        y0, y1, c0, c1 = row, row + 1, row + 2, row + 3
        _put_strip(mesh, seals, sealing, gap[k], edge, row, n_strips)
        if (
            edge_touches(q, y0, y1, goal, flood.sweep)
            or edge_touches(q, c0, c1, goal, flood.sweep)
            or edge_touches(q, y0, c0, goal, flood.sweep)
            or edge_touches(q, y1, c1, goal, flood.sweep)
        ):
            row += 4
            n_strips += 2
            before, follows = False, False
            for other in range(count):
                before |= spans[other, 0] < begin <= spans[other, 1]
                follows |= spans[other, 0] <= end < spans[other, 1]
            if begin <= 0.0:
                before = ends[edge.low, 0] != goal.epoch and ends[edge.low, 3] == goal.epoch
            if end >= 1.0:
                follows = ends[edge.high, 0] != goal.epoch and ends[edge.high, 3] == goal.epoch
            if not before:
                n_unsafe = _add_unsafe(q, y0, c0, flood, goal, n_unsafe)
            if n_unsafe >= 0 and not follows:
                n_unsafe = _add_unsafe(q, y1, c1, flood, goal, n_unsafe)
            if n_unsafe < 0:
                return Taken(-1, 0, row)
        place = max(place, end)
    return Taken(n_unsafe, n_strips, row)


@kernel()
def _add_unsafe(q: np.ndarray, first: int, last: int, flood: Flood, goal: Goal, n_unsafe: int) -> int:
    """Add the edge between two rows of q where it touches the window; returns how many there are, -1: see above."""
    unsafe = flood.unsafe
    if not edge_touches(q, first, last, goal, flood.sweep):
        return n_unsafe
    if n_unsafe == unsafe.shape[0]:
        return -1
    unsafe[n_unsafe, 0], unsafe[n_unsafe, 1] = first, last
    if spoils_all(q, first, last, goal, flood.sweep):
        return -1
    return n_unsafe + 1


@kernel(inline="always")
def _put(q: np.ndarray, row: int, edge: Edge, place: float) -> None:
    """Write the point at `place` of an edge, 0 at its low vertex and 1 at the other, to a row of q."""
    for k in range(3):
        q[row, k] = q[edge.low, k] + place * (q[edge.high, k] - q[edge.low, k])


@kernel()
def _closes(q: np.ndarray, triangles: np.ndarray, seals: Seals, k: int, edge: Edge, point: np.ndarray) -> bool:
    """Whether gap k of an edge is closed for the cell, in part at least; see `Seals.closed`.

    All triangles that the edge belongs to are on one side of it: else it would be safe.
    """
    if seals.state[k] == UNKNOWN:
        seals.state[k] = CLOSED if _find_closed(q, triangles, seals, k, edge, point) else OPEN
    return bool(seals.state[k] == CLOSED)


@kernel()
def _find_closed(q: np.ndarray, triangles: np.ndarray, seals: Seals, k: int, edge: Edge, point: np.ndarray) -> bool:
    """Find the part of an edge where gap k is closed: what `_closes` says."""
    t, half, distance = seals.near[k], seals.half, seals.distance[0]
    s0, s1 = float(seals.part[k, 0]), float(seals.part[k, 1])
    ok0 = closes_at(q, triangles, t, edge, s0, half, distance, point)
    ok1 = closes_at(q, triangles, t, edge, s1, half, distance, point)
    if not ok0 and not ok1:
        middle = 0.5 * (s0 + s1)
        if not closes_at(q, triangles, t, edge, middle, half, distance, point):
            return False
        inside0 = inside1 = middle
    else:
        inside0, inside1 = (s0, s0) if ok0 else (s1, s1)
    for _ in range(HALVINGS):
        if not ok0:
            middle = 0.5 * (s0 + inside0)
            if closes_at(q, triangles, t, edge, middle, half, distance, point):
                inside0 = middle
            else:
                s0 = middle
        if not ok1:
            middle = 0.5 * (s1 + inside1)
            if closes_at(q, triangles, t, edge, middle, half, distance, point):
                inside1 = middle
            else:
                s1 = middle
    seals.closed[k, 0] = s0 if ok0 else inside0
    seals.closed[k, 1] = s1 if ok1 else inside1
    return bool(seals.closed[k, 0] < seals.closed[k, 1])


@kernel()
def closes_at(
    q: np.ndarray,
    triangles: np.ndarray,
    t: int,
    edge: Edge,
    place: float,
    half: np.ndarray,
    distance: float,
    point: np.ndarray,
) -> bool:
    """Whether a triangle reaches over to the other side of an edge within a distance, seen from all of the cell.

    Args:
        q: (n, 3) float64 cell coordinates; half: (3,) float64 the cell's half extents in grid units.
        triangles: (m, 3) int32; t: the triangle.
        place: the point y of the edge, 0 at its low vertex, 1 at the other.
        distance: in grid units.
        point: (3,) float64, receives the point c(y) of the triangle, of those not farther from y than `distance` the
            one that is farthest on the other side as seen from the cell's middle, relative to it, in grid units.
    """
    ax, ay, az = _corner(q, edge.low, half)
    bx, by, bz = _corner(q, edge.high, half)
    mine = edge.side
    # across the plane through the cell's middle and the edge, towards the other side
    nx, ny, nz = mine * (ay * bz - az * by), mine * (az * bx - ax * bz), mine * (ax * by - ay * bx)
    n = np.sqrt(nx * nx + ny * ny + nz * nz)
    if not n > 0.0:
        return False
    y = (ax + place * (bx - ax), ay + place * (by - ay), az + place * (bz - az))
    if not _reach(q, triangles, t, half, y, (nx / n, ny / n, nz / n), distance, point):
        return False
    ux, uy, uz = bx - ax, by - ay, bz - az
    cx, cy, cz = point[0] - ax, point[1] - ay, point[2] - az
    px, py, pz = uy * cz - uz * cy, uz * cx - ux * cz, ux * cy - uy * cx
    o = -(px * ax + py * ay + pz * az)
    reach = abs(px) * half[0] + abs(py) * half[1] + abs(pz) * half[2]
    return -mine * o > reach + DOUBT * (abs(px * ax) + abs(py * ay) + abs(pz * az) + reach)


@kernel()
def _reach(
    q: np.ndarray,
    triangles: np.ndarray,
    t: int,
    half: np.ndarray,
    y: tuple[float, float, float],
    n: tuple[float, float, float],
    distance: float,
    point: np.ndarray,
) -> bool:
    """The point of triangle t in the ball around y that lies farthest along n, into `point`; whether there is any.

    In the triangle's plane the ball is a disc. The point is the disc's own farthest one where that lies in the
    triangle, else a corner inside the disc or a place where the disc's rim crosses an edge.
    """
    yx, yy, yz = y
    nx, ny, nz = n
    ox, oy, oz = _corner(q, triangles[t, 0], half)
    ex, ey, ez = _corner(q, triangles[t, 1], half)
    fx, fy, fz = _corner(q, triangles[t, 2], half)
    ex, ey, ez, fx, fy, fz = ex - ox, ey - oy, ez - oz, fx - ox, fy - oy, fz - oz
    mx, my, mz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    m2 = mx * mx + my * my + mz * mz
    m = np.sqrt(m2)
    rise = (mx * (yx - ox) + my * (yy - oy) + mz * (yz - oz)) / m
    rim = distance * distance - rise * rise
    if not (rim > 0.0 and m > 0.0):
        return False
    rim = np.sqrt(rim)
    gx, gy, gz = yx - rise * mx / m, yy - rise * my / m, yz - rise * mz / m
    along = (nx * mx + ny * my + nz * mz) / m2
    tx, ty, tz = nx - along * mx, ny - along * my, nz - along * mz
    length = np.sqrt(tx * tx + ty * ty + tz * tz)
    if length > 0.0:
        tx, ty, tz = gx + tx * rim / length, gy + ty * rim / length, gz + tz * rim / length
        # weights of the corners
        dx, dy, dz = tx - ox, ty - oy, tz - oz
        we = (mx * (dy * fz - dz * fy) + my * (dz * fx - dx * fz) + mz * (dx * fy - dy * fx)) / m2
        wf = (mx * (ey * dz - ez * dy) + my * (ez * dx - ex * dz) + mz * (ex * dy - ey * dx)) / m2
        if we >= 0.0 and wf >= 0.0 and we + wf <= 1.0:
            point[0], point[1], point[2] = tx, ty, tz
            return True
    farthest = -np.inf
    for i in range(3):
        ax, ay, az = _corner(q, triangles[t, i], half)
        bx, by, bz = _corner(q, triangles[t, (i + 1) % 3], half)
        ux, uy, uz = bx - ax, by - ay, bz - az
        hx, hy, hz = ax - gx, ay - gy, az - gz
        uu = ux * ux + uy * uy + uz * uz
        uh = ux * hx + uy * hy + uz * hz
        root = uh * uh - uu * (hx * hx + hy * hy + hz * hz - rim * rim)
        if root < 0.0:
            continue
        root = np.sqrt(root)
        s0, s1 = max((-uh - root) / uu, 0.0), min((-uh + root) / uu, 1.0)
        if s0 > s1:
            continue
        s = s1 if nx * ux + ny * uy + nz * uz > 0.0 else s0
        value = nx * (ax + s * ux) + ny * (ay + s * uy) + nz * (az + s * uz)
        if value > farthest:
            farthest = value
            point[0], point[1], point[2] = ax + s * ux, ay + s * uy, az + s * uz
    return farthest > -np.inf


@kernel(inline="always")
def _corner(q: np.ndarray, v: int, half: np.ndarray) -> tuple[float, float, float]:
    """Vertex v relative to the cell's middle, in grid units."""
    return q[v, 0] * half[0], q[v, 1] * half[1], q[v, 2] * half[2]
