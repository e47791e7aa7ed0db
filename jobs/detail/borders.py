"""What the levels of one piece owe its neighbours: the border along which it was cut from them."""

from __future__ import annotations

import numpy as np

from jobs.objects.weld import mix, table_size, weld
from storage.kernels import allocating_kernel


@allocating_kernel()
def local_meshes(triangles: np.ndarray, start: np.ndarray, vertices: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Number the vertices of each group of triangles, (m, 3) int32 in groups start (groups + 1,), from zero.

    Returns the local triangles (m, 3) int32, the vertices that the groups use, one group after the other, int32, and
    where each group's begin (groups + 1,) int64, in the order of first use. vertices: how many there are in all.
    """
    group_of = np.full(vertices, -1, np.int32)
    number = np.empty(vertices, np.int32)
    local = np.empty((len(triangles), 3), np.int32)
    used = np.empty(3 * len(triangles), np.int32)
    used_start = np.zeros(len(start), np.int64)
    count = 0
    for g in range(len(start) - 1):
        used_start[g] = count
        for t in range(start[g], start[g + 1]):
            for e in range(3):
                v = triangles[t, e]
                if group_of[v] != g:
                    group_of[v] = g
                    number[v] = count - used_start[g]
                    used[count] = v
                    count += 1
                local[t, e] = number[v]
    used_start[len(start) - 1] = count
    return local, used[:count].copy(), used_start


@allocating_kernel()
def indices_of(points: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Where each of `wanted` (k, 3) int32 occurs in the distinct points (n, 3) int32: (k,) int32, all must."""
    n, k = len(points), len(wanted)
    both = np.empty((n + k, 3), np.int32)
    both[:n] = points
    both[n:] = wanted
    ids, first = weld(both, np.zeros(n + k, np.int32))
    return first[ids[n:]]


@allocating_kernel()
def border_kept(
    points: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    locked: np.ndarray,
    coarse_points: np.ndarray,
    coarse_triangles: np.ndarray,
) -> bool:
    """Whether a coarser level has every locked vertex and every border edge of the finest one.

    points (n, 3) int32, triangles (m, 3) int32, twin (3 m,), locked: vertex indices, all of the finest level.
    """
    n, k = len(points), len(coarse_points)
    both = np.empty((n + k, 3), np.int32)
    both[:n] = points
    both[n:] = coarse_points
    ids, _ = weld(both, np.zeros(n + k, np.int32))
    present = np.zeros(n + k, np.bool_)
    for v in range(n, n + k):
        present[ids[v]] = True
    for v in locked:
        if not present[ids[v]]:
            return False
    m = len(coarse_triangles)
    size = table_size(3 * m)
    table = np.full(size, -1, np.int64)
    for h in range(3 * m):
        a = np.int64(ids[n + coarse_triangles[h // 3, h % 3]])
        key = (a << 31) | np.int64(ids[n + coarse_triangles[h // 3, (h % 3 + 1) % 3]])
        slot = mix(key) & (size - 1)
        while table[slot] >= 0 and table[slot] != key:
            slot = (slot + 1) & (size - 1)
        table[slot] = key
    for h in range(3 * len(triangles)):
        if twin[h] >= 0:
            continue
        a = np.int64(ids[triangles[h // 3, h % 3]])
        key = (a << 31) | np.int64(ids[triangles[h // 3, (h % 3 + 1) % 3]])
        slot = mix(key) & (size - 1)
        while table[slot] >= 0 and table[slot] != key:
            slot = (slot + 1) & (size - 1)
        if table[slot] < 0:
            return False
    return True
