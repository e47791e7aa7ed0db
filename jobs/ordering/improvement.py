"""2-opt and Or-opt on a block of a path: a stretch that is turned around, or up to three columns that go elsewhere.

Only edges to near columns are tried, and only from columns whose surroundings have changed. A block knows the columns
before and behind it and leaves them where they are; nothing in it moves by more than the block is long, so the work
follows the number of blocks.

Based on: G. A. Croes, A Method for Solving Traveling-Salesman Problems, 1958; I. Or, PhD thesis, Northwestern
University, 1976; J. L. Bentley (see `fragments`): neighbour lists and don't-look bits.
"""

from __future__ import annotations

import numpy as np

from jobs.ordering.columns import Columns
from jobs.ordering.distances import distance, steps
from jobs.ordering.nearest import Nearest
from storage.base.kernels import allocating_kernel, kernel

#: The longest stretch that Or-opt moves.
SEGMENT = 3

#: A distance that none reaches.
ANY = 1 << 40


def improved(columns: Columns, near: Nearest, stretch: np.ndarray) -> np.ndarray:
    """A block of a path in a shorter sequence, or in its own.

    near: of all columns, (count, k); stretch: (m + 2,) int64 the block between the columns around it, of which either
    may be the empty one. Returns the block alone, (m,) int64.
    """
    return _improved(columns.offsets, columns.rows, near.columns, near.apart, stretch)[1:-1]


@allocating_kernel()
def _improved(
    offsets: np.ndarray, rows: np.ndarray, near: np.ndarray, apart: np.ndarray, stretch: np.ndarray
) -> np.ndarray:
    path = stretch.copy()
    last = len(path) - 2  # places 1 to last may change
    gaps = steps(offsets, rows, path)  # from each place to the next
    places = np.full(len(offsets), -1, np.int32)
    for place in range(1, last + 1):
        places[path[place]] = place
    awake = np.ones(len(offsets), np.bool_)
    busy = True
    while busy:
        busy = False
        for member in stretch[1:-1]:
            while awake[member]:
                awake[member] = _turn(offsets, rows, near, apart, path, gaps, places, awake, member) or _move(
                    offsets, rows, near, apart, path, gaps, places, awake, member
                )
                busy = busy or awake[member]
    return path


@kernel()
def _reverse(path: np.ndarray, gaps: np.ndarray, places: np.ndarray, first: int, last: int) -> None:
    """Turns the places first to last around, and the gaps between them."""
    low, high = first, last - 1
    while low < high:
        gaps[low], gaps[high] = gaps[high], gaps[low]
        low, high = low + 1, high - 1
    low, high = first, last
    while low < high:
        path[low], path[high] = path[high], path[low]
        places[path[low]], places[path[high]] = low, high
        low, high = low + 1, high - 1


@kernel()
def _turn(
    offsets: np.ndarray,
    rows: np.ndarray,
    near: np.ndarray,
    apart: np.ndarray,
    path: np.ndarray,
    gaps: np.ndarray,
    places: np.ndarray,
    awake: np.ndarray,
    a: int,
) -> bool:
    """2-opt: the edges from a to b and from c to d, which is on the same side, for those from a to c and b to d."""
    i = places[a]
    for side in (1, -1):
        behind = 0 if side == 1 else 1  # the gap on that side of a place
        b = path[i + side]
        for e in range(near.shape[1]):
            c, far = near[a, e], apart[a, e]
            if c < 0 or far >= gaps[i - behind]:
                break
            j = places[c]
            if j < 0:
                continue
            d = path[j + side]
            limit = gaps[i - behind] + gaps[j - behind] - far
            other = distance(offsets, rows, b, d, limit)
            if other >= limit:
                continue
            if side == 1:
                first, last = min(i, j) + 1, max(i, j)
            else:
                first, last = min(i, j), max(i, j) - 1
            _reverse(path, gaps, places, first, last)
            if side == 1:
                gaps[first - 1], gaps[last] = far, other
            else:
                gaps[first - 1], gaps[last] = other, far
            awake[b] = awake[c] = awake[d] = True
            return True
    return False


@kernel()
def _move(
    offsets: np.ndarray,
    rows: np.ndarray,
    near: np.ndarray,
    apart: np.ndarray,
    path: np.ndarray,
    gaps: np.ndarray,
    places: np.ndarray,
    awake: np.ndarray,
    a: int,
) -> bool:
    """Or-opt: up to SEGMENT columns, of which a is the first or the last, to beside a column that is near to a."""
    i = places[a]
    for length in range(1, SEGMENT + 1):
        for side in range(1 if length == 1 else 2):
            start = i if side == 0 else i - length + 1
            end = start + length - 1
            if start < 1 or end > len(path) - 2:
                continue
            p, q = path[start - 1], path[end + 1]
            if apart[a, 0] >= gaps[start - 1] + gaps[end]:  # as much as can be won
                continue
            closed = distance(offsets, rows, p, q, ANY)
            won = gaps[start - 1] + gaps[end] - closed
            other = path[end] if side == 0 else path[start]
            for e in range(near.shape[1]):
                c, far = near[a, e], apart[a, e]
                if c < 0 or far >= won:
                    break
                j = places[c]
                if j < 0 or start <= j <= end:
                    continue
                for way in (1, -1):  # c, a ... other, d, or d, other ... a, c
                    if j + way == start or j + way == end:  # where it is: 2-opt turns it around
                        continue
                    d = path[j + way]
                    limit = won + gaps[j if way == 1 else j - 1] - far
                    joined = distance(offsets, rows, other, d, limit)
                    if joined >= limit:
                        continue
                    before, behind = (far, joined) if way == 1 else (joined, far)
                    if j > end:
                        stop = j if way == 1 else j - 1
                        at = stop - length + 1
                        _reverse(path, gaps, places, start, stop)
                        _reverse(path, gaps, places, start, at - 1)
                        gaps[start - 1] = closed
                    else:
                        at = j + 1 if way == 1 else j
                        _reverse(path, gaps, places, at, end)
                        _reverse(path, gaps, places, at + length, end)
                        gaps[end] = closed
                    if path[at] != (a if way == 1 else other):
                        _reverse(path, gaps, places, at, at + length - 1)
                    gaps[at - 1], gaps[at + length - 1] = before, behind
                    awake[other] = awake[p] = awake[q] = awake[c] = awake[d] = True
                    return True
    return False
