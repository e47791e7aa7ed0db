"""Which cells a task works out: the keys of some levels of the octree below its own."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from jobs.cells.parameters import CellParameters
from storage.cells import octree

#: Octree levels that one task covers below its root; fewer in the first wave, see `levels_of_task`.
LEVELS_PER_TASK = 2


def levels_of_task(top: int, max_depth: int) -> int:
    """How many levels a task works out below a root at depth `top`.

    The first wave takes what is odd, so that the last one, which has by far the most cells, has whole tasks.
    """
    return (max_depth - top) % LEVELS_PER_TASK or LEVELS_PER_TASK


def children_in_view(key: int, parameters: CellParameters) -> list[int]:
    """The children of a key that touch the view box, in Morton order."""
    keys = octree.children(key)
    lo, hi = parameters.octree.boxes(keys)
    touches = (lo <= parameters.view_hi).all(axis=1) & (hi >= parameters.view_lo).all(axis=1)
    return [int(k) for k in keys[touches]]


def count_cells(whole: octree.Octree, lo: ArrayLike, hi: ArrayLike, depth: int) -> int:
    """How many keys at a depth touch the view box lo, hi (3,): see `children_in_view`."""
    edges = whole.faces(np.repeat(np.arange(2**depth + 1)[:, None], 3, axis=1), depth)
    touches = (edges[:-1] <= np.asarray(hi)) & (edges[1:] >= np.asarray(lo))
    return math.prod(touches.sum(axis=0).tolist())


def first_keys(root_key: int, parameters: CellParameters, alone: bool = False) -> list[int]:
    """The topmost cells that the task below a key may give; `alone`: that of the task on the key's own cell."""
    return [root_key] if alone or root_key == octree.ROOT else children_in_view(root_key, parameters)


def bottom_of(root_key: int, parameters: CellParameters, alone: bool = False) -> int:
    """The depth of the last cells that the task below a key works out, or that on the key's own cell, `alone`."""
    top = octree.depth(root_key)
    if alone:
        return top
    return min(top + levels_of_task(top, parameters.max_depth), parameters.max_depth)
