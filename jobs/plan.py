"""The tasks of a build: what each one's key is made of, and how much memory it may need."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jobs import stages
from jobs.inputs import content_of, total_bytes
from jobs.parameters import BuildParameters, ViewSpace
from jobs.tasks import Task, TaskResult
from jobs.workplace import Workplace

#: Triangles of a detail task: some ten seconds of work.
CHUNK_TRIANGLES = 150_000

#: What a process of a job holds before it does anything (interpreter, numpy, compiled kernels), in bytes.
PROCESS = 400 << 20

#: Bytes for each byte of the input files while they are imported.
IMPORT_PER_BYTE = 20

#: Bytes for each triangle of a chunk while its levels are made.
DETAIL_PER_TRIANGLE = 1500

#: Bytes for each triangle of a cut while its cells are worked out.
CELLS_PER_TRIANGLE = 900


def import_task(inputs: Sequence[Path], parameters: BuildParameters) -> Task:
    """The import of a model: keyed by the content of its files."""
    payload = {
        "files": content_of(inputs),
        "names": [path.name for path in inputs],
        "options": {"units": parameters.units, "up": parameters.up},
    }
    places = {"inputs": [str(path.absolute()) for path in inputs]}
    return Task(stages.IMPORT, payload, places, PROCESS + IMPORT_PER_BYTE * total_bytes(inputs))


def detail_tasks(place: Workplace, imported: TaskResult) -> Iterator[Task]:
    """The levels of all pieces, in chunks of meshes."""
    from jobs.detail.pieces import DetailOptions, plan_chunks

    model = stages.imported_model(place, imported.key)
    options = DetailOptions(triangles_per_chunk=CHUNK_TRIANGLES)
    for meshes in plan_chunks(model, options):
        triangles = int(model.meshes["triangles"][meshes].sum())
        yield Task(
            stages.DETAIL,
            {
                "model": imported.record["model"]["digest"],
                "meshes": [int(mesh) for mesh in meshes],
                "options": dataclasses.asdict(options),
            },
            {"import": imported.key},
            PROCESS + DETAIL_PER_TRIANGLE * triangles,
        )


def tables_task(imported: TaskResult, detail: Sequence[TaskResult]) -> Task:
    """The tables of the whole model."""
    payload = {
        "model": imported.record["model"]["digest"],
        "shards": [result.record["shards"][0] for result in detail],
        "tables": [result.record["content"] for result in detail],
    }
    return Task(stages.TABLES, payload, {"import": imported.key, "detail": [result.key for result in detail]})


def cell_parameters(parameters: BuildParameters, space: ViewSpace, pixel_angle: float) -> dict[str, Any]:
    """What decides the cells, as JSON: see `stages.cell_parameters`."""
    from jobs.visibility.engine import EngineSettings

    return {
        "octree_lo": list(space.octree.lo),
        "octree_size": space.octree.size,
        "view_lo": list(space.lo),
        "view_hi": list(space.hi),
        "max_depth": space.max_depth,
        "triangles_per_cell": parameters.triangles_per_cell,
        "pixel_angle": pixel_angle,
        "pixel_error": parameters.pixel_error,
        "engine": dataclasses.asdict(EngineSettings()),
    }


def cells_task(tables: TaskResult, root: int, parameters: Mapping[str, Any], triangles: int) -> Task:
    """The cells below one key of the octree; `triangles`: of the whole model at its finest."""
    return Task(
        stages.CELLS,
        {"geometry": tables.record["content"], "root": root, "parameters": dict(parameters)},
        {"tables": tables.key},
        PROCESS + CELLS_PER_TRIANGLE * triangles,
    )


def layout_task(cells: Sequence[TaskResult]) -> Task:
    """The order of all cells; `cells` in the order of their roots."""
    payload = {"cells": [[int(result.task.payload["root"]), result.record["content"]] for result in cells]}
    return Task(stages.LAYOUT, payload, {"cells": [result.key for result in cells]})


def shard_tasks(place: Workplace, layout: TaskResult, cells: Sequence[TaskResult]) -> Iterator[Task]:
    """One cell shard for each result of the cell stage, in their order."""
    for number, needs in enumerate(stages.shards_needed(place, layout.key)):
        payload = {
            "layout": layout.record["content"],
            "shard": number,
            "needs": needs,
            "contents": [cells[other].record["content"] for other in needs],
        }
        places = {"layout": layout.key, "cells": [cells[other].key for other in needs]}
        yield Task(stages.SHARDS, payload, places)
