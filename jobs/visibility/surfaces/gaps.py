"""Narrow gaps: for each edge the triangles that are near it, and the part of the edge that each is near to.

Found once for a soup, whatever the cell; `seals` says which of them close anything for a cell. Points at most a
distance away from a triangle make up a convex body: a plate as thick as twice the distance, rounded at its rim. The
body is the union of a prism, three cylinders and three balls, so the part of an edge inside it is one interval, from
the least to the largest place in any of the seven.

Left out are edges in flat surfaces, between two triangles of one plane, since they are silhouettes from nowhere; and
edges and triangles that are smaller than the distance themselves: what they hide is as small as what is let go.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.surfaces.ranges import not_below
from jobs.visibility.surfaces.ray_tree import STACK, build_tree
from storage.base.kernels import allocating_kernel, kernel

#: Most triangles that are kept of an edge: those that are near to the longest parts of it.
MOST = 8
#: Lengths are taken this much shorter than asked, far more than rounding, so that no gap is wider than asked.
SHORTER = 1.0 - 1e-6
#: Where an edge meets a triangle in a corner, the triangle counts only if it stays near for more than this many
#: distances, or for half the edge.
BEYOND_CORNER = 4.0
#: A plane through an edge's triangles is one if it leaves no more than this part of their volume.
FLAT = 1e-12


class Near(NamedTuple):
    """What is near one edge."""

    triangle: np.ndarray  # (MOST,) int32
    part: np.ndarray  # (MOST, 2) float32, see `find_gaps`


class ClusterTree(NamedTuple):
    """A tree of boxes over clusters of triangles, see `ray_tree.build_tree`."""

    box: np.ndarray  # (nodes, 2, 3) float64
    right: np.ndarray  # (nodes,) int32
    cluster: np.ndarray  # (nodes,) int32
    start: np.ndarray  # (k + 1,) int32 offsets of the clusters into the triangles


@allocating_kernel()
def find_gaps(
    vertices: np.ndarray,
    triangles: np.ndarray,
    edge_vertices: np.ndarray,
    edge_start: np.ndarray,
    edge_uses: np.ndarray,
    cluster_start: np.ndarray,
    cluster_lo: np.ndarray,
    cluster_hi: np.ndarray,
    distance: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each edge the triangles, not its own, that are nearer than a distance.

    Args:
        vertices: (n, 3) int32 grid coordinates; triangles: (m, 3) int32 of some area.
        edge_vertices: (e, 2) int32 lower vertex first; edge_start, edge_uses: see `topology.edges`.
        cluster_start: (k + 1,) int32, cluster_lo, cluster_hi: (k, 3) float64 the triangles' clusters, see `soup`.
        distance: in grid units, positive.

    Returns:
        start: (e + 1,) int64 offsets into what follows, at most MOST for each edge.
        near: (g,) int32 triangles.
        part: (g, 2) float32 from where to where along the edge they are near, 0 at its lower vertex, 1 at the other.
    """
    edges = edge_vertices.shape[0]
    box, right, cluster, _ = build_tree(cluster_lo, cluster_hi)
    tree = ClusterTree(box, right, cluster, cluster_start)
    start = np.zeros(edges + 1, np.int64)
    room = 1024
    near = np.empty(room, np.int32)
    part = np.empty((room, 2), np.float32)
    stack = np.empty(STACK, np.int32)
    count = 0
    for e in range(edges):
        start[e + 1] = count
        if edge_start[e + 1] - edge_start[e] == 2 and _is_flat(
            vertices, triangles, edge_vertices, edge_start[e], edge_uses, e
        ):
            continue
        if room < count + MOST:
            room *= 2
            longer, longer_part = np.empty(room, np.int32), np.empty((room, 2), np.float32)
            longer[:count], longer_part[:count] = near[:count], part[:count]
            near, part = longer, longer_part
        beside = Near(near[count : count + MOST], part[count : count + MOST])
        count += _find_near(
            vertices, triangles, edge_vertices[e, 0], edge_vertices[e, 1], tree, distance, stack, beside
        )
        start[e + 1] = count
    return start, near[:count].copy(), part[:count].copy()


@kernel()
def _is_flat(
    vertices: np.ndarray, triangles: np.ndarray, edge_vertices: np.ndarray, first: int, edge_uses: np.ndarray, e: int
) -> bool:
    """Whether the two triangles of edge e, whose uses begin at `first`, lie in one plane, on both sides of the edge."""
    a, b = edge_vertices[e, 0], edge_vertices[e, 1]
    c = _third(triangles, edge_uses[first] >> 1, a, b)
    d = _third(triangles, edge_uses[first + 1] >> 1, a, b)
    ux, uy, uz = _minus(vertices, b, a)
    cx, cy, cz = _minus(vertices, c, a)
    dx, dy, dz = _minus(vertices, d, a)
    nx, ny, nz = uy * cz - uz * cy, uz * cx - ux * cz, ux * cy - uy * cx
    mx, my, mz = uy * dz - uz * dy, uz * dx - ux * dz, ux * dy - uy * dx
    off = abs(nx * dx + ny * dy + nz * dz)
    return off <= FLAT * (abs(nx * dx) + abs(ny * dy) + abs(nz * dz)) and nx * mx + ny * my + nz * mz < 0


@kernel(inline="always")
def _third(triangles: np.ndarray, t: int, a: int, b: int) -> int:
    """The corner of triangle t that is neither a nor b."""
    third = triangles[t, 0]
    for i in range(1, 3):
        if triangles[t, i] not in (a, b):
            third = triangles[t, i]
    return third


@kernel(inline="always")
def _minus(vertices: np.ndarray, v: int, w: int) -> tuple[float, float, float]:
    return (
        float(vertices[v, 0]) - float(vertices[w, 0]),
        float(vertices[v, 1]) - float(vertices[w, 1]),
        float(vertices[v, 2]) - float(vertices[w, 2]),
    )


@kernel()
def _find_near(
    vertices: np.ndarray,
    triangles: np.ndarray,
    a: int,
    b: int,
    tree: ClusterTree,
    distance: float,
    stack: np.ndarray,
    found: Near,
) -> int:
    """The triangles near the edge from vertex a to vertex b; returns how many. stack: (STACK,) int32 scratch."""
    box, cluster, near, part = tree.box, tree.cluster, found.triangle, found.part
    ux, uy, uz = _minus(vertices, b, a)
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    count = 0
    stack[0] = 0
    waiting = 1 if length >= distance else 0
    while waiting:
        waiting -= 1
        node = stack[waiting]
        apart = False
        for k in range(3):
            low = min(vertices[a, k], vertices[b, k]) - distance
            high = max(vertices[a, k], vertices[b, k]) + distance
            apart |= high < box[node, 0, k] or low > box[node, 1, k]
        if apart:
            continue
        if cluster[node] < 0:
            stack[waiting], stack[waiting + 1] = node + 1, tree.right[node]
            waiting += 2
            continue
        for t in range(tree.start[cluster[node]], tree.start[cluster[node] + 1]):
            v0, v1, v2 = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            shared = (v0 in (a, b)) + (v1 in (a, b)) + (v2 in (a, b))
            if shared == 2:
                continue
            apart, extent = False, 0.0
            for k in range(3):
                low = min(vertices[v0, k], vertices[v1, k], vertices[v2, k])
                high = max(vertices[v0, k], vertices[v1, k], vertices[v2, k])
                extent = max(extent, float(high) - float(low))
                apart |= max(vertices[a, k], vertices[b, k]) + distance < low
                apart |= min(vertices[a, k], vertices[b, k]) - distance > high
            if apart or extent < distance:
                continue
            begin, end = near_part(vertices, v0, v1, v2, a, b, distance * SHORTER)
            covered = (end - begin) * length
            if not covered > 0 or (shared and covered < min(BEYOND_CORNER * distance, 0.5 * length)):
                continue
            at = count
            if count < MOST:
                count += 1
            else:
                at = 0
                for k in range(1, MOST):
                    if part[k, 1] - part[k, 0] < part[at, 1] - part[at, 0]:
                        at = k
                if not end - begin > part[at, 1] - part[at, 0]:
                    continue
            near[at], part[at, 0], part[at, 1] = t, begin, end
    return count


@kernel()
def near_part(vertices: np.ndarray, v0: int, v1: int, v2: int, a: int, b: int, distance: float) -> tuple[float, float]:
    """Where the edge from vertex a to vertex b is at most `distance` away from a triangle: from, to, in parts of it.

    The first is above the second where it is nowhere.
    """
    ux, uy, uz = _minus(vertices, b, a)
    least, most = 2.0, -1.0
    # the prism: between two planes, inside of three
    ex, ey, ez = _minus(vertices, v1, v0)
    fx, fy, fz = _minus(vertices, v2, v0)
    nx, ny, nz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    n = np.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / n, ny / n, nz / n
    ax, ay, az = _minus(vertices, a, v0)
    rise, along = nx * ax + ny * ay + nz * az, nx * ux + ny * uy + nz * uz
    if min(rise, rise + along) > distance or max(rise, rise + along) < -distance:
        return least, most
    first, last = not_below(0.0, 1.0, rise + distance, along)
    first, last = not_below(first, last, distance - rise, -along)
    for i in range(3):
        if i == 0:
            v, w = v0, v1
        elif i == 1:
            v, w = v1, v2
        else:
            v, w = v2, v0
        ex, ey, ez = _minus(vertices, w, v)
        ax, ay, az = _minus(vertices, a, v)
        # towards the inside of the triangle
        ix, iy, iz = ny * ez - nz * ey, nz * ex - nx * ez, nx * ey - ny * ex
        first, last = not_below(first, last, ix * ax + iy * ay + iz * az, ix * ux + iy * uy + iz * uz)
        # the ball around v
        s0, s1 = _inside(ax, ay, az, ux, uy, uz, distance)
        if s0 <= s1:
            least, most = min(least, s0), max(most, s1)
        # the cylinder around v-w
        e = np.sqrt(ex * ex + ey * ey + ez * ez)
        ex, ey, ez = ex / e, ey / e, ez / e
        at, go = ex * ax + ey * ay + ez * az, ex * ux + ey * uy + ez * uz
        s0, s1 = _inside(
            ax - at * ex, ay - at * ey, az - at * ez, ux - go * ex, uy - go * ey, uz - go * ez, distance
        )  # fmt: skip
        s0, s1 = not_below(s0, s1, at, go)
        s0, s1 = not_below(s0, s1, e - at, -go)
        if s0 <= s1:
            least, most = min(least, s0), max(most, s1)
    if first <= last:
        least, most = min(least, first), max(most, last)
    return least, most


@kernel(inline="always")
def _inside(
    ax: float, ay: float, az: float, ux: float, uy: float, uz: float, radius: float
) -> tuple[float, float]:  # fmt: skip
    """The part of [0, 1] where the point a + s u is at most `radius` from the origin; empty where first > second."""
    c = ax * ax + ay * ay + az * az - radius * radius
    g = ux * ux + uy * uy + uz * uz
    h = ax * ux + ay * uy + az * uz
    if g <= 0.0:
        return (0.0, 1.0) if c <= 0 else (1.0, 0.0)
    root = h * h - g * c
    if root < 0.0:
        return 1.0, 0.0
    root = np.sqrt(root)
    return max((-h - root) / g, 0.0), min((-h + root) / g, 1.0)
