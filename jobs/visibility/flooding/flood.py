"""Flooding: from a small core to a set of triangles whose silhouettes cannot spoil the core's pixels.

See `occluders` for what the sets are used for, and for what makes an edge safe.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.images.cube_faces import (
    NEAR,
    Face,
    Pixels,
    Window,
    box_image,
    clip_triangle,
    hull_touches,
    inflate_edge,
    to_face,
)
from jobs.visibility.surfaces.seen_mesh import Mesh, look
from storage.base.kernels import kernel


@kernel()
def grow_core(mesh: Mesh, seed: int, first: int, last: int, mark: int, cored: np.ndarray, core: np.ndarray) -> int:
    """What hangs together with `seed` by safe edges among triangles first ... last - 1; the number written to `core`.

    cored: (m,) int32, at least `mark` where a triangle belongs to a core already; core: (last - first or more,) int32.
    """
    triangles, triangle_edges = mesh.triangles, mesh.triangle_edges
    edge_start, edge_uses = mesh.edge_start, mesh.edge_uses
    count = 1
    core[0] = seed
    cored[seed] = mark
    head = 0
    while head < count:
        t = core[head]
        head += 1
        side = look(mesh, t)
        for i in range(3):
            e = triangle_edges[t, i]
            mine = side if triangles[t, i] < triangles[t, (i + 1) % 3] else -side
            for j in range(edge_start[e], edge_start[e + 1]):
                other = edge_uses[j] >> 1
                if first <= other < last and cored[other] < mark:
                    its = look(mesh, other)
                    if (-its if edge_uses[j] & 1 else its) == -mine:
                        cored[other] = mark
                        core[count] = other
                        count += 1
    return count


@kernel()
def core_pixels(
    q: np.ndarray, triangles: np.ndarray, core: np.ndarray, face: Face, polygon: np.ndarray
) -> tuple[bool, Pixels, float]:
    """Pixels whose centres a core may cover on a face, whether there are any, and its nearest depth there.

    q: (n, 3) float64; triangles: (m, 3) int32; core: (c,) int32 of these; polygon: (4, 2) float64 scratch.
    """
    resolution = face.resolution
    u0, u1, v0, v1 = np.inf, -np.inf, np.inf, -np.inf
    nearest = np.inf
    for k in range(core.shape[0]):
        a, b, c = triangles[core[k], 0], triangles[core[k], 1], triangles[core[k], 2]
        n, near, _ = clip_triangle(q, a, b, c, face.number, resolution, polygon)
        if n:
            nearest = min(nearest, near)
        for i in range(n):
            u0 = min(u0, polygon[i, 0])
            u1 = max(u1, polygon[i, 0])
            v0 = min(v0, polygon[i, 1])
            v1 = max(v1, polygon[i, 1])
    if not (u0 < resolution and v0 < resolution and u1 > 0 and v1 > 0):
        return False, Pixels(0, 0, 0, 0), 0.0
    i0 = int(np.ceil(u0 - 0.5)) if u0 > 0 else 0
    i1 = int(np.floor(u1 - 0.5)) if u1 < resolution else resolution - 1
    j0 = int(np.ceil(v0 - 0.5)) if v0 > 0 else 0
    j1 = int(np.floor(v1 - 0.5)) if v1 < resolution else resolution - 1
    return i0 <= i1 and j0 <= j1, Pixels(i0, i1, j0, j1), nearest


class Images(NamedTuple):
    """What has been worked out of the vertices on one face: rows are filled when they are first asked for."""

    known: np.ndarray  # (n,) int32, the mark of the last face for which the row is filled
    rows: np.ndarray  # (n, 6) float64: bounds of the inflated vertex (u0, u1, v0, v1), its own u and v, pixels
    ahead: np.ndarray  # (n,) bool: the vertex lies beyond NEAR; else the row is not to be used


class Flood(NamedTuple):
    """What sets are flooded in, one after the other."""

    images: Images  # of the vertices
    seen: np.ndarray  # (m,) int32 the epoch of the last flood that took a triangle in
    triangles: np.ndarray  # (largest,) int32 the set; where it is full a flood stops, and edges there are unsafe
    drawn: np.ndarray  # (largest,) int32 those of the set, but for the core, that may touch the window
    unsafe: np.ndarray  # (3 largest, 2) int32 vertices of the unsafe edges that touch the window
    sweep: np.ndarray  # (4, 4) float64 scratch


class Goal(NamedTuple):
    """What a set is flooded for: pixels of a face."""

    face: Face
    mark: int  # rows of `Images` that were filled for this face and this cell have it
    epoch: int  # a number that no flood before had: triangles of the set are marked with it
    window: Window  # around the pixels
    least_depth: float  # of what the core may hide; at least 1.5


class Reach(NamedTuple):
    """How far a flood has come."""

    size: int  # triangles in the set
    gone: int  # of these, so many have been gone through
    drawn: int  # of these, so many are to be drawn
    stops: int  # edges at which it ended; -1 where one of them spoils the whole window


class Flooded(NamedTuple):
    """What a flood came to."""

    size: int  # triangles in the set
    sure: int  # of those to draw, the first ones that hang together with the core by safe edges
    drawn: int  # triangles to draw, besides the core
    unsafe: int  # edges; -1 where the set is of no use
    strips: int  # triangles of strips, see `seals`


@kernel(inline="always")
def look_at(q: np.ndarray, images: Images, vertex: int, face: Face, mark: int) -> bool:
    """Fill a vertex's row (see `Images`) for a face unless it is; whether the row may be used."""
    if images.known[vertex] != mark:
        images.known[vertex] = mark
        rows, half = images.rows, 0.5 * face.resolution
        u, v, z = to_face(q, vertex, face.number)
        images.ahead[vertex] = z >= NEAR
        if z >= NEAR:
            alpha = max((face.farthest - z) / (face.farthest - 1.0), 0.0)
            rows[vertex, 0], rows[vertex, 1], rows[vertex, 2], rows[vertex, 3] = box_image(u, v, z, alpha, half)
            rows[vertex, 4] = u / z * half + half
            rows[vertex, 5] = v / z * half + half
    return bool(images.ahead[vertex])


@kernel(inline="always")
def begin_flood(flood: Flood, core: np.ndarray, epoch: int) -> Reach:
    """Let a set be its core, (c,) int32 triangles, no more than the largest set has."""
    for k in range(core.shape[0]):
        flood.triangles[k] = core[k]
        flood.seen[core[k]] = epoch
    return Reach(core.shape[0], 0, 0, 0)


@kernel()
def flood_from(mesh: Mesh, flood: Flood, goal: Goal, core: np.ndarray) -> Flooded:
    """Grow a core across safe edges whose inflated images touch a window of pixels.

    Args:
        flood: receives the set, what to draw of it, and its unsafe edges.
        core: (c,) int32 triangles, no more than the largest set has.

    Returns:
        No unsafe edges but -1 where one of them alone spoils the whole window at `goal.least_depth`, and thus at all
        depths.
    """
    unsafe = flood.unsafe
    reach = spread(mesh, flood, goal, core.shape[0], begin_flood(flood, core, goal.epoch), unsafe, True)
    for k in range(reach.stops):
        t, i = unsafe[k, 0], unsafe[k, 1] % 3
        unsafe[k, 0], unsafe[k, 1] = mesh.triangles[t, i], mesh.triangles[t, (i + 1) % 3]
    return Flooded(reach.size, reach.drawn, reach.drawn, reach.stops, 0)


@kernel()
def spread(mesh: Mesh, flood: Flood, goal: Goal, core: int, reach: Reach, stops: np.ndarray, may_fail: bool) -> Reach:
    """Let a set grow as far as safe edges lead.

    Args:
        core: how many triangles of the set, the first ones, are its core, which is drawn already.
        reach: how far it has come.
        stops: (3 largest, 2) int32, receives the edges where it ends: a triangle and 0, 1 or 2, or 3 more than that
            where only room was missing to go on. `reach.stops` are there already.
        may_fail: whether to stop at an edge that spoils the whole window at `goal.least_depth`.
    """
    u0, u1, v0, v1 = goal.window
    slack = 1e-3
    q, triangles, images, rows, seen = mesh.q, mesh.triangles, flood.images, flood.images.rows, flood.seen
    size, head, n_drawn, n_stops = reach
    while head < size:
        t = flood.triangles[head]
        head += 1
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ahead = look_at(q, images, a, goal.face, goal.mark)
        ahead &= look_at(q, images, b, goal.face, goal.mark)
        ahead &= look_at(q, images, c, goal.face, goal.mark)
        if head > core and (
            not ahead
            or (
                min(rows[a, 4], rows[b, 4], rows[c, 4]) - slack <= u1
                and max(rows[a, 4], rows[b, 4], rows[c, 4]) + slack >= u0
                and min(rows[a, 5], rows[b, 5], rows[c, 5]) - slack <= v1
                and max(rows[a, 5], rows[b, 5], rows[c, 5]) + slack >= v0
            )
        ):
            flood.drawn[n_drawn] = t
            n_drawn += 1
        for i in range(3):
            a, b = triangles[t, i], triangles[t, (i + 1) % 3]
            if ahead:
                touches = hull_touches(rows, a, b, goal.window)
            else:
                touches = edge_touches(q, a, b, goal, flood.sweep)
            if not touches:
                continue
            partner = find_partner(mesh, t, i, goal.epoch, seen)
            if partner >= 0 and seen[partner] == goal.epoch:
                continue
            if partner >= 0 and size < flood.triangles.shape[0]:
                flood.triangles[size] = partner
                seen[partner] = goal.epoch
                size += 1
                continue
            stops[n_stops, 0] = t
            stops[n_stops, 1] = i if partner < 0 else i + 3
            n_stops += 1
            if may_fail and spoils_all(q, a, b, goal, flood.sweep):
                return Reach(size, head, 0, -1)
    return Reach(size, head, n_drawn, n_stops)


@kernel()
def edge_touches(q: np.ndarray, a: int, b: int, goal: Goal, sweep: np.ndarray) -> bool:
    """Whether an edge's image, inflated for all depths, touches the window; a, b: rows of q; sweep: (4, 4) scratch."""
    touches = False
    for k in range(inflate_edge(q, a, b, goal.face.number, goal.face.resolution, goal.face.farthest, sweep)):
        touches |= hull_touches(sweep, 2 * k, 2 * k + 1, goal.window)
    return touches


@kernel()
def spoils_all(q: np.ndarray, a: int, b: int, goal: Goal, sweep: np.ndarray) -> bool:
    """Whether an edge's image, inflated for the least depth, holds the window at one of its ends; as `edge_touches`."""
    u0, u1, v0, v1 = goal.window
    for k in range(2 * inflate_edge(q, a, b, goal.face.number, goal.face.resolution, goal.least_depth, sweep)):
        if sweep[k, 0] <= u0 and sweep[k, 1] >= u1 and sweep[k, 2] <= v0 and sweep[k, 3] >= v1:
            return True
    return False


@kernel(inline="always")
def find_partner(mesh: Mesh, t: int, i: int, epoch: int, seen: np.ndarray) -> int:
    """A triangle strictly on the other side of edge i of t, one of the set where there is one; -1 for none."""
    e = mesh.triangle_edges[t, i]
    side = look(mesh, t)
    mine = side if mesh.triangles[t, i] < mesh.triangles[t, (i + 1) % 3] else -side
    partner = -1
    for j in range(mesh.edge_start[e], mesh.edge_start[e + 1]):
        other = mesh.edge_uses[j] >> 1
        its = look(mesh, other)
        if (-its if mesh.edge_uses[j] & 1 else its) == -mine:
            if seen[other] == epoch:
                partner = other
                break
            if partner < 0:
                partner = other
    return partner
