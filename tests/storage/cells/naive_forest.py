"""The forest of `storage.cells.spanning_forest` as simply as it can be said: sweeps with dicts and lists."""

from __future__ import annotations

import numpy as np


def naive_forest(count: int, pairs: np.ndarray, longest: int) -> np.ndarray:
    """See `storage.cells.spanning_forest.spanning_forest`."""
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for a, b in sorted(map(tuple, pairs.tolist())):
        neighbours[a].append(b)
        neighbours[b].append(a)
    parents = np.full(count, -1, np.int64)
    free = np.ones(count, bool)
    for start in range(count):
        while free[start]:
            there = _sweep(start, neighbours, free, count)[0][-1]
            order, before = _sweep(there, neighbours, free, count)
            path = [order[-1]]
            while before[path[-1]] >= 0:
                path.append(before[path[-1]])
            order, before = _sweep(path[len(path) // 2], neighbours, free, longest)
            for cell in order:
                parents[cell] = before[cell]
                free[cell] = False
    return parents


def _sweep(start: int, neighbours: list[list[int]], free: np.ndarray, longest: int) -> tuple[list[int], dict[int, int]]:
    """Free cells within `longest` steps of start, nearest first, and the cell before each (-1 for start)."""
    before = {start: -1}
    order = [start]
    ring = [start]
    for _ in range(longest):
        next_ring = []
        for cell in ring:
            for beside in neighbours[cell]:
                if free[beside] and beside not in before:
                    before[beside] = cell
                    next_ring.append(beside)
        order.extend(next_ring)
        if not next_ring:
            break
        ring = next_ring
    return order, before
