"""What is known of cells before it is read what can be seen from them: the hierarchy, their boxes and cuts."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from storage.cells.group import Group, Tree
from storage.cells.octree import MAX_DEPTH, decode
from storage.model.cut import choose_cut


class KnownCells:
    """What codecs of groups go by: the same for the writer and for every reader."""

    def __init__(self, nodes: np.ndarray, drawables: np.ndarray, pixel_angle: float) -> None:
        """nodes, drawables: NODE and DRAWABLE; pixel_angle: the build's (see `storage.model.cut`)."""
        self._nodes, self._drawables = nodes, drawables
        self._pixel_angle = pixel_angle

    @cached_property
    def tree(self) -> Tree:
        """The hierarchy. Raises CorruptStoreError where nodes do not end behind themselves."""
        return Tree(self._nodes, self._drawables)

    def cut(self, cell: np.void) -> np.ndarray:
        """The whole model at a cell's detail: ids (n,) int64, strictly increasing; cell: a CELL row."""
        error = float(cell["pixel_error"])
        return choose_cut(self._nodes, self._drawables, cell["lo"], cell["hi"], self._pixel_angle, error)

    def group(self, cells: np.ndarray) -> Group:
        """The computed ones of some cells (n,) CELL, as their codec sees them."""
        rows = cells[cells["computed"]]
        corner, depth = decode(rows["key"])
        centres = (2 * corner + 1) << (MAX_DEPTH - depth)[:, None]
        boxes = np.stack([rows["lo"], rows["hi"]], axis=1)
        return Group(self.tree, centres, boxes, tuple(self.cut(row) for row in rows))
