"""View cells: which cells there are, and what can be seen from each.

The octree is split until a cell's vLOD is small enough or the depth limit is reached. A task takes one octree key and
works out two levels below it; cells that must be split further are the roots of the next wave of tasks. A cell at the
depth limit whose vLOD is above the budget, if there is one, gets a coarser cut: see `jobs.cells.budget`.

Based on: J. Chhugani et al.: vLOD, IEEE TVCG 11(1), 2005, section 4 (a consistent level of detail for the whole scene,
then visibility, then smaller cells where the result is too large).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from jobs.cells.budget import coarsen
from jobs.visibility.engine import CellVisibility, Engine, EngineSettings
from jobs.visibility.surfaces.soup import Soup, build_soup
from storage.cells import octree
from storage.cells.octree import Octree
from storage.geometry_reader import Geometry
from storage.meshes.turned_away import Facets
from storage.model.cut import UNBOUNDED, choose_cut, possible_drawables
from storage.model.tables import CELL
from storage.model.tree import leaves

#: A cell whose vLOD is above the target stays whole where its children would save less than this part of its triangles,
#: on average: their number and their changes are stored for next to nothing. Only where one task knows all of them.
LEAST_SAVED = 0.1

#: Octree levels that one task covers below its root; fewer in the first wave, see `levels_of_task`.
LEVELS_PER_TASK = 2

#: Goes with a cell's key into the seed of the rays that measure what an approximate cell misses.
HOLD_OUT = 0x686F6C64


@dataclass(frozen=True)
class CellParameters:
    """What decides the view cells and what they hold. Lengths in model units."""

    octree: Octree
    view_lo: tuple[float, float, float]  # cells that do not touch this box are left out
    view_hi: tuple[float, float, float]
    max_depth: int  # deepest level of cells
    triangles_per_cell: int  # cells with a larger vLOD are split, where that saves something
    pixel_angle: float  # see storage.model.cut.pixel_angle
    pixel_error: float  # allowed error in pixels; raised where a cell would be above max_triangles
    max_triangles: int | None = None  # no cell reports more; None: whatever it takes
    engine: EngineSettings = field(default_factory=EngineSettings)

    def most_triangles(self, depth: int) -> int | None:
        """The largest vLOD that a cell at a depth may have, in triangles, at the allowed error; None: any."""
        if depth == self.max_depth or self.max_triangles is None:
            return self.max_triangles if depth == self.max_depth else self.triangles_per_cell
        return min(self.triangles_per_cell, self.max_triangles)


@dataclass(frozen=True)
class SubtreeResult:
    """The finished cells of one task, in Morton order, and the cells that must be split further."""

    cells: np.ndarray  # (k,) CELL
    offsets: np.ndarray  # (k + 1,) int64 into ids
    ids: np.ndarray  # (n,) uint32 the cells' vLODs one after the other, each sorted
    open_keys: list[int]  # sorted in Morton order


def compute_subtree(store: Geometry, root_key: int, parameters: CellParameters) -> SubtreeResult:
    """Work out the cells of the levels of one task below a key.

    The octree's own root is worked out too; any other root is known to need splitting.
    """
    task = _Task(store, root_key, parameters)
    finished = [cell for key in _first_keys(root_key, parameters) for cell in task.cells_of(key)]
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

    def __init__(self, store: Geometry, root_key: int, parameters: CellParameters) -> None:
        self.open_keys: list[int] = []  # cells found to need splitting below the task's last level, in Morton order
        self._expected_step = 1  # of the budget's ladder: that of the last cell, which often suits its neighbour
        self._store, self._parameters = store, parameters
        self._bottom = _bottom(root_key, parameters)
        self._cuts = _cuts(store, root_key, parameters)
        ids = _used(store, self._cuts)
        self._facets = store.facets(ids)
        self._engine = Engine(_gather(store, ids, parameters.engine), parameters.engine)

    def cells_of(self, key: int) -> list[_Cell]:
        """The finished cells that a key is parted into, in Morton order; those left open go to `open_keys`."""
        depth = octree.depth(key)
        most = self._parameters.most_triangles(depth)
        if (cell := self._whole(key, most)) is not None:
            return [cell]
        if depth == self._parameters.max_depth:
            assert most is not None, "without a budget the last cells are worked out whatever they see"
            return [self._coarsened(key, most)]
        if depth == self._bottom:
            self.open_keys.append(key)
            return []
        left_open = len(self.open_keys)
        children = _children_in_view(key, self._parameters)
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

    def _coarsened(self, key: int, most_triangles: int) -> _Cell:
        """A cell at the depth limit that reports too much, with a cut so coarse that it does not any more.

        Coarser drawables are read when they are tried, one cut at a time: most cells need none.
        """
        store, parameters = self._store, self._parameters

        def engine_for(cut: np.ndarray) -> Engine:
            return self._engine.on(_gather(store, cut, parameters.engine))

        def look(cut: np.ndarray) -> CellVisibility | None:
            return self._look(engine_for(cut), key, cut, most_triangles)

        coarser = coarsen(
            lambda pixel_error: _cut(store, key, parameters, pixel_error),
            lambda cut: int(store.drawables["triangles"][cut].sum(dtype=np.int64)),
            look,
            parameters.pixel_error,
            most_triangles,
            self._expected_step,
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


def triangles_needed(store: Geometry, root_key: int, parameters: CellParameters) -> int:
    """The most triangles that `compute_subtree` may read and hold for a key.

    An upper bound, 1.02 to 1.3 times the truth where it was measured, for a fifth of the time that all cuts take.
    """
    counts = store.drawables["triangles"]
    inside = _Leaves.of(store, parameters)
    bottom = _bottom(root_key, parameters)
    used = np.zeros(len(store.drawables), np.bool_)
    largest = 0
    for top in _first_keys(root_key, parameters):
        keys = [key for key in _below(top, bottom, parameters) if not inside.crowd(key, parameters)]
        if not keys:
            continue
        lo, hi = parameters.octree.boxes(np.array(keys, np.uint64))
        ids = possible_drawables(
            store.nodes, store.drawables, lo.min(axis=0), hi.max(axis=0), (hi - lo).min(axis=0),
            parameters.pixel_angle, _remembered(parameters.pixel_error),
        )  # fmt: skip
        used[ids] = True
        largest = max(largest, int(counts[ids].sum(dtype=np.int64)))
    held = int(counts[used].sum(dtype=np.int64))
    # a coarser cut, which a cell may need to keep the budget, is held beside the rest
    may_need_coarser = bottom == parameters.max_depth and parameters.max_triangles is not None
    return held + (largest if may_need_coarser else 0)


def levels_of_task(top: int, max_depth: int) -> int:
    """How many levels a task works out below a root at depth `top`.

    The first wave takes what is odd, so that the last one, which has by far the most cells, has whole tasks.
    """
    return (max_depth - top) % LEVELS_PER_TASK or LEVELS_PER_TASK


def _children_in_view(key: int, parameters: CellParameters) -> list[int]:
    """The children of a key that touch the view box, in Morton order."""
    keys = octree.children(key)
    lo, hi = parameters.octree.boxes(keys)
    touches = (lo <= parameters.view_hi).all(axis=1) & (hi >= parameters.view_lo).all(axis=1)
    return [int(k) for k in keys[touches]]


def _first_keys(root_key: int, parameters: CellParameters) -> list[int]:
    """The topmost cells that the task below a key may give."""
    return [root_key] if root_key == octree.ROOT else _children_in_view(root_key, parameters)


def _bottom(root_key: int, parameters: CellParameters) -> int:
    """The depth of the last cells that the task below a key works out."""
    top = octree.depth(root_key)
    return min(top + levels_of_task(top, parameters.max_depth), parameters.max_depth)


def _below(key: int, bottom: int, parameters: CellParameters) -> list[int]:
    """A key and all keys below it down to a depth that touch the view box."""
    level = [key]
    found = list(level)
    while octree.depth(level[0]) < bottom:
        level = [child for parent in level for child in _children_in_view(parent, parameters)]
        found += level
    return found


def _cuts(store: Geometry, root_key: int, parameters: CellParameters) -> dict[int, np.ndarray]:
    """The cuts of the cells that the task below a key may give: those that touch the view box and are not crowded."""
    inside = _Leaves.of(store, parameters)
    bottom = _bottom(root_key, parameters)
    keys = [key for first in _first_keys(root_key, parameters) for key in _below(first, bottom, parameters)]
    return {
        key: _cut(store, key, parameters, parameters.pixel_error) for key in keys if not inside.crowd(key, parameters)
    }


class _Leaves(NamedTuple):
    """The finest levels of all leaves, or of none where even what touches a cell may be coarser."""

    lo: np.ndarray  # (n, 3) boxes
    hi: np.ndarray
    triangles: np.ndarray  # (n,)

    @staticmethod
    def of(store: Geometry, parameters: CellParameters) -> _Leaves:
        """The leaves of a store."""
        finest = store.nodes["first_drawable"][leaves(store.nodes)]
        if _remembered(parameters.pixel_error) * parameters.pixel_angle > UNBOUNDED:
            finest = finest[:0]
        rows = store.drawables[finest]
        return _Leaves(*(np.ascontiguousarray(rows[name]) for name in ("lo", "hi", "triangles")))

    def crowd(self, key: int, parameters: CellParameters) -> bool:
        """Whether those that lie inside a cell with their whole box, and so are seen, are too many already.

        Such a cell is split or gets a coarser cut, and neither its cut nor a triangle is needed to know it.
        """
        most = parameters.most_triangles(octree.depth(key))
        if most is None:
            return False
        lo, hi = parameters.octree.box(key)
        inside = ((self.lo > lo) & (self.hi < hi)).all(axis=1)
        return int(self.triangles[inside].sum(dtype=np.int64)) > most


def _remembered(pixel_error: float) -> float:
    """An allowed error as the store will remember it, so that a reader of the store finds the very same cut."""
    return float(np.float32(pixel_error))


def _cut(store: Geometry, key: int, parameters: CellParameters, pixel_error: float) -> np.ndarray:
    """The drawables that stand for the whole model in a cell, with an allowed error in pixels."""
    lo, hi = parameters.octree.box(key)
    return choose_cut(store.nodes, store.drawables, lo, hi, parameters.pixel_angle, _remembered(pixel_error))


def _gather(store: Geometry, ids: np.ndarray, settings: EngineSettings) -> Soup:
    """The triangles of drawables (d,), sorted ids."""
    rows = store.drawables[ids]
    surfaces = store.surfaces(ids)
    return build_soup(
        ids, rows["one_sided"], surfaces.points, surfaces.triangles, surfaces.triangle_counts,
        settings.cluster_size, settings.seal / store.grid.step,
    )  # fmt: skip


def _used(store: Geometry, cuts: dict[int, np.ndarray]) -> np.ndarray:
    """Ids (n,) int64, sorted, of all drawables that occur in any of the cuts."""
    used = np.zeros(len(store.drawables), np.bool_)
    for cut in cuts.values():
        used[cut] = True
    return np.flatnonzero(used)
