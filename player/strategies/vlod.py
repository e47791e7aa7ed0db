"""The precomputed strategy: the vLOD of the cell that holds the eye, tested against the frustum.

The list of a cell is made once, when the eye enters it. Outside the computed cells, until a cell's list has arrived,
and where it cannot be read, the frustum strategy answers instead: there is always a picture.

Based on: Chhugani et al., vLOD: High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005,
section 6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from player.camera.view import Boxes, Vector, View, boxes_between, boxes_in_frustum, normalised
from player.loading.prefetch import Loader
from player.renderer.facet_table import CellBox
from player.shown_model import ShownModel
from player.strategies.frustum import Frustum
from player.strategies.strategy import Choice
from storage.model.cut import choose_cut
from storage.model.tree import overlapping

Ids = NDArray[np.int64]

#: Threads that read lists: one where they are waited for, so that what is fetched is the same in every run.
_WAITED_FOR, _IN_PASSING = 1, 2

#: Bytes of lists above which those of cells that are not near are forgotten.
_LISTS_KEPT = 1 << 26

#: How far ahead along the motion cells are looked up, in edge lengths of the present cell.
_STEPS_AHEAD = (0.6, 1.2, 1.8, 2.4)


class Vlod:
    """From-region visibility out of the store."""

    def __init__(self, model: ShownModel, *, pixel_error: float, wait: bool) -> None:
        """wait: lists of cells are waited for as long as they can be read; otherwise they come when they come."""
        self.pixel_error = pixel_error
        self._model = model
        self._wait = wait
        self._frustum = Frustum(model, pixel_error=pixel_error)
        self._sets: dict[int, Ids] = {}  # of the present cell, of those that may be entered next, and of former ones
        self._loader: Loader[int, Ids] = Loader(self._load, _WAITED_FOR if wait else _IN_PASSING)
        self._next: list[int] = []
        self._cell = -1
        self._listed: tuple[int, float] | None = None
        self._list: Ids = np.zeros(0, np.int64)
        self._boxes = Boxes(np.zeros((0, 3)), np.zeros((0, 3)))
        self._within: CellBox | None = None
        self._ahead_for: tuple[object, ...] | None = None

    def choose(self, view: View) -> Choice:
        """The part of the cell's vLOD that the frustum touches."""
        if arrived := self._loader.collect():
            self._sets |= arrived
        cell = self._cell_of(view.position)
        if cell != self._cell:
            self._enter(cell)
        ids = self._cell_list(cell) if cell >= 0 else None
        if ids is None:
            self._frustum.pixel_error = self.pixel_error
            instead = self._frustum.choose(view).drawables
            return Choice(instead, cell, computed=False, missing=self._loader.failures([cell]).get(cell))
        return Choice(
            ids[boxes_in_frustum(view, self._boxes)],
            cell,
            computed=True,
            within=self._within,
            approximate=self.pixel_error != self._model.pixel_error,
        )

    def ahead(self, view: View, motion: Vector) -> Ids | None:
        """The rest of the cell's list, then what the cells ahead add to it, then what the other neighbours add."""
        if self._cell < 0:
            return self._frustum.ahead(view, motion)
        cells = self._cells_ahead(view, motion)
        if cells != self._next:
            self._next = cells
            self._wish()
        known = tuple(cell for cell in cells if cell in self._sets)
        if self._wait and len(known) < len(cells):
            self._sets |= self._loader.wait_for([cell for cell in cells if cell not in self._sets])
            known = tuple(cell for cell in cells if cell in self._sets)
        state = (self._cell, known, self.pixel_error)
        if state == self._ahead_for:
            return None
        self._ahead_for = state
        lists = [self._at_detail(cell, self._sets[cell]) for cell in (self._cell, *known) if cell in self._sets]
        if not lists:
            return None
        joined = np.concatenate(lists)
        _, first = np.unique(joined, return_index=True)
        return joined[np.sort(first)]

    def close(self) -> None:
        """Stops the loading threads."""
        self._loader.close()

    def _cell_of(self, position: Vector) -> int:
        """The computed cell that holds the eye, -1 if there is none."""
        if self._cell >= 0:
            row = self._model.store.cells[self._cell]
            if (row["lo"] < position).all() and (position < row["hi"]).all():
                return self._cell
        return int(self._model.store.cell_at(position[None])[0])

    def _enter(self, cell: int) -> None:
        """The eye is in another cell now; from the former one it came, and may go back."""
        if self._cell >= 0:
            self._next = [self._cell, *self._next]
        self._cell = cell
        if cell >= 0:
            self._wish()
            if self._wait and cell not in self._sets:
                self._sets |= self._loader.wait_for([cell])

    def _wish(self) -> None:
        """Asks for the present cell before all others, and forgets those that are not near if all take too much."""
        near = list(dict.fromkeys([self._cell, *self._next]))
        if sum(ids.nbytes for ids in self._sets.values()) > _LISTS_KEPT:
            self._sets = {cell: self._sets[cell] for cell in near if cell in self._sets}
        self._loader.wish([cell for cell in near if cell not in self._sets])

    def _cell_list(self, cell: int) -> Ids | None:
        """The cell's list at the allowed error; None while it is not there."""
        if self._listed != (cell, self.pixel_error):
            ids = self._sets.get(cell)
            if ids is None:
                return None
            self._list = self._at_detail(cell, ids)
            rows = self._model.store.drawables[self._list]
            self._boxes = boxes_between(rows["lo"], rows["hi"])
            row = self._model.store.cells[cell]
            self._within = CellBox(row["lo"].copy(), row["hi"].copy())
            self._listed = (cell, self.pixel_error)
        return self._list

    def _at_detail(self, cell: int, ids: Ids) -> Ids:
        """The cell's list, with the cut chosen anew where another error is allowed than the store was built for.

        What is seen is carried over to other levels by the nodes that overlap: an approximation, since another level
        of a node can be seen where this one cannot.
        A cell that was built coarser, to keep the most triangles that a cell may have, stays that much coarser.
        """
        store = self._model.store
        if self.pixel_error == self._model.pixel_error:
            return ids
        row = store.cells[cell]
        error = float(row["pixel_error"]) * (self.pixel_error / self._model.pixel_error)
        angle = store.manifest.pixel_angle
        cut = choose_cut(store.nodes, store.drawables, row["lo"], row["hi"], angle, error)
        return cut[overlapping(store.nodes, self._model.nodes_of(cut), self._model.nodes_of(ids))]

    def _load(self, cell: int) -> Ids:
        """The cell's vLOD."""
        return self._model.store.vlod(cell)

    def _cells_ahead(self, view: View, motion: Vector) -> list[int]:
        """Computed cells that may be entered next, the likeliest first."""
        store = self._model.store
        direction = normalised(motion)
        if not direction.any():
            direction = view.forward
        row = store.cells[self._cell]
        edge = float((row["hi"] - row["lo"]).max())
        on_the_way = store.cell_at(view.position + direction * edge * np.array(_STEPS_AHEAD)[:, None])
        around = store.neighbours(self._cell)
        centres = (store.cells["lo"][around] + store.cells["hi"][around]) / 2
        cosine = normalised(centres - view.position) @ direction
        order = np.lexsort((around, -np.round(cosine, 1)))  # rounded: the order does not change with every small turn
        ahead = [int(c) for c in on_the_way if c >= 0] + around[order].tolist()
        return [cell for cell in dict.fromkeys(ahead) if cell != self._cell]
