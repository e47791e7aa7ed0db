"""Vertices identified by their position on the grid, and half-edges paired across the triangles' common edges.

Hash tables with linear probing: one pass, the same result on every machine, nothing to sort.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel

#: `twins` of a half-edge that no other triangle uses, and of one whose edge is not shared by exactly two in turn.
OPEN = -1
NON_MANIFOLD = -2


@allocating_kernel()
def table_size(entries: int) -> int:
    """The smallest power of two that leaves a hash table of `entries` at most half full."""
    size = 4
    while size < 2 * entries:
        size *= 2
    return size


@allocating_kernel()
def mix(value: np.int64) -> np.int64:
    """Spread the low 62 bits of a non-negative int64 over its low 30 bits; no step overflows."""
    low = value & 0x3FFFFFFF
    high = (value >> 30) & 0x7FFFFFFF
    h = (low * 668265263) ^ (high * 374761393)
    h ^= h >> 29
    h = (h & 0x7FFFFFFF) * 1274126177
    return h ^ (h >> 27)


@allocating_kernel()
def weld(points: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number the distinct positions of each group, in the order in which they first occur.

    points (n, 3) int32 grid coordinates within ±2^24; group (n,) int32, points of different groups are never welded.
    Returns ids (n,) int32, the welded vertex of each point; first (w,) int32, the first point of each welded vertex.
    """
    n = len(points)
    size = table_size(n)
    table = np.full(size, -1, np.int32)
    ids = np.empty(n, np.int32)
    first = np.empty(n, np.int32)
    count = 0
    for i in range(n):
        x, y, z, g = np.int64(points[i, 0]), np.int64(points[i, 1]), np.int64(points[i, 2]), np.int64(group[i])
        key = (x * 73856093) ^ (y * 19349663) ^ (z * 83492791) ^ (g * 49979693)
        slot = mix(key & 0x3FFFFFFFFFFFFFFF) & (size - 1)
        while True:
            j = table[slot]
            if j < 0:
                table[slot] = count
                ids[i] = count
                first[count] = i
                count += 1
                break
            k = first[j]
            if points[k, 0] == x and points[k, 1] == y and points[k, 2] == z and group[k] == g:
                ids[i] = j
                break
            slot = (slot + 1) & (size - 1)
    return ids, first[:count].copy()


@allocating_kernel()
def compacted(triangles: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The vertices (k,) int32 of n that triangles (m, 3) use, in their order, and triangles (m, 3) int32 over these."""
    number = np.full(n, -1, np.int32)
    for t in range(len(triangles)):
        for e in range(3):
            number[triangles[t, e]] = 0
    used = np.empty(n, np.int32)
    count = 0
    for v in range(n):
        if number[v] == 0:
            number[v] = count
            used[count] = v
            count += 1
    local = np.empty((len(triangles), 3), np.int32)
    for t in range(len(triangles)):
        for e in range(3):
            local[t, e] = number[triangles[t, e]]
    return used[:count].copy(), local


@allocating_kernel()
def is_degenerate(points: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether three grid points, (w, 3) int32 within ±2^24, lie on one line: exact integer arithmetic."""
    ux, uy, uz = (
        np.int64(points[b, 0]) - points[a, 0],
        np.int64(points[b, 1]) - points[a, 1],
        np.int64(points[b, 2]) - points[a, 2],
    )
    vx, vy, vz = (
        np.int64(points[c, 0]) - points[a, 0],
        np.int64(points[c, 1]) - points[a, 1],
        np.int64(points[c, 2]) - points[a, 2],
    )
    return uy * vz == uz * vy and uz * vx == ux * vz and ux * vy == uy * vx


@allocating_kernel()
def degenerate_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which triangles (m, 3) int32 have no area: (m,) bool. points (w, 3) int32."""
    flat = np.zeros(len(triangles), np.bool_)
    for t in range(len(triangles)):
        flat[t] = is_degenerate(points, triangles[t, 0], triangles[t, 1], triangles[t, 2])
    return flat


@allocating_kernel()
def twins(triangles: np.ndarray) -> np.ndarray:
    """Pair the half-edges of triangles (m, 3) int32 over welded vertices: (3 m,) int32.

    Half-edge 3 t + e runs from vertex e to vertex e + 1 of triangle t. Its twin is the half-edge that runs the other
    way, OPEN where there is none, NON_MANIFOLD where either direction is used more than once.
    """
    m = len(triangles)
    size = table_size(3 * m)
    table = np.full(size, -1, np.int32)
    repeated = np.zeros(3 * m, np.bool_)
    for h in range(3 * m):
        t, e = h // 3, h % 3
        a, b = np.int64(triangles[t, e]), np.int64(triangles[t, (e + 1) % 3])
        slot = mix((a << 31) | b) & (size - 1)
        while True:
            j = table[slot]
            if j < 0:
                table[slot] = h
                break
            if triangles[j // 3, j % 3] == a and triangles[j // 3, (j % 3 + 1) % 3] == b:
                repeated[j] = True
                repeated[h] = True
                break
            slot = (slot + 1) & (size - 1)
    twin = np.empty(3 * m, np.int32)
    for h in range(3 * m):
        t, e = h // 3, h % 3
        a, b = np.int64(triangles[t, e]), np.int64(triangles[t, (e + 1) % 3])
        slot = mix((b << 31) | a) & (size - 1)
        twin[h] = NON_MANIFOLD if repeated[h] else OPEN
        while True:
            j = table[slot]
            if j < 0:
                break
            if triangles[j // 3, j % 3] == b and triangles[j // 3, (j % 3 + 1) % 3] == a:
                twin[h] = NON_MANIFOLD if (repeated[h] or repeated[j]) else j
                break
            slot = (slot + 1) & (size - 1)
    return twin
