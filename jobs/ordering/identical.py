"""Columns that are the same: one stands for all, so that the nearest of a column are other ones.

In some shortest tour they stand side by side, by the triangle inequality.
"""

from __future__ import annotations

import numpy as np

from jobs.ordering.columns import Columns
from jobs.ordering.signatures import mixed
from storage.base.kernels import allocating_kernel


def representatives(columns: Columns) -> np.ndarray:
    """For each column the first that is the same as it: (count,) int64."""
    digests = _digests(columns.offsets, columns.rows, mixed(np.arange(columns.height, dtype=np.uint64)))
    order = np.argsort(digests, kind="stable")
    return _first_alike(columns.offsets, columns.rows, digests, order)


@allocating_kernel()
def _digests(offsets: np.ndarray, rows: np.ndarray, of_row: np.ndarray) -> np.ndarray:
    """The sum of the numbers of each column's rows, modulo 2^64."""
    digests = np.zeros(len(offsets) - 2, np.uint64)
    for column in range(len(digests)):
        total = np.uint64(0)
        for at in range(offsets[column], offsets[column + 1]):
            total += of_row[rows[at]]
        digests[column] = total
    return digests


@allocating_kernel()
def _first_alike(offsets: np.ndarray, rows: np.ndarray, digests: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Those that are the same, by digest and then row by row; order: columns by digest, then number."""
    first = np.arange(len(digests))
    head = 0
    for at in range(1, len(order)):
        if digests[order[at]] != digests[order[head]]:
            head = at
            continue
        a, b = offsets[order[head]], offsets[order[at]]
        size = offsets[order[head] + 1] - a
        same = offsets[order[at] + 1] - b == size
        entry = 0
        while same and entry < size:
            same = rows[a + entry] == rows[b + entry]
            entry += 1
        if same:
            first[order[at]] = order[head]
    return first
