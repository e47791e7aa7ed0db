"""What the levels of one piece owe its neighbours: the border along which it was cut from them."""

from __future__ import annotations

import numpy as np

from jobs.objects.weld import mix, table_size, weld
from storage.base.kernels import allocating_kernel


@allocating_kernel()
def indices_of(points: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Where each of `wanted` (k, 3) int32 first occurs in points (n, 3) int32: (k,) int32, all must."""
    n, k = len(points), len(wanted)
    both = np.empty((n + k, 3), np.int32)
    both[:n] = points
    both[n:] = wanted
    ids, first = weld(both, np.zeros(n + k, np.int32))
    return first[ids[n:]]


@allocating_kernel()
def same_places(points: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Which of points (n, 3) int32 lie where one of `wanted` (k, 3) int32 lies: (n,) bool."""
    n, k = len(points), len(wanted)
    both = np.empty((k + n, 3), np.int32)
    both[:k] = wanted
    both[k:] = points
    ids, first = weld(both, np.zeros(k + n, np.int32))
    there = np.empty(n, np.bool_)
    for i in range(n):
        there[i] = first[ids[k + i]] < k
    return there


@allocating_kernel()
def border_kept(
    points: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    locked: np.ndarray,
    coarse_points: np.ndarray,
    coarse_triangles: np.ndarray,
) -> bool:
    """Whether a coarser level has every locked vertex, and every border edge between such, of the finest one.

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
    stays = np.zeros(n, np.bool_)
    for v in locked:
        stays[v] = True
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
        if twin[h] >= 0 or not (stays[triangles[h // 3, h % 3]] and stays[triangles[h // 3, (h % 3 + 1) % 3]]):
            continue
        a = np.int64(ids[triangles[h // 3, h % 3]])
        key = (a << 31) | np.int64(ids[triangles[h // 3, (h % 3 + 1) % 3]])
        slot = mix(key) & (size - 1)
        while table[slot] >= 0 and table[slot] != key:
            slot = (slot + 1) & (size - 1)
        if table[slot] < 0:
            return False
    return True
