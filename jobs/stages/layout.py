"""Layout: the order of all cells, and which of them share a face. One task.

Each task's cells become one shard, in the order of the tasks' root keys; they are numbered shard by shard.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jobs.running.arrays import save_array
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, content_of_arrays
from jobs.stages import cells
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from storage.base.errors import ParameterError
from storage.base.typed_json import to_json

STAGE = Stage("layout", "jobs.stages.layout:lay_out_cells", code.LAYOUT, ("numpy",))

#: Bytes for each cell.
PER_CELL = 2000

#: File of a task: pairs (n, 2) int64 of cells that share a face, the lower number first.
PAIRS = "pairs.npy"


@dataclass(frozen=True)
class Payload:
    """What decides the layout."""

    cells: tuple[tuple[int, str], ...]  # root and content of each subtree, by root


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    cells: tuple[str, ...]


def tasks(state: BuildState) -> Tasks:
    """The task. Raises ParameterError where there is no cell."""
    found = cells.finished_cells(state)
    if not found:
        raise ParameterError("no view cell lies in the view space: choose a larger --view-box or --region")
    payload = Payload(tuple((int(result.task.payload["root"]), result.record["content"]) for result in found))
    count = sum(int(result.record["cells"]) for result in found)
    places = Places(tuple(result.key for result in found))
    return Tasks([Task(STAGE, to_json(payload), to_json(places), PROCESS + PER_CELL * count)])


def lay_out_cells(work: Assignment) -> dict[str, Any]:
    """The order of all cells, and which of them share a face."""
    from storage.cells.octree import neighbours

    _, places = work.read(Payload, Places)
    keys = [np.load(work.place.result(cells.STAGE.name, key) / "cells.npy")["key"] for key in places.cells]
    every = np.concatenate([np.zeros(0, np.uint64), *keys])
    pairs, _ = neighbours(every)
    save_array(work.out / PAIRS, pairs)
    return {"cells": len(every), "boundaries": len(pairs), "content": content_of_arrays(pairs)}
