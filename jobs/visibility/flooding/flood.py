"""Flooding: from a small core to a set of triangles whose silhouettes cannot spoil the core's pixels.

See `occluders` for what the sets are used for, and for what makes an edge safe.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.images.cube_faces import NEAR, box_image, clip_triangle, hull_touches, inflate_edge, to_face
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
def core_window(
    q: np.ndarray,
    triangles: np.ndarray,
    core: np.ndarray,
    n_core: int,
    face: int,
    resolution: int,
    polygon: np.ndarray,
) -> tuple[bool, int, int, int, int, float]:
    """Pixels (both ends included) whose centres a core may cover on a face, and its nearest depth there.

    Returns (any, i0, i1, j0, j1, depth). polygon: (4, 2) float64 scratch.
    """
    u0, u1, v0, v1 = np.inf, -np.inf, np.inf, -np.inf
    nearest = np.inf
    for k in range(n_core):
        a, b, c = triangles[core[k], 0], triangles[core[k], 1], triangles[core[k], 2]
        n, near, _ = clip_triangle(q, a, b, c, face, resolution, polygon)
        if n:
            nearest = min(nearest, near)
        for i in range(n):
            u0 = min(u0, polygon[i, 0])
            u1 = max(u1, polygon[i, 0])
            v0 = min(v0, polygon[i, 1])
            v1 = max(v1, polygon[i, 1])
    if not (u0 < resolution and v0 < resolution and u1 > 0 and v1 > 0):
        return False, 0, 0, 0, 0, 0.0
    i0 = int(np.ceil(u0 - 0.5)) if u0 > 0 else 0
    i1 = int(np.floor(u1 - 0.5)) if u1 < resolution else resolution - 1
    j0 = int(np.ceil(v0 - 0.5)) if v0 > 0 else 0
    j1 = int(np.floor(v1 - 0.5)) if v1 < resolution else resolution - 1
    return i0 <= i1 and j0 <= j1, i0, i1, j0, j1, nearest


class Images(NamedTuple):
    """What has been worked out of the vertices on one face: rows are filled when they are first asked for."""

    known: np.ndarray  # (n,) int32, the mark of the last face for which the row is filled
    rows: (
        np.ndarray
    )  # (n, 6) float64: bounding rectangle of the inflated vertex (u0, u1, v0, v1), its own u and v, pixels
    ahead: np.ndarray  # (n,) bool: the vertex lies beyond NEAR; else the row is not to be used


@kernel(inline="always")
def look_at(
    q: np.ndarray,
    known: np.ndarray,
    rows: np.ndarray,
    ahead: np.ndarray,
    vertex: int,
    face: int,
    mark: int,
    half: float,
    farthest: float,
) -> bool:
    """Fill a vertex's row (see `Images`) for a face unless it is; whether the row may be used."""
    if known[vertex] != mark:
        known[vertex] = mark
        u, v, z = to_face(q, vertex, face)
        ahead[vertex] = z >= NEAR
        if z >= NEAR:
            alpha = max((farthest - z) / (farthest - 1.0), 0.0)
            rows[vertex, 0], rows[vertex, 1], rows[vertex, 2], rows[vertex, 3] = box_image(u, v, z, alpha, half)
            rows[vertex, 4] = u / z * half + half
            rows[vertex, 5] = v / z * half + half
    return ahead[vertex]


@kernel()
def flood_from(
    mesh: Mesh,
    images: Images,
    core: np.ndarray,
    n_core: int,
    face: int,
    mark: int,
    resolution: int,
    farthest: float,
    least_depth: float,
    window: tuple[int, int, int, int],
    epoch: int,
    seen: np.ndarray,
    flood: np.ndarray,
    drawn: np.ndarray,
    unsafe: np.ndarray,
    sweep: np.ndarray,
) -> tuple[int, int, int]:
    """Grow a core across safe edges whose inflated images touch a window of pixels.

    Args:
        mesh, core, n_core, face, resolution: as above; n_core is at most `largest`.
        images: of the vertices; mark: those that were filled for this face and this cell have it.
        farthest: nothing is deeper, and images are inflated for this depth.
        least_depth: of what the core may hide; at least 1.5.
        window: (i0, i1, j0, j1) pixels, both ends included.
        epoch: a number that no flood before had; seen: (m,) int32, set to it where a triangle is in the set.
        flood: (largest,) int32, receives the set; where it is full the flood stops, and edges there are unsafe.
        drawn: (largest,) int32, receives those of the set, but for the core, that may touch the window.
        unsafe: (3 largest, 2) int32, receives the vertices of the unsafe edges that touch the window.
        sweep: (4, 4) float64 scratch.

    Returns:
        (triangles in the set, those to draw, unsafe edges); the last is -1 where one unsafe edge alone spoils the whole
        window at `least_depth`, and thus at all depths.
    """
    for k in range(n_core):
        flood[k] = core[k]
        seen[core[k]] = epoch
    n_flood, n_drawn, n_unsafe = spread(
        mesh, images, face, mark, resolution, farthest, least_depth, window, epoch, seen, flood, n_core, 0, n_core,
        drawn, 0, unsafe, 0, sweep,
    )  # fmt: skip
    for k in range(n_unsafe):
        t, i = unsafe[k, 0], unsafe[k, 1] % 3
        unsafe[k, 0], unsafe[k, 1] = mesh.triangles[t, i], mesh.triangles[t, (i + 1) % 3]
    return n_flood, n_drawn, n_unsafe


@kernel()
def spread(
    mesh: Mesh,
    images: Images,
    face: int,
    mark: int,
    resolution: int,
    farthest: float,
    least_depth: float,
    window: tuple[int, int, int, int],
    epoch: int,
    seen: np.ndarray,
    flood: np.ndarray,
    n_core: int,
    head: int,
    n_flood: int,
    drawn: np.ndarray,
    n_drawn: int,
    stops: np.ndarray,
    n_stops: int,
    sweep: np.ndarray,
) -> tuple[int, int, int]:
    """Let a set grow as far as safe edges lead.

    Args: as for `flood_from`, and
        least_depth: 0 where it does not matter that an edge spoils the whole window.
        head: of the `n_flood` triangles in `flood` this many have been gone through; the first `n_core` are the core.
        stops: (3 largest, 2) int32, receives the edges where it ends: a triangle and 0, 1 or 2, or 3 more than that
            where only room was missing to go on. `n_stops` and `n_drawn` are there already.

    Returns:
        (triangles in the set, those to draw, stops); the last is -1 where an edge spoils the whole window.
    """
    u0, u1, v0, v1 = float(window[0]), window[1] + 1.0, float(window[2]), window[3] + 1.0
    half = 0.5 * resolution
    slack = 1e-3
    q, triangles = mesh.q, mesh.triangles
    known, rows, is_ahead = images.known, images.rows, images.ahead
    while head < n_flood:
        t = flood[head]
        head += 1
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ahead = look_at(q, known, rows, is_ahead, a, face, mark, half, farthest)
        ahead &= look_at(q, known, rows, is_ahead, b, face, mark, half, farthest)
        ahead &= look_at(q, known, rows, is_ahead, c, face, mark, half, farthest)
        if head > n_core and (
            not ahead
            or (
                min(rows[a, 4], rows[b, 4], rows[c, 4]) - slack <= u1
                and max(rows[a, 4], rows[b, 4], rows[c, 4]) + slack >= u0
                and min(rows[a, 5], rows[b, 5], rows[c, 5]) - slack <= v1
                and max(rows[a, 5], rows[b, 5], rows[c, 5]) + slack >= v0
            )
        ):
            drawn[n_drawn] = t
            n_drawn += 1
        for i in range(3):
            a, b = triangles[t, i], triangles[t, (i + 1) % 3]
            if ahead:
                touches = hull_touches(rows, a, b, u0, u1, v0, v1)
            else:
                touches = edge_touches(q, a, b, face, resolution, farthest, u0, u1, v0, v1, sweep)
            if not touches:
                continue
            partner = find_partner(mesh, t, i, epoch, seen)
            if partner >= 0 and seen[partner] == epoch:
                continue
            if partner >= 0 and n_flood < flood.shape[0]:
                flood[n_flood] = partner
                seen[partner] = epoch
                n_flood += 1
                continue
            stops[n_stops, 0] = t
            stops[n_stops, 1] = i if partner < 0 else i + 3
            n_stops += 1
            if least_depth > 0.0 and spoils_all(q, a, b, face, resolution, least_depth, u0, u1, v0, v1, sweep):
                return n_flood, 0, -1
    return n_flood, n_drawn, n_stops


@kernel()
def edge_touches(
    q: np.ndarray,
    a: int,
    b: int,
    face: int,
    resolution: int,
    farthest: float,
    u0: float,
    u1: float,
    v0: float,
    v1: float,
    sweep: np.ndarray,
) -> bool:
    """Whether an edge's image, inflated for all depths, touches a rectangle."""
    touches = False
    for k in range(inflate_edge(q, a, b, face, resolution, farthest, sweep)):
        touches |= hull_touches(sweep, 2 * k, 2 * k + 1, u0, u1, v0, v1)
    return touches


@kernel()
def spoils_all(
    q: np.ndarray,
    a: int,
    b: int,
    face: int,
    resolution: int,
    least_depth: float,
    u0: float,
    u1: float,
    v0: float,
    v1: float,
    sweep: np.ndarray,
) -> bool:
    """Whether an edge's image, inflated for a depth, holds a rectangle at one of its ends."""
    for k in range(2 * inflate_edge(q, a, b, face, resolution, least_depth, sweep)):
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
