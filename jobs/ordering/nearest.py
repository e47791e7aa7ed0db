"""The nearest of each column: among those beside it in the orders by signature, by their exact distance.

A column's rows are marked once; each candidate then takes one look at a mark for each of its own rows.

Based on: what `signatures` is based on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.ordering.columns import Columns
from storage.base.kernels import allocating_kernel, kernel

#: A distance that none has.
FAR = np.iinfo(np.int32).max


class Nearest(NamedTuple):
    """For some columns the nearest others, the nearest first; of those that are as near, those found first."""

    columns: np.ndarray  # (m, k) int32; -1 where there are fewer than k
    apart: np.ndarray  # (m, k) int32 distances to them; FAR where there are fewer


def nearest_alike(
    columns: Columns,
    members: np.ndarray,
    groups: np.ndarray,
    orders: np.ndarray,
    ranks: np.ndarray,
    block: slice,
    most: int,
    window: int,
) -> Nearest:
    """The nearest of a block of members, in other groups, among those up to `window` places away in one of the orders.

    Args:
        columns: all columns.
        members: (m,) int64 columns, of which the nearest are looked for among themselves.
        groups: (m,) int64 of each member.
        orders: (draws, m) int32 places in `members`, sorted by signature.
        ranks: (draws, m) int32 where each member stands in each of the orders.
        block: of `members`.
        most: how many are kept of each.
        window: how far to look in each order, either way.
    """
    places = np.arange(*block.indices(len(members)))
    return Nearest(
        *_alike(
            columns.offsets,
            columns.rows,
            columns.height,
            members,
            groups,
            orders,
            ranks,
            places,
            int(most),
            int(window),
        )
    )


def nearest_among(columns: Columns, block: np.ndarray, candidates: np.ndarray, most: int) -> Nearest:
    """The nearest of a block of columns (m,) int64 among the same candidates (c,) int64, itself left out."""
    return Nearest(*_among(columns.offsets, columns.rows, columns.height, block, candidates, int(most)))


@kernel()
def mark(offsets: np.ndarray, rows: np.ndarray, column: int, marks: np.ndarray, with_: int) -> None:
    """Sets the marks (height,) uint8 of a column's rows."""
    for at in range(offsets[column], offsets[column + 1]):
        marks[rows[at]] = with_


@kernel()
def distance_to_marked(offsets: np.ndarray, rows: np.ndarray, size: int, column: int, marks: np.ndarray) -> int:
    """In how many rows a column differs from the one with `size` rows that are marked."""
    common = 0
    for at in range(offsets[column], offsets[column + 1]):
        common += marks[rows[at]]
    return size + (offsets[column + 1] - offsets[column]) - 2 * common


@kernel()
def _keep(found: np.ndarray, apart: np.ndarray, other: int, far: int) -> None:
    """Enters a column into the nearest (k,) of another, if it is nearer than the last of them."""
    place = len(found) - 1
    if far >= apart[place]:
        return
    while place > 0 and apart[place - 1] > far:
        found[place], apart[place] = found[place - 1], apart[place - 1]
        place -= 1
    found[place], apart[place] = other, far


@allocating_kernel()
def _alike(
    offsets: np.ndarray,
    rows: np.ndarray,
    height: int,
    members: np.ndarray,
    groups: np.ndarray,
    orders: np.ndarray,
    ranks: np.ndarray,
    block: np.ndarray,
    most: int,
    window: int,
) -> tuple[np.ndarray, np.ndarray]:
    found = np.full((len(block), most), -1, np.int32)
    apart = np.full((len(block), most), FAR, np.int32)
    marks = np.zeros(height, np.uint8)
    met = np.full(len(members), -1, np.int32)
    for at in range(len(block)):
        own = block[at]
        column = members[own]
        size = offsets[column + 1] - offsets[column]
        met[own] = at
        mark(offsets, rows, column, marks, 1)
        for draw in range(len(orders)):
            rank = ranks[draw, own]
            for place in range(max(rank - window, 0), min(rank + window + 1, len(members))):
                other = orders[draw, place]
                if met[other] == at or groups[other] == groups[own]:
                    continue
                met[other] = at
                candidate = members[other]
                if abs(offsets[candidate + 1] - offsets[candidate] - size) < apart[at, most - 1]:
                    far = distance_to_marked(offsets, rows, size, candidate, marks)
                    _keep(found[at], apart[at], candidate, far)
        mark(offsets, rows, column, marks, 0)
    return found, apart


@allocating_kernel()
def _among(
    offsets: np.ndarray, rows: np.ndarray, height: int, block: np.ndarray, candidates: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    found = np.full((len(block), most), -1, np.int32)
    apart = np.full((len(block), most), FAR, np.int32)
    marks = np.zeros(height, np.uint8)
    for at in range(len(block)):
        size = offsets[block[at] + 1] - offsets[block[at]]
        mark(offsets, rows, block[at], marks, 1)
        for candidate in candidates:
            if candidate != block[at]:
                far = distance_to_marked(offsets, rows, size, candidate, marks)
                _keep(found[at], apart[at], candidate, far)
        mark(offsets, rows, block[at], marks, 0)
    return found, apart
