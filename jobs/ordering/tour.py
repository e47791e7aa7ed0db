"""The order of all drawables: a short tour through their columns.

Based on: vLOD (see `columns`), section 6, for the problem; D. Lemire, O. Kaser, E. Gutarra, Reordering Rows for Better
Compression: Beyond the Lexicographic Order, ACM TODS 37(3), 2012, for a tour of a large table pieced together from
several sorted orders of it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from jobs.ordering.columns import Columns
from jobs.ordering.fragments import Fragments
from jobs.ordering.identical import representatives
from jobs.ordering.improvement import improved
from jobs.ordering.nearest import FAR, Nearest, nearest_alike, nearest_among
from jobs.ordering.sampled import nearest_unvisited, sample
from jobs.ordering.signatures import DRAWS, alike_orders, draws, signatures

#: Columns whose nearest are looked for at once.
BLOCK = 4096

#: Places between two columns that stay, while those between them are improved.
STRETCH = 8192

#: How often the path is improved, each time between others.
SWEEPS = 2

#: How far to look in each order by signature, either way: for the nearest of all, and for the ends of fragments.
WINDOW, END_WINDOW = 4, 12

#: Near ends that each end of a fragment is tried with.
NEAR_ENDS = 6

#: Does the same for each of several blocks, in their order: `map`, or what gives them to workers.
Blockwise = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]


@dataclass(frozen=True)
class TourOptions:
    """How an order is looked for."""

    neighbours: Literal["minhash", "sampled"] = "minhash"  # by signature, or by the paper's one sample
    nearest: int = 16  # columns that the steps of a tour are tried to, for each by signature
    improve: bool = True  # 2-opt and Or-opt


def tour(columns: Columns, options: TourOptions | None = None, blockwise: Blockwise = map) -> np.ndarray:
    """An order of all drawables, (count,) int64: the one at each place. Those that never change come last.

    The order depends on columns and options alone.
    """
    options = options or TourOptions()
    stands_for = representatives(columns)
    sizes = columns.sizes
    members = np.flatnonzero((stands_for == np.arange(columns.count)) & (sizes > 0))
    if options.neighbours == "sampled":
        near = sampled_nearest(columns, members, blockwise)
        path = nearest_unvisited(members, near.columns, columns.count) if len(members) else members
    else:
        found = signed(columns, members, blockwise)
        near = scattered(columns, members, alike(columns, members, members, found, options.nearest, WINDOW, blockwise))
        path = _pieced(columns, members, found, near, blockwise)
    if options.improve:
        for sweep in range(SWEEPS):
            path = _swept(columns, near, path, sweep, blockwise)
    return spread(np.append(path, np.flatnonzero(sizes == 0)[:1]), stands_for)


def blocks_of(count: int, length: int) -> list[slice]:
    """0 to count - 1 in blocks of a length."""
    return [slice(first, min(first + length, count)) for first in range(0, count, length)]


def signed(columns: Columns, members: np.ndarray, blockwise: Blockwise) -> np.ndarray:
    """The signatures of members (m,): (m, DRAWS) uint32."""
    numbers = draws(columns.height)
    parts = blockwise(lambda block: signatures(columns, numbers, members[block]), blocks_of(len(members), BLOCK))
    return np.concatenate([np.zeros((0, DRAWS), np.uint32), *parts])


def alike(
    columns: Columns,
    members: np.ndarray,
    groups: np.ndarray,
    found: np.ndarray,
    most: int,
    window: int,
    blockwise: Blockwise,
) -> Nearest:
    """The nearest of members (m,) in other groups (m,), by their signatures (m, DRAWS): (m, most)."""
    orders = alike_orders(found)
    ranks = np.empty_like(orders)
    np.put_along_axis(ranks, orders.astype(np.int64), np.arange(len(members), dtype=np.int32)[None, :], axis=1)
    return _stacked(
        blockwise(
            lambda block: nearest_alike(columns, members, groups, orders, ranks, block, most, window),
            blocks_of(len(members), BLOCK),
        ),
        most,
    )


def sampled_nearest(columns: Columns, members: np.ndarray, blockwise: Blockwise) -> Nearest:
    """The nearest of each of members (m,) in the paper's one sample, all of it: of all columns, (count, k)."""
    candidates = sample(members)
    parts = blockwise(
        lambda block: nearest_among(columns, members[block], candidates, len(candidates)),
        blocks_of(len(members), BLOCK),
    )
    return scattered(columns, members, _stacked(parts, len(candidates)))


def scattered(columns: Columns, members: np.ndarray, near: Nearest) -> Nearest:
    """The nearest of members (m, k) as those of all columns: (count, k), none for the others."""
    shape = (columns.count, near.columns.shape[1])
    everyones = Nearest(np.full(shape, -1, np.int32), np.full(shape, FAR, np.int32))
    everyones.columns[members], everyones.apart[members] = near
    return everyones


def spread(chain: np.ndarray, stands_for: np.ndarray) -> np.ndarray:
    """All columns: those of a chain (c,) in its sequence, behind each those that it stands for, by number."""
    count = len(stands_for)
    place = np.full(count, -1)
    place[chain] = np.arange(len(chain))
    led = place < 0
    place[led] = place[stands_for[led]]
    return np.lexsort((np.arange(count), led, place))


def _stacked(parts: Iterable[Nearest], most: int) -> Nearest:
    found = [Nearest(np.zeros((0, most), np.int32), np.zeros((0, most), np.int32)), *parts]
    return Nearest(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def _pieced(
    columns: Columns, members: np.ndarray, found: np.ndarray, near: Nearest, blockwise: Blockwise
) -> np.ndarray:
    """One path (m,) through all members: from the shortest edges, then between the ends of what these make."""
    fragments = Fragments.single(columns.count)
    fragments.join(members, near.columns[members], near.apart[members])
    while True:
        open_ends = fragments.links[members, 1] < 0
        ends = members[open_ends]
        groups = fragments.groups(ends)
        if len(np.unique(groups)) <= 1:
            return fragments.path(members)
        others = alike(columns, ends, groups, found[open_ends], NEAR_ENDS, END_WINDOW, blockwise)
        fragments.join(ends, *others)


def _swept(columns: Columns, near: Nearest, path: np.ndarray, sweep: int, blockwise: Blockwise) -> np.ndarray:
    """A path, each block of which is improved on its own; in odd sweeps blocks begin in the middle of those before."""
    framed = np.concatenate([[columns.count], path, [columns.count]])
    shift = STRETCH // 2 if sweep % 2 and len(path) > STRETCH else 0
    bounds = [0, *range(shift or STRETCH, len(path), STRETCH), len(path)]
    stretches = [framed[first : end + 2] for first, end in itertools.pairwise(bounds) if first < end]
    return np.concatenate([path[:0], *blockwise(lambda stretch: improved(columns, near, stretch), stretches)])
