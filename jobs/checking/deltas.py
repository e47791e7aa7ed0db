"""Every change between two cells that share a face turns the vLOD of one into that of the other.

Cells are checked by runs of neighbours in the octree's order. A run holds what the store's caches hold and one vLOD,
however many cells there are; of a vLOD that is needed again only what is still there is not read again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jobs.checking.findings import Problems
from jobs.checking.workers import Place
from storage.base.errors import StoreError
from storage.cells.deltas import Delta

#: Most cells of a run.
RUN = 256


class Run(NamedTuple):
    """Cells first ... end - 1 of a store, all in one shard."""

    first: int
    end: int
    unreadable: tuple[tuple[int, int], ...]  # runs of cells, first and end, that lie in damaged shards


class CheckedRun(NamedTuple):
    """What was found of a run."""

    boundaries: int
    problems: Problems


def runs(shard_cells: Sequence[int], damaged: Sequence[bool]) -> Iterator[Run]:
    """All cells of the shards that are not damaged, as runs.

    shard_cells: how many cells each shard has, in the order of their numbers; damaged: of each shard.
    """
    ends = np.cumsum(np.asarray(shard_cells, np.int64)).tolist()
    bounds = list(zip([0, *ends], ends, strict=False))
    unreadable = tuple(bound for bound, bad in zip(bounds, damaged, strict=True) if bad)
    for (first, end), bad in zip(bounds, damaged, strict=True):
        for start in range(first, first if bad else end, RUN):
            yield Run(start, min(start + RUN, end), unreadable)


def check_run(place: Place, run: Run) -> CheckedRun:
    """Checks the vLODs of a run's cells, and the changes to all neighbours with higher numbers."""
    boundaries, problems = 0, Problems()
    try:
        store = place.store
    except StoreError as error:
        problems.note([f"cells {run.first} to {run.end - 1} cannot be checked: {error}"])
        return CheckedRun(boundaries, problems)
    held = np.zeros(len(store.drawables), np.bool_)
    for cell in (run.first + np.flatnonzero(store.cells["computed"][run.first : run.end])).tolist():
        try:
            vlod = store.vlod(cell)
        except StoreError as error:
            problems.note([str(error)])
            continue
        if len(vlod) and vlod[-1] >= len(held):
            problems.note([f"cell {cell}: its vLOD holds drawable {vlod[-1]}, the store has {len(held)}"])
            continue
        held[vlod] = True
        for other in store.neighbours(cell).tolist():
            if other < cell or any(first <= other < end for first, end in run.unreadable):
                continue
            try:
                after = store.vlod(other)
            except StoreError:
                continue  # said where this cell's turn comes
            boundaries += 1
            try:
                delta = store.delta(cell, other)
            except StoreError as error:
                problems.note([str(error)])
                continue
            if not _turns(held, vlod, delta, after):
                problems.note([f"the delta from cell {cell} to cell {other} does not turn one vLOD into the other"])
        held[vlod] = False
    return CheckedRun(boundaries, problems)


def _turns(held: NDArray[np.bool_], before: NDArray[np.int64], delta: Delta, after: NDArray[np.int64]) -> bool:
    """Whether a change drops nothing but what is there, adds nothing but what is not, and gives `after`.

    held: (drawables,) which are in `before`. The same again afterwards.
    """
    for ids in (*delta, after):
        if (ids[1:] <= ids[:-1]).any() or (len(ids) and ids[-1] >= len(held)):
            return False
    drops_held = bool(held[delta.dropped].all())
    held[delta.dropped] = False
    adds_new = not held[delta.added].any()
    held[delta.added] = True
    of_size = len(after) == len(before) - len(delta.dropped) + len(delta.added)
    gives = bool(held[after].all())
    held[delta.added] = False
    held[delta.dropped] = False
    held[before] = True
    return drops_held and adds_new and of_size and gives
