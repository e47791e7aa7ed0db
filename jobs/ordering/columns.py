"""Columns of the matrix of boundaries by drawables: for each drawable where what is seen of it changes.

Two rows for each pair of cells that share a face: what comes on the way from the first to the second, and what goes.
Never dense: a column is the increasing list of its rows. The runs of all rows under an order are half of the length of
the order's tour, from the empty column through all others and back.

Based on: J. Chhugani, B. Purnomo, S. Krishnan, J. Cohen, S. Venkatasubramanian, D. Johnson, S. Kumar, vLOD:
High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005, section 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from storage.base.kernels import allocating_kernel


@dataclass(frozen=True)
class Columns:
    """Sparse columns: of `count` drawables, and an empty one behind them, at which every tour begins and ends."""

    offsets: np.ndarray  # (count + 2,) int64: column i has rows[offsets[i] : offsets[i + 1]]
    rows: np.ndarray  # (entries,) int32, increasing in each column
    height: int  # how many rows there are

    @staticmethod
    def made(sizes: ArrayLike, rows: ArrayLike, height: int) -> Columns:
        """Of sizes (count,) and all columns' rows one after the other."""
        offsets = np.concatenate([[0], np.cumsum(np.append(np.asarray(sizes, np.int64), 0))]).astype(np.int64)
        return Columns(offsets, np.ascontiguousarray(rows, np.int32), height)

    @property
    def count(self) -> int:
        """How many drawables there are: also the number of the empty column."""
        return len(self.offsets) - 2

    @property
    def sizes(self) -> np.ndarray:
        """How many rows each column has: (count,) int64."""
        return np.diff(self.offsets[:-1])


def columns_of_changes(sets: Sequence[np.ndarray], pairs: np.ndarray, count: int) -> Columns:
    """The columns of drawables 0 to count - 1: row 2k is what comes from cell pairs[k, 0] to
    pairs[k, 1], row 2k + 1 what goes.

    sets: (v,) sorted ids that are seen, for each cell; pairs: (p, 2) int64 cells that share a face.
    """
    offsets = np.cumsum([0, *(len(ids) for ids in sets)], dtype=np.int64)
    ids = np.concatenate([np.zeros(0, np.int64), *sets]).astype(np.int32)
    lists, heads = _changes(offsets, ids, np.ascontiguousarray(pairs, np.int64))
    rows, sizes = _by_column(heads, lists, count)
    return Columns.made(sizes, rows, len(heads) - 1)


@allocating_kernel()
def _changes(offsets: np.ndarray, ids: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each pair of cells the ids in the second alone, then those in the first alone: ids and where lists begin."""
    most = 0
    for pair in range(len(pairs)):
        for side in range(2):
            most += offsets[pairs[pair, side] + 1] - offsets[pairs[pair, side]]
    lists = np.empty(most, np.int32)
    heads = np.zeros(2 * len(pairs) + 1, np.int64)
    top = 0
    for pair in range(len(pairs)):
        for way in range(2):
            of, without = pairs[pair, 1 - way], pairs[pair, way]
            other, end = offsets[without], offsets[without + 1]
            for at in range(offsets[of], offsets[of + 1]):
                while other < end and ids[other] < ids[at]:
                    other += 1
                if other == end or ids[other] != ids[at]:
                    lists[top] = ids[at]
                    top += 1
            heads[2 * pair + way + 1] = top
    return lists[:top].copy(), heads


@allocating_kernel()
def _by_column(offsets: np.ndarray, ids: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lists of ids, one a row, to lists of rows, one an id, and how long these are."""
    sizes = np.zeros(count, np.int64)
    for at in range(len(ids)):
        sizes[ids[at]] += 1
    place = np.cumsum(sizes) - sizes
    rows = np.empty(len(ids), np.int32)
    for row in range(len(offsets) - 1):
        for at in range(offsets[row], offsets[row + 1]):
            rows[place[ids[at]]] = row
            place[ids[at]] += 1
    return rows, sizes
