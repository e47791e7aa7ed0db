"""Flooding: from a small core to a set of triangles whose silhouettes cannot spoil the core's pixels.

See `occluders` for what the sets are used for, and for what makes an edge safe.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from jobs.visibility.cube_faces import NEAR, box_image, clip_triangle, inflate_edge, sweep_range, to_face


class Mesh(NamedTuple):
    """All triangles of a soup as a cell sees them."""

    q: np.ndarray  # (n, 3) float64 vertices in cell coordinates
    side: np.ndarray  # (m,) int8, see occluders.find_sides
    usable: np.ndarray  # (m,) bool, triangles that may occlude
    triangles: np.ndarray  # (m, 3) int32
    triangle_edges: np.ndarray  # (m, 3) int32, see topology.edges
    edge_start: np.ndarray  # (e + 1,) int32
    edge_uses: np.ndarray  # (3 m,) int32


@njit(cache=True, nogil=True, inline="always")
def _turn(mesh: Mesh, use: int) -> int:
    """Which side of an edge a triangle lies on as seen from the cell, for an entry of edge_uses: -1, 0 or +1."""
    side = mesh.side[use >> 1]
    return -side if use & 1 else side


@njit(cache=True, nogil=True)
def grow_core(mesh: Mesh, seed: int, first: int, last: int, cored: np.ndarray, core: np.ndarray) -> int:
    """What hangs together with `seed` by safe edges among triangles first ... last - 1; the number written to `core`.

    cored: (m,) bool, triangles that belong to a core already; core: (m,) int32.
    """
    count = 1
    core[0] = seed
    cored[seed] = True
    head = 0
    while head < count:
        t = core[head]
        head += 1
        for i in range(3):
            e = mesh.triangle_edges[t, i]
            mine = mesh.side[t] if mesh.triangles[t, i] < mesh.triangles[t, (i + 1) % 3] else -mesh.side[t]
            for j in range(mesh.edge_start[e], mesh.edge_start[e + 1]):
                other = mesh.edge_uses[j] >> 1
                if (
                    first <= other < last
                    and not cored[other]
                    and mesh.usable[other]
                    and _turn(mesh, mesh.edge_uses[j]) == -mine
                ):
                    cored[other] = True
                    core[count] = other
                    count += 1
    return count


@njit(cache=True, nogil=True)
def core_window(
    mesh: Mesh, core: np.ndarray, n_core: int, face: int, resolution: int, polygon: np.ndarray
) -> tuple[bool, int, int, int, int, float]:
    """Pixels (both ends included) whose centres a core may cover on a face, and its nearest depth there.

    Returns (any, i0, i1, j0, j1, depth). polygon: (4, 2) float64 scratch.
    """
    u0, u1, v0, v1 = np.inf, -np.inf, np.inf, -np.inf
    nearest = np.inf
    for k in range(n_core):
        a, b, c = mesh.triangles[core[k]]
        n, near, _ = clip_triangle(mesh.q, a, b, c, face, resolution, polygon)
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


@njit(cache=True, nogil=True)
def flood_from(
    mesh: Mesh,
    core: np.ndarray,
    n_core: int,
    face: int,
    resolution: int,
    least_depth: float,
    i0: int,
    i1: int,
    j0: int,
    j1: int,
    epoch: int,
    seen: np.ndarray,
    flood: np.ndarray,
    drawn: np.ndarray,
    unsafe: np.ndarray,
) -> tuple[int, int, int]:
    """Grow a core across safe edges whose inflated images touch the window of pixels [j0, j1] x [i0, i1].

    Args:
        mesh, core, n_core, face, resolution: as above.
        least_depth: depth of the nearest band that is of use.
        epoch: a number that no flood before had; seen: (m,) int32, set to it where a triangle is in the set.
        flood: (largest,) int32, receives the set; where it is full the flood stops, and edges there are unsafe.
        drawn: (largest,) int32, receives those of the set that may touch the window.
        unsafe: (3 largest, 2) int32, receives the vertices of the unsafe edges that touch the window.

    Returns:
        (triangles in the set, of these to draw, unsafe edges). Nothing is to draw where one unsafe edge alone spoils
        the whole window at `least_depth`, and thus at all depths.
    """
    window_u0, window_u1, window_v0, window_v1 = float(i0), i1 + 1.0, float(j0), j1 + 1.0
    half = 0.5 * resolution
    images = np.empty((3, 4), np.float64)
    sweep = np.empty((2, 8), np.float64)
    n_flood, n_drawn, n_unsafe = 0, 0, 0
    for k in range(min(n_core, flood.shape[0])):
        flood[n_flood] = core[k]
        seen[core[k]] = epoch
        n_flood += 1
    head = 0
    while head < n_flood:
        t = flood[head]
        head += 1
        ahead = True
        least_u, most_u, least_v, most_v = np.inf, -np.inf, np.inf, -np.inf
        for i in range(3):
            u, v, z = to_face(mesh.q, mesh.triangles[t, i], face)
            if z < NEAR:
                ahead = False
                break
            images[i, 0], images[i, 1], images[i, 2], images[i, 3] = box_image(u, v, z, 1.0, half)
            least_u, most_u = min(least_u, u / z), max(most_u, u / z)
            least_v, most_v = min(least_v, v / z), max(most_v, v / z)
        slack = 1e-3
        if not ahead or (
            least_u * half + half - slack <= window_u1 and most_u * half + half + slack >= window_u0
            and least_v * half + half - slack <= window_v1 and most_v * half + half + slack >= window_v0
        ):  # fmt: skip
            drawn[n_drawn] = t
            n_drawn += 1
        for i in range(3):
            a, b = mesh.triangles[t, i], mesh.triangles[t, (i + 1) % 3]
            if ahead:
                sweep[0, :4] = images[i]
                sweep[0, 4:] = images[(i + 1) % 3]
                n_sweeps = 1
            else:
                n_sweeps = inflate_edge(mesh.q, a, b, face, resolution, np.inf, sweep)
            if not _any_touches(sweep, n_sweeps, window_u0, window_u1, window_v0, window_v1):
                continue
            partner = _partner(mesh, t, i, epoch, seen)
            if partner >= 0 and seen[partner] == epoch:
                continue
            if partner >= 0 and n_flood < flood.shape[0]:
                flood[n_flood] = partner
                seen[partner] = epoch
                n_flood += 1
                continue
            unsafe[n_unsafe, 0] = a
            unsafe[n_unsafe, 1] = b
            n_unsafe += 1
            n_sweeps = inflate_edge(mesh.q, a, b, face, resolution, least_depth, sweep)
            for k in range(2 * n_sweeps):
                row, part = k >> 1, 4 * (k & 1)
                if (
                    sweep[row, part] <= window_u0 and sweep[row, part + 1] >= window_u1
                    and sweep[row, part + 2] <= window_v0 and sweep[row, part + 3] >= window_v1
                ):  # fmt: skip
                    return n_flood, 0, n_unsafe
    return n_flood, n_drawn, n_unsafe


@njit(cache=True, nogil=True)
def _any_touches(sweep: np.ndarray, n: int, u0: float, u1: float, v0: float, v1: float) -> bool:
    """Whether any of n swept rectangles touches the window [u0, u1] x [v0, v1]."""
    for k in range(n):
        s = sweep[k]
        if min(s[0], s[4]) > u1 or max(s[1], s[5]) < u0 or min(s[2], s[6]) > v1 or max(s[3], s[7]) < v0:
            continue
        t0, t1 = sweep_range(s, u0, u1, v0, v1)
        if t0 <= t1:
            return True
    return False


@njit(cache=True, nogil=True)
def _partner(mesh: Mesh, t: int, i: int, epoch: int, seen: np.ndarray) -> int:
    """A usable triangle strictly on the other side of edge i of t, one of the set where there is one; -1 for none."""
    e = mesh.triangle_edges[t, i]
    mine = mesh.side[t] if mesh.triangles[t, i] < mesh.triangles[t, (i + 1) % 3] else -mesh.side[t]
    partner = -1
    for j in range(mesh.edge_start[e], mesh.edge_start[e + 1]):
        other = mesh.edge_uses[j] >> 1
        if mesh.usable[other] and _turn(mesh, mesh.edge_uses[j]) == -mine:
            if seen[other] == epoch:
                return other
            if partner < 0:
                partner = other
    return partner
