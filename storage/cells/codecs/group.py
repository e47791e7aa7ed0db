"""A group of cells as its codec sees it: what a reader knows before it has read what can be seen from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import CorruptStoreError

Ids = NDArray[np.int64]


class Tree:
    """The hierarchy in plain arrays, made once for a store.

    nodes, drawables: NODE and DRAWABLE. Raises CorruptStoreError where nodes do not end behind themselves.
    """

    def __init__(self, nodes: np.ndarray, drawables: np.ndarray) -> None:
        count = len(nodes)
        #: (n,) int64 of each node: see NODE.
        self.end = nodes["end"].astype(np.int64)
        if count and ((self.end <= np.arange(count)) | (self.end > count)).any():
            raise CorruptStoreError("a node of the hierarchy ends before itself, or beyond the last")
        #: (n, 3) float64 boxes of the nodes, in model units.
        self.lo, self.hi = (np.ascontiguousarray(nodes[name], np.float64) for name in ("lo", "hi"))
        #: (n,) int64 the node right above each one, -1 above roots.
        self.parent = np.full(count, -1, np.int64)
        open_ones: list[int] = []
        for node, end in enumerate(self.end.tolist()):
            while open_ones and self.end[open_ones[-1]] <= node:
                open_ones.pop()
            self.parent[node] = open_ones[-1] if open_ones else -1
            if end > node + 1:
                open_ones.append(node)
        #: (d,) int64 the node of each drawable.
        self.node_of = drawables["node"].astype(np.int64)


@dataclass(frozen=True)
class Group:
    """Cells that are coded together, in Morton order."""

    tree: Tree
    centres: NDArray[np.int64]  # (g, 3) of the cells, in half edges of the octree's finest cells
    boxes: NDArray[np.float64]  # (g, 2, 3) of the cells, model units
    cuts: tuple[Ids, ...]  # of each cell: drawables, increasing, at most one of a node and none of a node above another

    @cached_property
    def cut(self) -> Ids:
        """(c,) int64 the nodes of all cuts, one cell after the other."""
        drawables = np.concatenate([np.zeros(0, np.int64), *self.cuts])
        return self.tree.node_of[drawables]

    @cached_property
    def cut_ends(self) -> Ids:
        """(g,) int64 where each cell's part of `cut` ends."""
        return np.cumsum([len(cut) for cut in self.cuts], dtype=np.int64)
