"""A spanning forest of few trees and short chains over the cells of a shard.

A tree's root is stored whole (a key set), every other cell is one delta away from its parent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: A cell is at most this many deltas away from a key set.
LONGEST_CHAIN = 16


def spanning_forest(count: int, pairs: NDArray[np.int64], longest: int = LONGEST_CHAIN) -> NDArray[np.int64]:
    """Parents (count,) int64 of cells 0 ... count - 1 in breadth-first trees; -1 for roots.

    pairs: (k, 2) int64, cells that share a face. No cell is more than `longest` steps below its root. Roots lie near
    the middle of what they serve (the midpoint of a longest path found by two sweeps). The same input gives the same
    forest.
    """
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
            root = path[len(path) // 2]
            order, before = _sweep(root, neighbours, free, longest)
            for cell in order:
                parents[cell] = before[cell]
                free[cell] = False
    return parents


def _sweep(
    start: int, neighbours: list[list[int]], free: NDArray[np.bool_], longest: int
) -> tuple[list[int], dict[int, int]]:
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
