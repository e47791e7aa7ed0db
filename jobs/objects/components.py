"""Welded connected components: union-find over welded vertices, and shells: over paired edges.

All components of a batch of meshes are found at once, so thousands of boxes of 12 triangles cost no more than one
mesh of the same size.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel


@allocating_kernel()
def find(parent: np.ndarray, i: int) -> int:
    """The root of i in a union-find forest (path halving)."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@allocating_kernel()
def unite(parent: np.ndarray, a: int, b: int) -> None:
    """Join the sets of a and b; the smaller root wins, so the result depends on nothing else."""
    a = find(parent, a)
    b = find(parent, b)
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b


@allocating_kernel()
def components(triangles: np.ndarray, vertices: int) -> tuple[np.ndarray, int]:
    """Components of triangles (m, 3) int32 that share welded vertices.

    Returns the component of each triangle, (m,) int32, numbered by their first triangles, and how many there are.
    """
    parent = np.arange(vertices).astype(np.int32)
    for t in range(len(triangles)):
        unite(parent, triangles[t, 0], triangles[t, 1])
        unite(parent, triangles[t, 1], triangles[t, 2])
    number = np.full(vertices, -1, np.int32)
    label = np.empty(len(triangles), np.int32)
    count = 0
    for t in range(len(triangles)):
        root = find(parent, triangles[t, 0])
        if number[root] < 0:
            number[root] = count
            count += 1
        label[t] = number[root]
    return label, count


@allocating_kernel()
def grouped(label: np.ndarray, groups: int) -> tuple[np.ndarray, np.ndarray]:
    """Stable counting sort: order (m,) int64 with equal labels together, start (groups + 1,) int64."""
    start = np.zeros(groups + 1, np.int64)
    for i in range(len(label)):
        start[label[i] + 1] += 1
    for g in range(groups):
        start[g + 1] += start[g]
    place = start[:-1].copy()
    order = np.empty(len(label), np.int64)
    for i in range(len(label)):
        order[place[label[i]]] = i
        place[label[i]] += 1
    return order, start


@allocating_kernel()
def outward_closed(points: np.ndarray, triangles: np.ndarray, twin: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Which groups of triangles are closed surfaces seen from outside: (groups,) bool.

    points (w, 3) int32; triangles (m, 3) int32 in groups start (groups + 1,); twin (3 m,) from `twins`. A group counts
    if every edge has exactly two triangles in opposite directions and each of its shells (triangles joined across
    edges) encloses a positive volume: two boxes that touch in a corner, one of them inside out, do not.
    """
    groups = len(start) - 1
    result = np.zeros(groups, np.bool_)
    parent = np.arange(len(triangles)).astype(np.int32)
    volume = np.zeros(len(triangles))
    scale = np.zeros(len(triangles))
    for g in range(groups):
        closed = start[g + 1] > start[g]
        for h in range(3 * start[g], 3 * start[g + 1]):
            if twin[h] < 0:
                closed = False
                break
        if not closed:
            continue
        origin = triangles[start[g], 0]
        for t in range(start[g], start[g + 1]):
            for e in range(3):
                unite(parent, t, twin[3 * t + e] // 3)
        for t in range(start[g], start[g + 1]):
            root = find(parent, t)
            ax = np.float64(points[triangles[t, 0], 0]) - points[origin, 0]
            ay = np.float64(points[triangles[t, 0], 1]) - points[origin, 1]
            az = np.float64(points[triangles[t, 0], 2]) - points[origin, 2]
            bx = np.float64(points[triangles[t, 1], 0]) - points[origin, 0]
            by = np.float64(points[triangles[t, 1], 1]) - points[origin, 1]
            bz = np.float64(points[triangles[t, 1], 2]) - points[origin, 2]
            cx = np.float64(points[triangles[t, 2], 0]) - points[origin, 0]
            cy = np.float64(points[triangles[t, 2], 1]) - points[origin, 1]
            cz = np.float64(points[triangles[t, 2], 2]) - points[origin, 2]
            x, y, z = ax * (by * cz - bz * cy), ay * (bz * cx - bx * cz), az * (bx * cy - by * cx)
            volume[root] += x + y + z
            scale[root] += abs(x) + abs(y) + abs(z)
        for t in range(start[g], start[g + 1]):
            if parent[t] == t and not volume[t] > 1e-12 * scale[t]:
                closed = False
                break
        result[g] = closed
    return result
