"""What can be seen from every cell is read again: it lies in the cell's cut, and is as much as the table of cells says.

Cells are checked by runs in the order of their numbers. A run holds what the store's caches hold, however many cells
there are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jobs.checking.findings import Problems
from jobs.checking.workers import Place
from storage.base.errors import StoreError

#: Most cells of a run.
RUN = 256


class Run(NamedTuple):
    """Cells first ... end - 1 of a store, all in one shard."""

    first: int
    end: int


class CheckedRun(NamedTuple):
    """What was found of a run."""

    cells: int
    problems: Problems


def runs(shard_cells: Sequence[int], damaged: Sequence[bool]) -> Iterator[Run]:
    """All cells of the shards that are not damaged, as runs.

    shard_cells: how many cells each shard has, in the order of their numbers; damaged: of each shard.
    """
    ends = np.cumsum(np.asarray(shard_cells, np.int64)).tolist()
    for first, end, bad in zip([0, *ends], ends, damaged, strict=False):
        for start in range(first, first if bad else end, RUN):
            yield Run(start, min(start + RUN, end))


def check_run(place: Place, run: Run) -> CheckedRun:
    """Checks the vLODs of a run's cells."""
    checked, problems = 0, Problems()
    try:
        store = place.store
    except StoreError as error:
        problems.note([f"cells {run.first} to {run.end - 1} cannot be checked: {error}"])
        return CheckedRun(checked, problems)
    sizes = store.drawables["triangles"].astype(np.int64)
    for cell in (run.first + np.flatnonzero(store.cells["computed"][run.first : run.end])).tolist():
        try:
            vlod = store.vlod(cell)
        except StoreError as error:
            problems.note([str(error)])
            continue
        checked += 1
        row = store.cells[cell]
        cut = store.cut(cell)
        if len(vlod) and (vlod[0] < 0 or vlod[-1] >= len(sizes) or (np.diff(vlod) <= 0).any()):
            problems.note([f"cell {cell}: its vLOD does not hold increasing drawables of the store"])
        elif len(cut) != row["cut_drawables"] or sizes[cut].sum() != row["cut_triangles"]:
            problems.note([f"cell {cell}: its cut is not of the size that the table of cells says"])
        elif not np.isin(vlod, cut, assume_unique=True).all():
            problems.note([f"cell {cell}: its vLOD holds what is not in its cut"])
        elif sizes[vlod].sum() != row["triangles"]:
            problems.note([f"cell {cell}: its vLOD is not of the size that the table of cells says"])
    return CheckedRun(checked, problems)
