"""What a task will need: an upper bound, known before any cut is chosen."""

from __future__ import annotations

import numpy as np

from jobs.cells.cuts import Leaves, remembered, uncrowded
from jobs.cells.parameters import CellParameters
from jobs.cells.task_keys import bottom_of, first_keys
from storage.geometry_reader import Geometry
from storage.model.cut import possible_drawables


def triangles_needed(
    store: Geometry, root_key: int, parameters: CellParameters, around: Leaves, alone: bool = False
) -> int:
    """The most triangles that `compute_subtree` may read and hold for a key.

    An upper bound, 1.02 to 1.3 times the truth where it was measured, for a fifth of the time that all cuts take.
    around: leaves, at least those inside the cell; alone: of the task on the key's own cell.
    """
    counts = store.drawables["triangles"]
    bottom = bottom_of(root_key, parameters, alone)
    inside = around.within(root_key, parameters)
    used = np.zeros(len(store.drawables), np.bool_)
    largest = 0
    for top in first_keys(root_key, parameters, alone):
        keys = list(uncrowded(top, bottom, parameters, inside))
        if not keys:
            continue
        lo, hi = parameters.octree.boxes(np.array(keys, np.uint64))
        ids = possible_drawables(
            store.nodes, store.drawables, lo.min(axis=0), hi.max(axis=0), (hi - lo).min(axis=0),
            parameters.pixel_angle, remembered(parameters.pixel_error),
        )  # fmt: skip
        used[ids] = True
        largest = max(largest, int(counts[ids].sum(dtype=np.int64)))
    held = int(counts[used].sum(dtype=np.int64))
    # a coarser cut, which a cell may need to keep the budget, is held beside the rest
    may_need_coarser = bottom == parameters.max_depth and parameters.max_triangles is not None
    return held + (largest if may_need_coarser else 0)
