"""Cells: what can be seen from each view cell. Waves of tasks, one for each subtree of the octree.

A task names the keys below it that must be split further, and what each of them will need.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from jobs.cells.parameters import CellParameters
from jobs.running.arrays import save_array
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, TaskResult, content_of_arrays
from jobs.running.workplace import Workplace
from jobs.stages import import_model, tables
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from jobs.stages.support.written_geometry import open_drafted
from storage.base.typed_json import to_json

if TYPE_CHECKING:
    from storage.geometry_reader import Geometry

STAGE = Stage(
    "cells", "jobs.stages.cells:compute_cells", code.CELLS, ("numpy", "numba"), cure="compute a smaller --region"
)

#: Bytes for each triangle that cells are worked out from, and for all else but the engine's images. Measured: 290 a
#: triangle.
PER_TRIANGLE = 400
REST = 100 << 20
#: And where gaps count as closed: 8 gaps of 29 bytes at most for each of one and a half edges.
SEALED_PER_TRIANGLE = 400


@dataclass(frozen=True)
class Payload:
    """What decides the cells of a subtree."""

    geometry: str  # content of the tables
    root: int  # octree key
    parameters: CellParameters


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    tables: str


def tasks(state: BuildState) -> Tasks:
    """The task on the octree's topmost cells, and those on what its cells leave open.

    Raises ParameterError where no cell can keep to `max_triangles`, and for a region outside the view space.
    """
    from jobs.cells.budget import check_budget
    from jobs.cells.cuts import Leaves
    from jobs.cells.needs import triangles_needed
    from storage.cells.octree import ROOT

    joined = state.one(tables.STAGE)
    parameters = state.parameters.cells(state.view_space(state.one(import_model.STAGE)))
    geometry = open_drafted(state.place, tables.STAGE.name, joined.key)
    check_budget(geometry, parameters.max_triangles)

    def task(root: int, triangles: int) -> Task:
        engine = parameters.engine
        each = PER_TRIANGLE + (SEALED_PER_TRIANGLE if engine.seal else 0)
        return Task(
            STAGE,
            to_json(Payload(joined.record["content"], root, parameters)),
            to_json(Places(joined.key)),
            PROCESS + REST + engine.image_bytes + each * triangles,
        )

    def followers_of(result: TaskResult) -> list[Task]:
        left = zip(result.record["open_keys"], result.record["open_triangles"], strict=True)
        return [task(key, triangles) for key, triangles in left]

    needed = triangles_needed(geometry, ROOT, parameters, Leaves.of(geometry, parameters))
    return Tasks([task(ROOT, needed)], followers_of)


def finished_cells(state: BuildState) -> list[TaskResult]:
    """The results that hold cells, in the order of their roots."""
    return sorted(
        (result for result in state.all(STAGE) if result.record["cells"]),
        key=lambda result: int(result.task.payload["root"]),
    )


def compute_cells(work: Assignment) -> dict[str, Any]:
    """A subtree of view cells with what can be seen from each."""
    from jobs.cells.cuts import Leaves
    from jobs.cells.needs import triangles_needed
    from jobs.cells.subtree import compute_subtree

    payload, places = work.read(Payload, Places)
    store, parameters = _geometry(work.place, places.tables), payload.parameters
    around = Leaves.of(store, parameters)
    result = compute_subtree(store, payload.root, parameters, around)
    inside = around.within(payload.root, parameters)
    save_array(work.out / "cells.npy", result.cells)
    save_array(work.out / "offsets.npy", result.offsets)
    save_array(work.out / "ids.npy", result.ids)
    return {
        "open_keys": [int(key) for key in result.open_keys],
        "open_triangles": [triangles_needed(store, key, parameters, inside) for key in result.open_keys],
        "cells": len(result.cells),
        "ids": len(result.ids),
        "content": content_of_arrays(result.cells, result.offsets, result.ids),
    }


@functools.lru_cache(maxsize=1)
def _geometry(place: Workplace, key: str) -> Geometry:
    """The geometry of a store that has no cells yet; a worker keeps it for its next task."""
    return open_drafted(place, tables.STAGE.name, key)
