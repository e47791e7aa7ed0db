"""View cells: which cells there are, and what can be seen from each.

The octree is split until a cell's vLOD is small enough or the depth limit is reached. A task takes one octree key and
works out two levels below it; cells that must be split further are the roots of the next wave of tasks. A cell at the
depth limit whose vLOD is above the budget, if there is one, gets a coarser cut: see `jobs.cells.budget`.

Based on: J. Chhugani et al.: vLOD, IEEE TVCG 11(1), 2005, section 4 (a consistent level of detail for the whole scene,
then visibility, then smaller cells where the result is too large).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jobs.cells.budget import coarsen
from jobs.cells.cuts import Leaves, cut_of, cuts_of
from jobs.cells.gather import gather, used
from jobs.cells.parameters import CellParameters
from jobs.cells.task_keys import bottom_of, children_in_view, first_keys
from jobs.visibility.engine import CellVisibility, Engine
from storage.cells import octree
from storage.geometry_reader import Geometry
from storage.meshes.turned_away import Facets
from storage.model.tables import CELL

#: A cell whose vLOD is above the target stays whole where its children would save less than this part of its triangles,
#: on average: their number and their changes are stored for next to nothing. Only where one task knows all of them.
LEAST_SAVED = 0.1

#: Goes with a cell's key into the seed of the rays that measure what an approximate cell misses.
HOLD_OUT = 0x686F6C64


@dataclass(frozen=True)
class SubtreeResult:
    """The finished cells of one task, in Morton order, and the cells that must be split further."""

    cells: np.ndarray  # (k,) CELL
    offsets: np.ndarray  # (k + 1,) int64 into ids
    ids: np.ndarray  # (n,) uint32 the cells' vLODs one after the other, each sorted
    open_keys: list[int]  # sorted in Morton order


def compute_subtree(
    store: Geometry,
    root_key: int,
    parameters: CellParameters,
    around: Leaves,
    alone: bool = False,
    most_held: int | None = None,
) -> SubtreeResult:
    """Work out the cells of the levels of one task below a key.

    The octree's own root is worked out too; any other root is known to need splitting. around: leaves, at least those
    inside the cell of the key. alone: work out the key's own cell and none below it. most_held: its cut has more
    triangles than this, so that it gets a coarser one of no more; only of a cell at the depth limit, alone.
    """
    task = _Task(store, root_key, parameters, around, alone, most_held)
    finished = [cell for key in first_keys(root_key, parameters, alone) for cell in task.cells_of(key)]
    sets = [cell.visible for cell in finished]
    cells = np.array([cell.row for cell in finished], CELL) if finished else np.zeros(0, CELL)
    offsets = np.concatenate([[0], np.cumsum([len(s) for s in sets], dtype=np.int64)]).astype(np.int64)
    ids = np.concatenate(sets).astype(np.uint32) if sets else np.zeros(0, np.uint32)
    return SubtreeResult(cells, offsets, ids, task.open_keys)


class _Cell(NamedTuple):
    """A finished cell."""

    row: np.ndarray  # () CELL
    visible: np.ndarray  # (k,) int64 sorted ids: its vLOD


class _Task:
    """The cells of one task, which share the triangles that any of them may see."""

    def __init__(
        self,
        store: Geometry,
        root_key: int,
        parameters: CellParameters,
        around: Leaves,
        alone: bool,
        most_held: int | None,
    ) -> None:
        self.open_keys: list[int] = []  # cells found to need splitting below the task's last level, in Morton order
        self._expected_step = 1  # of the budget's ladder: that of the last cell, which often suits its neighbour
        self._store, self._parameters = store, parameters
        self._bottom = bottom_of(root_key, parameters, alone)
        self._most_held = most_held
        self._cuts = cuts_of(store, root_key, parameters, around, alone) if most_held is None else {}
        ids = used(store, self._cuts.values())
        self._facets = store.facets(ids)
        self._engine = Engine(gather(store, ids, parameters.engine), parameters.engine)

    def cells_of(self, key: int) -> list[_Cell]:
        """The finished cells that a key is parted into, in Morton order; those left open go to `open_keys`."""
        depth = octree.depth(key)
        most = self._parameters.most_triangles(depth)
        if (cell := self._whole(key, most)) is not None:
            return [cell]
        if depth == self._parameters.max_depth:
            assert most is not None or self._most_held is not None, "else the last cells are worked out as they are"
            return [self._coarsened(key, most)]
        if depth == self._bottom:
            self.open_keys.append(key)
            return []
        left_open = len(self.open_keys)
        children = children_in_view(key, self._parameters)
        below = [cell for child in children for cell in self.cells_of(child)]
        if len(below) == len(children) and len(self.open_keys) == left_open:
            # all children are finished whole: did the split save enough?
            mean = float(np.mean([int(cell.row["triangles"]) for cell in below]))
            enough = int(mean / (1 - LEAST_SAVED))
            if (budget := self._parameters.max_triangles) is not None:
                enough = min(enough, budget)
            if most is not None and enough > most and (cell := self._whole(key, enough)) is not None:
                return [cell]
        return below

    def _whole(self, key: int, most_triangles: int | None) -> _Cell | None:
        """A cell at the allowed error; None where it reports more than `most_triangles`, or is known to be crowded."""
        cut = self._cuts.get(key)
        if cut is None:
            return None
        found = self._look(self._engine, key, cut, most_triangles)
        if found is None:
            return None
        return self._finished(self._engine, self._facets, key, cut, found, self._parameters.pixel_error)

    def _coarsened(self, key: int, most_triangles: int | None) -> _Cell:
        """A cell at the depth limit that reports too much, or has too large a cut, with one coarse enough.

        Coarser drawables are read when they are tried, one cut at a time: most cells need none.
        """
        store, parameters = self._store, self._parameters

        def engine_for(cut: np.ndarray) -> Engine:
            return self._engine.on(gather(store, cut, parameters.engine))

        def look(cut: np.ndarray) -> CellVisibility | None:
            return self._look(engine_for(cut), key, cut, most_triangles)

        coarser = coarsen(
            lambda pixel_error: cut_of(store, key, parameters, pixel_error),
            lambda cut: int(store.drawables["triangles"][cut].sum(dtype=np.int64)),
            look,
            parameters.pixel_error,
            most_triangles,
            self._expected_step,
            self._most_held,
        )
        self._expected_step = coarser.step
        # only approximate cells look at their cut once more
        engine = engine_for(coarser.cut) if parameters.engine.approximate else self._engine
        facets = store.facets(coarser.found.visible)
        return self._finished(engine, facets, key, coarser.cut, coarser.found, coarser.pixel_error)

    def _look(self, engine: Engine, key: int, cut: np.ndarray, most_triangles: int | None) -> CellVisibility | None:
        """What can be seen of a cut from a cell; None where that is more than `most_triangles`."""
        counts, step = self._store.drawables["triangles"], self._store.grid.step
        lo, hi = self._parameters.octree.box(key)
        if most_triangles is not None and int(counts[cut].sum(dtype=np.int64)) > most_triangles:
            inside = engine.reaching_into(lo / step, hi / step, cut)
            if int(counts[inside].sum(dtype=np.int64)) > most_triangles:
                return None
        return engine.visible_from(lo / step, hi / step, cut, most_triangles)

    def _finished(
        self, engine: Engine, facets: Facets, key: int, cut: np.ndarray, found: CellVisibility, pixel_error: float
    ) -> _Cell:
        """A finished cell; the engine of an approximate one holds the cut, `facets` all that is visible."""
        counts = self._store.drawables["triangles"]
        row = np.zeros((), CELL)
        row["key"] = key
        row["depth"] = octree.depth(key)
        row["lo"], row["hi"] = self._parameters.octree.box(key)
        row["computed"] = True
        row["pixel_error"] = pixel_error
        for prefix, ids in (("cut_", cut), ("", found.visible), ("proven_", found.proven)):
            row[f"{prefix}drawables"], row[f"{prefix}triangles"] = len(ids), counts[ids].sum(dtype=np.int64)
        turned = facets.turned_away(found.visible, row["lo"], row["hi"])
        row["turned_triangles"] = turned.triangle_counts.sum()
        settings = self._parameters.engine
        if settings.approximate:
            step, rng = self._store.grid.step, np.random.default_rng([HOLD_OUT, key])
            row["hold_out_rays"] = settings.hold_out_rays
            row["missed_rays"] = engine.count_misses(row["lo"] / step, row["hi"] / step, cut, found.visible, rng)
        return _Cell(row, found.visible)
