"""A group of cells as its codec sees it: what a reader knows before it has read what can be seen from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import CorruptStoreError
from storage.base.kernels import allocating_kernel

Ids = NDArray[np.int64]


class Tree:
    """The hierarchy in plain arrays, made once for a store."""

    def __init__(self, nodes: np.ndarray, drawables: np.ndarray) -> None:
        """nodes, drawables: NODE and DRAWABLE. Raises CorruptStoreError where they are no tree."""
        count = len(nodes)
        #: (n,) int64 of each node: see NODE.
        self.end = nodes["end"].astype(np.int64)
        if count and ((self.end <= np.arange(count)) | (self.end > count)).any():
            raise CorruptStoreError("a node of the hierarchy ends before itself, or beyond the last")
        #: (n, 3) float32 boxes of the nodes, in model units.
        self.lo, self.hi = nodes["lo"], nodes["hi"]
        #: (n,) int64 the node right above each one, -1 above roots.
        self.parent = _parents(self.end)
        #: (d,) int64 the node of each drawable.
        self.node_of = drawables["node"].astype(np.int64)
        if len(self.node_of) and int(self.node_of.max()) >= count:
            raise CorruptStoreError("a drawable names a node that there is not")


class Part(NamedTuple):
    """The part of a hierarchy that some cuts touch: their nodes and all above these, numbered in the same order."""

    end: Ids  # (m,)
    parent: Ids  # (m,), -1 above roots
    lo: NDArray[np.float64]  # (m, 3) model units
    hi: NDArray[np.float64]  # (m, 3)
    cut: Ids  # (c,) the nodes of all cuts, one cell after the other


@dataclass(frozen=True)
class Group:
    """Cells that are coded together, in Morton order."""

    tree: Tree
    centres: NDArray[np.int64]  # (g, 3) of the cells, in half edges of the octree's finest cells
    boxes: NDArray[np.float64]  # (g, 2, 3) of the cells, model units
    cuts: tuple[Ids, ...]  # of each cell: drawables, increasing, at most one of a node and none of a node above another

    @property
    def count(self) -> int:
        """How many cells it has."""
        return len(self.cuts)

    @cached_property
    def part(self) -> Part:
        """What of the hierarchy matters to the group: so that its cost does not grow with the model."""
        tree = self.tree
        nodes = tree.node_of[np.concatenate([np.zeros(0, np.int64), *self.cuts])]
        kept = _touched(tree.parent, nodes)
        parent = tree.parent[kept]
        return Part(
            np.searchsorted(kept, tree.end[kept]),
            np.where(parent < 0, -1, np.searchsorted(kept, parent)),
            tree.lo[kept].astype(np.float64),
            tree.hi[kept].astype(np.float64),
            np.searchsorted(kept, nodes),
        )

    @cached_property
    def cut_ends(self) -> Ids:
        """(g,) int64 where each cell's part of `part.cut` ends."""
        return np.cumsum([len(cut) for cut in self.cuts], dtype=np.int64)


@allocating_kernel()
def _parents(end: NDArray[np.int64]) -> NDArray[np.int64]:
    parent = np.full(len(end), -1, np.int64)
    open_ones = np.empty(len(end) + 1, np.int64)
    count = 0
    for node in range(len(end)):
        while count and end[open_ones[count - 1]] <= node:
            count -= 1
        if count:
            parent[node] = open_ones[count - 1]
        open_ones[count] = node
        count += 1
    return parent


@allocating_kernel()
def _touched(parent: NDArray[np.int64], nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Nodes and all above them, increasing, each once."""
    met = np.zeros(len(parent), np.bool_)
    for node in nodes:
        at = node
        while at >= 0 and not met[at]:
            met[at] = True
            at = parent[at]
    return np.flatnonzero(met)
