"""In how many rows two columns differ: their Hamming distance, and what a path through many of them costs.

Based on: vLOD (see `columns`), section 6: twice the runs of all rows are the length of the tour.
"""

from __future__ import annotations

import numpy as np

from jobs.ordering.columns import Columns
from storage.base.kernels import allocating_kernel, kernel


@kernel()
def distance(offsets: np.ndarray, rows: np.ndarray, one: int, other: int, limit: int) -> int:
    """In how many rows two columns differ; where that is `limit` or more, some number that is `limit` or more.

    offsets, rows: as in `Columns`.
    """
    a, a_end = offsets[one], offsets[one + 1]
    b, b_end = offsets[other], offsets[other + 1]
    differ = 0
    if abs((a_end - a) - (b_end - b)) >= limit:
        return limit
    while a < a_end and b < b_end:
        x, y = rows[a], rows[b]
        differ += x != y
        a += x <= y
        b += y <= x
        if differ >= limit:
            return limit
    return differ + (a_end - a) + (b_end - b)


@allocating_kernel()
def steps(offsets: np.ndarray, rows: np.ndarray, path: np.ndarray) -> np.ndarray:
    """The distances along a path of columns (m,): (m - 1,) int64."""
    far = np.empty(len(path) - 1, np.int64)
    for at in range(len(far)):
        far[at] = distance(offsets, rows, path[at], path[at + 1], 1 << 40)
    return far


def runs(columns: Columns, order: np.ndarray) -> int:
    """The runs of all rows when drawables stand in an order (count,)."""
    round_trip = np.concatenate([[columns.count], order, [columns.count]])
    return int(steps(columns.offsets, columns.rows, round_trip).sum()) // 2
