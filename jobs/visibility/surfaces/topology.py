"""Welding by position, edges with their triangles, clusters of neighbouring triangles, sheets, and boxes.

Kernels on plain arrays. All orders depend on the input's order alone, so results are the same on every machine.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel


@allocating_kernel()
def weld(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Identify equal points.

    Args:
        points: (n, 3) int32 grid coordinates.

    Returns:
        index: (n,) int32, the welded vertex of each point; vertices are numbered by first occurrence.
        first: (k,) int32, for each welded vertex the first point that lies there.
    """
    n = points.shape[0]
    size = 16
    while size < 2 * n:
        size *= 2
    mask = np.uint64(size - 1)
    table = np.full(size, -1, np.int32)
    index = np.empty(n, np.int32)
    first = np.empty(n, np.int32)
    count = 0
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        h = np.uint64(np.int64(x)) * np.uint64(0x9E3779B97F4A7C15)
        h ^= np.uint64(np.int64(y)) * np.uint64(0xC2B2AE3D27D4EB4F)
        h ^= np.uint64(np.int64(z)) * np.uint64(0x165667B19E3779F9)
        h ^= h >> np.uint64(29)
        h *= np.uint64(0xBF58476D1CE4E5B9)
        h ^= h >> np.uint64(32)
        slot = np.int64(h & mask)
        while True:
            v = table[slot]
            if v < 0:
                table[slot] = count
                first[count] = i
                index[i] = count
                count += 1
                break
            p = first[v]
            if points[p, 0] == x and points[p, 1] == y and points[p, 2] == z:
                index[i] = v
                break
            slot = (slot + 1) & (size - 1)
    return index, first[:count].copy()


@allocating_kernel()
def edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Edges of a triangle soup on welded vertices, each with all the triangles that share it.

    Args:
        triangles: (m, 3) int32 welded vertices, no two of a triangle equal.

    Returns:
        triangle_edges: (m, 3) int32, the edge from corner i to corner (i + 1) % 3.
        edge_vertices: (e, 2) int32, lower vertex first.
        start: (e + 1,) int32 offsets into uses.
        uses: (3 m,) int32, `2 * triangle + reversed`: reversed is 1 where the triangle runs from the higher vertex
            to the lower one.
    """
    m = triangles.shape[0]
    size = 16
    while size < 4 * m:
        size *= 2
    table = np.full(size, -1, np.int32)
    triangle_edges = np.empty((m, 3), np.int32)
    edge_vertices = np.empty((3 * m, 2), np.int32)
    count = 0
    for t in range(m):
        for i in range(3):
            a = triangles[t, i]
            b = triangles[t, (i + 1) % 3]
            if a > b:
                a, b = b, a
            h = np.uint64(a) * np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(b) * np.uint64(0xC2B2AE3D27D4EB4F)
            h ^= h >> np.uint64(31)
            h *= np.uint64(0xBF58476D1CE4E5B9)
            h ^= h >> np.uint64(32)
            slot = np.int64(h & np.uint64(size - 1))
            while True:
                e = table[slot]
                if e < 0:
                    table[slot] = count
                    edge_vertices[count, 0] = a
                    edge_vertices[count, 1] = b
                    triangle_edges[t, i] = count
                    count += 1
                    break
                if edge_vertices[e, 0] == a and edge_vertices[e, 1] == b:
                    triangle_edges[t, i] = e
                    break
                slot = (slot + 1) & (size - 1)
    start = np.zeros(count + 1, np.int32)
    for t in range(m):
        for i in range(3):
            start[triangle_edges[t, i] + 1] += 1
    for e in range(count):
        start[e + 1] += start[e]
    fill = start[:-1].copy()
    uses = np.empty(3 * m, np.int32)
    for t in range(m):
        for i in range(3):
            e = triangle_edges[t, i]
            backwards = 1 if triangles[t, i] > triangles[t, (i + 1) % 3] else 0
            uses[fill[e]] = 2 * t + backwards
            fill[e] += 1
    return triangle_edges, edge_vertices[:count].copy(), start, uses


@allocating_kernel()
def clusters(
    triangle_edges: np.ndarray,
    start: np.ndarray,
    uses: np.ndarray,
    triangle_drawable: np.ndarray,
    size: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Cut each drawable into clusters of at most `size` triangles that hang together by edges, breadth first.

    Args:
        triangle_edges, start, uses: from `edges`.
        triangle_drawable: (m,) int32, not decreasing.
        size: most triangles in a cluster.

    Returns:
        order: (m,) int32, the triangles, cluster by cluster; drawables keep their order.
        offsets: (k + 1,) int32, where the clusters begin in `order`; a cluster never spans two drawables.
    """
    m = triangle_edges.shape[0]
    order = np.empty(m, np.int32)
    offsets = np.empty(m + 1, np.int32)
    taken = np.zeros(m, np.bool_)
    placed = 0
    k = 0
    for seed in range(m):
        if taken[seed]:
            continue
        begin = placed
        offsets[k] = begin
        k += 1
        order[placed] = seed
        taken[seed] = True
        placed += 1
        head = begin
        while head < placed and placed - begin < size:
            t = order[head]
            head += 1
            for i in range(3):
                e = triangle_edges[t, i]
                for j in range(start[e], start[e + 1]):
                    other = uses[j] >> 1
                    if not taken[other] and triangle_drawable[other] == triangle_drawable[t] and placed - begin < size:
                        taken[other] = True
                        order[placed] = other
                        placed += 1
    offsets[k] = placed
    return order, offsets[: k + 1].copy()


@allocating_kernel()
def sheets(triangle_edges: np.ndarray, start: np.ndarray, uses: np.ndarray, see_through: np.ndarray) -> np.ndarray:
    """Number what hangs together by edges, whatever drawables it belongs to, as long as it is of one kind.

    Args:
        triangle_edges, start, uses: from `edges`.
        see_through: (m,) bool the kind.

    Returns:
        (m,) int32 the sheet of each triangle, numbered by first occurrence.
    """
    m = triangle_edges.shape[0]
    sheet = np.full(m, -1, np.int32)
    stack = np.empty(m, np.int32)
    count = 0
    for seed in range(m):
        if sheet[seed] >= 0:
            continue
        sheet[seed] = count
        stack[0] = seed
        waiting = 1
        while waiting:
            waiting -= 1
            t = stack[waiting]
            for i in range(3):
                e = triangle_edges[t, i]
                for j in range(start[e], start[e + 1]):
                    other = uses[j] >> 1
                    if sheet[other] < 0 and see_through[other] == see_through[t]:
                        sheet[other] = count
                        stack[waiting] = other
                        waiting += 1
        count += 1
    return sheet


@allocating_kernel()
def boxes(vertices: np.ndarray, triangles: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The boxes around triangles that follow one another.

    Args:
        vertices: (n, 3) int32; triangles: (m, 3) int32.
        start: (k + 1,) offsets into the triangles, increasing.

    Returns:
        lo, hi: (k, 3) int32.
    """
    k = len(start) - 1
    lo, hi = np.empty((k, 3), np.int32), np.empty((k, 3), np.int32)
    for b in range(k):
        for i in range(3):
            lo[b, i] = hi[b, i] = vertices[triangles[start[b], 0], i]
        for t in range(start[b], start[b + 1]):
            for c in range(3):
                for i in range(3):
                    x = vertices[triangles[t, c], i]
                    lo[b, i], hi[b, i] = min(lo[b, i], x), max(hi[b, i], x)
    return lo, hi
