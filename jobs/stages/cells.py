"""Cells: what can be seen from each view cell. Waves of tasks, one for each subtree of the octree.

A task names the keys below it that must be split further, and what each of them will need. Where that is more than a
task may need, its cells are looked at one by one; a cell that is too large even alone is split without being looked at,
and at the depth limit its pixel error is raised until its cut fits.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
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
    alone: bool  # only the key's own cell is worked out
    most_held: int | None  # triangles that the cell's cut may have, where it has more


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
    from jobs.cells.task_keys import LEVELS_PER_TASK, bottom_of, children_in_view
    from storage.cells.octree import ROOT, depth
    from storage.model.cut import coarsest_triangles

    joined = state.one(tables.STAGE)
    parameters = state.parameters.cells(state.view_space(state.one(import_model.STAGE)))
    geometry = open_drafted(state.place, tables.STAGE.name, joined.key)
    check_budget(geometry, parameters.max_triangles)

    around = Leaves.of(geometry, parameters)
    base = PROCESS + REST + parameters.engine.image_bytes
    each = PER_TRIANGLE + (SEALED_PER_TRIANGLE if parameters.engine.seal else 0)
    most_held = (state.memory - base) // each
    # with less than the coarsest cut no cell could be looked at: the first task says how much suffices
    bounded = most_held >= coarsest_triangles(geometry.nodes, geometry.drawables)

    def task(root: int, triangles: int, alone: bool = False, most_held: int | None = None) -> Task:
        payload = Payload(joined.record["content"], root, parameters, alone, most_held)
        return Task(STAGE, to_json(payload), to_json(Places(joined.key)), base + each * triangles)

    def below(key: int, triangles: int) -> Iterator[Task]:
        """The tasks on the cells below a key, all of which together would need so many triangles."""
        if triangles <= most_held or not bounded:
            yield task(key, triangles)
        else:
            for child in children_in_view(key, parameters):
                yield from cell(child)

    def cell(key: int) -> Iterator[Task]:
        """The tasks on a key's cell and those below it, looked at one by one."""
        last = depth(key) == parameters.max_depth
        triangles = triangles_needed(geometry, key, parameters, around, alone=True)
        crowded = around.within(key, parameters).crowd(key, parameters)
        if triangles <= most_held and (last or not crowded):
            yield task(key, triangles, alone=True)
        elif last:
            yield task(key, most_held, alone=True, most_held=most_held)
        else:
            yield from below(key, triangles_needed(geometry, key, parameters, around))

    def followers_of(result: TaskResult) -> Iterator[Task]:
        record = result.record
        for key, triangles in zip(record["open_keys"], record["open_triangles"], strict=True):
            yield from below(key, triangles)

    def waves_after(task: Task) -> int:
        bottom = bottom_of(task.payload["root"], parameters, task.payload["alone"])
        return -(-(parameters.max_depth - bottom) // LEVELS_PER_TASK)

    needed = triangles_needed(geometry, ROOT, parameters, around)
    first = below(ROOT, needed) if needed <= most_held or not bounded else cell(ROOT)
    return Tasks(list(first), followers_of, waves_after)


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
    result = compute_subtree(store, payload.root, parameters, around, payload.alone, payload.most_held)
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
