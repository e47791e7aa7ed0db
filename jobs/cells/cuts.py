"""The cuts of cells: the drawables that stand for the whole model in each, visible or not.

Where what lies inside a cell is too much already, neither its cut nor a triangle is needed to know that the cell is
split or gets a coarser cut.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jobs.cells.parameters import CellParameters
from jobs.cells.task_keys import bottom_of, children_in_view, first_keys
from storage.cells import octree
from storage.geometry_reader import Geometry
from storage.model.cut import UNBOUNDED, choose_cut
from storage.model.tree import leaves


class Leaves(NamedTuple):
    """The finest levels of leaves: what a cell sees of those that it touches."""

    lo: np.ndarray  # (n, 3) boxes
    hi: np.ndarray
    triangles: np.ndarray  # (n,)

    @staticmethod
    def of(store: Geometry, parameters: CellParameters) -> Leaves:
        """All leaves of a store, or none of them where even what touches a cell may be coarser."""
        finest = store.nodes["first_drawable"][leaves(store.nodes)]
        if remembered(parameters.pixel_error) * parameters.pixel_angle > UNBOUNDED:
            finest = finest[:0]
        rows = store.drawables[finest]
        return Leaves(*(np.ascontiguousarray(rows[name]) for name in ("lo", "hi", "triangles")))

    def within(self, key: int, parameters: CellParameters) -> Leaves:
        """Those that lie inside a cell with their whole box, and so are seen from it."""
        lo, hi = parameters.octree.box(key)
        inside = ((self.lo > lo) & (self.hi < hi)).all(axis=1)
        return Leaves(self.lo[inside], self.hi[inside], self.triangles[inside])

    def crowd(self, key: int, parameters: CellParameters) -> bool:
        """Whether a cell is split whatever is seen: it is too large, or these, which lie inside it, are too many."""
        if octree.depth(key) < parameters.min_depth:
            return True
        most = parameters.most_triangles(octree.depth(key))
        return most is not None and int(self.triangles.sum(dtype=np.int64)) > most


def uncrowded(key: int, bottom: int, parameters: CellParameters, around: Leaves) -> Iterator[int]:
    """A key and the keys below it down to a depth that touch the view box, without those that are known to be crowded.

    around: leaves, at least those inside the cell.
    """
    inside = around.within(key, parameters)
    if not inside.crowd(key, parameters):
        yield key
    if octree.depth(key) < bottom:
        for child in children_in_view(key, parameters):
            yield from uncrowded(child, bottom, parameters, inside)


def cuts_of(
    store: Geometry, root_key: int, parameters: CellParameters, around: Leaves, alone: bool = False
) -> dict[int, np.ndarray]:
    """The cuts of the cells that the task below a key may give: those that touch the view box and are not crowded.

    alone: of the task on the key's own cell.
    """
    bottom = bottom_of(root_key, parameters, alone)
    inside = around.within(root_key, parameters)
    return {
        key: cut_of(store, key, parameters, parameters.pixel_error)
        for first in first_keys(root_key, parameters, alone)
        for key in uncrowded(first, bottom, parameters, inside)
    }


def cut_of(store: Geometry, key: int, parameters: CellParameters, pixel_error: float) -> np.ndarray:
    """The drawables that stand for the whole model in a cell, with an allowed error in pixels: (c,) int64, sorted."""
    lo, hi = parameters.octree.box(key)
    return choose_cut(store.nodes, store.drawables, lo, hi, parameters.pixel_angle, remembered(pixel_error))


def remembered(pixel_error: float) -> float:
    """An allowed error as the store will remember it, so that a reader of the store finds the very same cut."""
    return float(np.float32(pixel_error))
