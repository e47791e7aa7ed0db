"""New columns in an order that others have: these keep their sequence, and each new one goes where it costs least.

So an edited model keeps the order of all that did not change. What is nearest to what has a place already comes first,
as in Prim's tree, and then counts as having a place; its own is beside one of those near it.

Based on: D. J. Rosenkrantz, R. E. Stearns, P. M. Lewis, An Analysis of Several Heuristics for the Traveling Salesman
Problem, SIAM Journal on Computing 6(3), 1977 (nearest insertion).
"""

from __future__ import annotations

import heapq

import numpy as np

from jobs.ordering.columns import Columns
from jobs.ordering.distances import distance
from jobs.ordering.identical import representatives
from jobs.ordering.tour import WINDOW, Blockwise, TourOptions, alike, signed, spread
from storage.base.kernels import allocating_kernel, kernel


def inserted(
    columns: Columns, former: np.ndarray, options: TourOptions | None = None, blockwise: Blockwise = map
) -> np.ndarray:
    """An order of all drawables, (count,) int64, in which those of `former` (f,) int64 keep their sequence.

    Depends on columns, former order and options alone. New drawables that never change come last, or beside a former
    one that never does.
    """
    options = options or TourOptions()
    stands_for = representatives(columns)
    led_by = np.full(columns.count, -1)
    led_by[stands_for[former[::-1]]] = former[::-1]  # of several that are the same, the first in the former order
    stands_for = np.where(led_by[stands_for] >= 0, led_by[stands_for], stands_for)
    has_place = np.zeros(columns.count, np.bool_)
    has_place[former] = True
    leads = stands_for == np.arange(columns.count)
    members = np.flatnonzero(leads & (columns.sizes > 0))
    new = ~has_place[members]
    found = signed(columns, members, blockwise)
    near = alike(columns, members, members, found, options.nearest, WINDOW, blockwise)
    chain = _inserted(
        columns.offsets, columns.rows, near.columns[new], near.apart[new], members[new], np.asarray(former, np.int64)
    )
    unchanging = np.flatnonzero(leads & (columns.sizes == 0) & ~has_place)
    return spread(np.append(chain, unchanging), stands_for)


@kernel()
def _best_place(
    offsets: np.ndarray, rows: np.ndarray, near: np.ndarray, after: np.ndarray, before: np.ndarray, column: int
) -> int:
    """Behind which column it costs least, of the places beside those that are near and have one; -1 for none."""
    best, least = -1, 1 << 40
    for other in near:
        if other < 0 or after[other] < 0:
            continue
        for side in range(2):
            a = int(other) if side == 0 else int(before[other])
            b = after[a]
            cost = (
                distance(offsets, rows, a, column, 1 << 40)
                + distance(offsets, rows, column, b, 1 << 40)
                - distance(offsets, rows, a, b, 1 << 40)
            )
            if cost < least:
                best, least = a, cost
    return best


@allocating_kernel()
def _inserted(
    offsets: np.ndarray, rows: np.ndarray, near: np.ndarray, apart: np.ndarray, new: np.ndarray, former: np.ndarray
) -> np.ndarray:
    """The chain of former (f,) and new (n,) columns; near, apart: (n, k) of the new ones."""
    count = len(offsets) - 2  # the empty column: before the first and behind the last
    after, before = np.full(count + 1, -1), np.full(count + 1, -1)
    last = count
    for column in former:
        after[last], before[column] = column, last
        last = column
    after[last], before[count] = count, last

    wanted_by = np.argsort(near.copy().reshape(-1), kind="mergesort")  # places in near, by the column that is near
    begins = np.searchsorted(near.copy().reshape(-1)[wanted_by], np.arange(count + 1))
    waiting = [
        (int(apart[place, e]), place)
        for place in range(len(new))
        for e in range(near.shape[1])
        if near[place, e] >= 0 and after[near[place, e]] >= 0
    ]
    heapq.heapify(waiting)
    left = 0
    for _ in range(len(new)):
        place = -1
        while place < 0 and len(waiting) > 0:
            _far, found = heapq.heappop(waiting)
            if after[new[found]] < 0:
                place = found
        while place < 0:  # nothing that is left is near to what has a place
            if after[new[left]] < 0:
                place = left
            left += 1
        column = new[place]
        a = _best_place(offsets, rows, near[place], after, before, column)
        if a < 0:
            a = before[count]
        b = after[a]
        after[a], before[column] = column, a
        after[column], before[b] = b, column
        for at in range(begins[column], begins[column + 1]):
            follower = wanted_by[at] // near.shape[1]
            if after[new[follower]] < 0:
                heapq.heappush(waiting, (int(apart[follower, wanted_by[at] % near.shape[1]]), int(follower)))
    chain = np.empty(len(former) + len(new), np.int64)
    column = after[count]
    for place in range(len(chain)):
        chain[place] = column
        column = after[column]
    return chain
