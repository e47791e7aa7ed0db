"""The tasks of a build: what each one's key is made of, and how much memory it may need."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jobs import stages
from jobs.importing.inputs import content_of
from jobs.objects.fragments import Fragment
from jobs.parameters import BuildParameters, ViewSpace
from jobs.running.errors import MemoryLimitError
from jobs.running.tasks import Task, TaskResult
from jobs.running.workplace import Workplace
from jobs.stages.cells import cell_parameters as cells_options
from jobs.stages.cells import shards_needed
from jobs.stages.detail import geometry_section_of
from jobs.stages.model import Shapes, imported_model
from storage.base.amounts import format_size

#: Triangles of a task that finds pieces: some seconds of work.
PIECES_TRIANGLES = 500_000

#: Triangles that a task on nodes works on: some ten seconds of work.
NODES_TRIANGLES = 150_000

#: What a process of a job holds before it does anything (interpreter, numpy, kernels), in bytes. Measured: 200 MiB, and
#: 620 where it has compiled the kernels itself. An import has none: 100 MiB.
PROCESS = 640 << 20
IMPORT_PROCESS = 200 << 20

#: Bytes for each triangle of a chunk while its pieces are found. Measured: 190 of small meshes, 290 of one large mesh.
PIECES_PER_TRIANGLE = 400

#: Bytes for each placed piece while the hierarchy is made, and while its tables are looked into.
HIERARCHY_PER_PIECE = 2000
SHAPES_PER_PIECE = 400

#: Bytes for each triangle of a chunk, and for each placement, while levels that are shared are made. Measured: 60 a
#: triangle, since pieces are worked on one by one.
SHARED_PER_TRIANGLE = 300
SHARED_PER_PLACEMENT = 1000

#: Bytes for each triangle of a fragment while its levels are made. Measured: 600.
DETAIL_PER_TRIANGLE = 1000

#: Bytes for each node while the tables of the whole model are joined. Measured: 1,700.
TABLES_PER_NODE = 3000

#: Bytes for each triangle that cells are worked out from, and for all else but the engine's images. Measured: 290 a
#: triangle.
CELLS_PER_TRIANGLE = 400
CELLS_REST = 100 << 20
#: And where gaps count as closed: 8 gaps of 29 bytes at most for each of one and a half edges.
CELLS_SEALED_PER_TRIANGLE = 400

#: Bytes for each cell while all are laid out.
LAYOUT_PER_CELL = 2000

#: What, beside more memory, helps a stage whose task needs too much.
CURES = {
    stages.IMPORT.name: "part the largest mesh, or the file, in the program that wrote it",
    stages.PIECES.name: "part the largest mesh in the program that wrote it",
    stages.SHARED.name: "part the largest mesh in the program that wrote it",
    stages.CELLS.name: "compute a smaller --region",
}


def too_large(task: Task, most: int) -> MemoryLimitError:
    """The error for a task that needs more than the `most` bytes that are allowed."""
    need, cure = format_size(task.memory), CURES.get(task.stage.name)
    return MemoryLimitError(
        f"a task of stage {task.stage.name!r} needs about {need} of memory, and {format_size(most)} are allowed: "
        f"allow --memory {need}" + (f", or {cure}" if cure is not None else "")
    )


def import_task(inputs: Sequence[Path], parameters: BuildParameters) -> Task:
    """The import of a model: keyed by the content of its files. Raises ModelError for inputs that name no model."""
    from jobs.importing.import_memory import import_memory

    payload = {
        "files": content_of(inputs),
        "names": [path.name for path in inputs],
        "options": {"units": parameters.units, "up": parameters.up},
    }
    places = {"inputs": [str(path.absolute()) for path in inputs]}
    return Task(stages.IMPORT, payload, places, IMPORT_PROCESS + import_memory(inputs))


def pieces_tasks(place: Workplace, imported: TaskResult, parameters: BuildParameters) -> Iterator[Task]:
    """Partition I, in chunks of meshes."""
    from jobs.detail.pieces import plan_chunks

    model = imported_model(place, imported.key)
    for meshes in plan_chunks(model, PIECES_TRIANGLES):
        yield Task(
            stages.PIECES,
            {
                "model": imported.record["model"]["digest"],
                "meshes": [int(mesh) for mesh in meshes],
                "options": _detail_options(parameters),
            },
            {"import": imported.key},
            PROCESS + PIECES_PER_TRIANGLE * int(model.meshes["triangles"][meshes].sum()),
        )


def hierarchy_task(imported: TaskResult, pieces: Sequence[TaskResult], parameters: BuildParameters) -> Task:
    """Clusters, objects and the tree: boxes only."""
    payload = {
        "model": imported.record["model"]["digest"],
        "pieces": [result.record["content"] for result in pieces],
        "options": dataclasses.asdict(parameters.objects()),
    }
    places = {"import": imported.key, "pieces": [result.key for result in pieces]}
    return Task(stages.HIERARCHY, payload, places, PROCESS + HIERARCHY_PER_PIECE * _pieces_in(pieces))


def shared_tasks(
    imported: TaskResult, pieces: Sequence[TaskResult], hierarchy: TaskResult, parameters: BuildParameters
) -> Iterator[Task]:
    """Levels of the pieces that several placements share: one task for each of those that found pieces."""
    for chunk, found in enumerate(pieces):
        yield Task(
            stages.SHARED,
            {
                "model": imported.record["model"]["digest"],
                "chunk": chunk,
                "pieces": found.record["content"],
                "hierarchy": hierarchy.record["content"],
                "options": _detail_options(parameters),
            },
            {"import": imported.key, "hierarchy": hierarchy.key, "pieces": found.key},
            PROCESS
            + SHARED_PER_TRIANGLE * int(found.record["triangles"])
            + SHARED_PER_PLACEMENT * int(hierarchy.record["counts"]["shared"])
            + SHAPES_PER_PIECE * int(hierarchy.record["counts"]["pieces"]),
        )


class NodesPlan:
    """Tasks on fragments of the tree: a fragment's task can be made when those below it are finished."""

    def __init__(
        self,
        place: Workplace,
        imported: TaskResult,
        pieces: Sequence[TaskResult],
        hierarchy: TaskResult,
        shared: Sequence[TaskResult],
        parameters: BuildParameters,
    ) -> None:
        from jobs.objects.fragments import plan_fragments

        shapes = Shapes.open(place, hierarchy.key)
        triangles = np.zeros(len(shapes.end), np.int64)
        leaves = np.flatnonzero(shapes.leaf >= 0)
        counts = shapes.placed["triangles"][shapes.members].astype(np.int64)
        triangles[leaves] = np.add.reduceat(counts, shapes.start[:-1])[shapes.leaf[leaves]]
        self._fragments = plan_fragments(shapes.end, triangles, NODES_TRIANGLES)
        self._above = {stop: fragment.root for fragment in self._fragments for stop in fragment.stops}
        self._by_root = {fragment.root: fragment for fragment in self._fragments}
        self._finished: dict[int, TaskResult] = {}
        self._memory = PROCESS + SHAPES_PER_PIECE * int(hierarchy.record["counts"]["pieces"])
        self._chunks = chunks_of_fragments(shapes, self._fragments)
        self._pieces, self._shared = pieces, shared
        self._payload = {
            "model": imported.record["model"]["digest"],
            "hierarchy": hierarchy.record["content"],
            "options": _detail_options(parameters),
        }
        self._places = {"import": imported.key, "hierarchy": hierarchy.key}

    def first(self) -> Iterator[Task]:
        """The tasks that wait for no other."""
        return (self._task(fragment) for fragment in self._fragments if not fragment.stops)

    def then(self, result: TaskResult) -> list[Task]:
        """The tasks that can be made now that one more is finished."""
        root = int(result.task.payload["root"])
        self._finished[root] = result
        above = self._above.get(root)
        if above is None or not all(stop in self._finished for stop in self._by_root[above].stops):
            return []
        return [self._task(self._by_root[above])]

    def _task(self, fragment: Fragment) -> Task:
        below = [self._finished[stop] for stop in fragment.stops]
        chunks = self._chunks[fragment.root]
        pieces, shared = [self._pieces[chunk] for chunk in chunks], [self._shared[chunk] for chunk in chunks]
        payload = {
            **self._payload,
            "chunks": chunks,
            "pieces": [result.record["content"] for result in pieces],
            "shared": [result.record["content"] for result in shared],
            "root": fragment.root,
            "stops": fragment.stops,
            "heights": [int(result.record["height"]) for result in below],
            "below": [result.record["content"] for result in below],
        }
        places = {
            **self._places,
            "pieces": [result.key for result in pieces],
            "shared": [result.key for result in shared],
            "below": [result.key for result in below],
        }
        return Task(stages.NODES, payload, places, self._memory + DETAIL_PER_TRIANGLE * fragment.triangles)


def tables_task(imported: TaskResult, hierarchy: TaskResult, detail: Sequence[TaskResult]) -> Task:
    """The tables of the whole model, from all tasks on detail."""
    payload = {
        "model": imported.record["model"]["digest"],
        "hierarchy": hierarchy.record["content"],
        "shards": [result.record["shards"][0] for result in detail],
        "tables": [result.record["content"] for result in detail],
    }
    places = {
        "import": imported.key,
        "hierarchy": hierarchy.key,
        "detail": [[result.task.stage.name, result.key] for result in detail],
    }
    return Task(stages.TABLES, payload, places, PROCESS + TABLES_PER_NODE * int(hierarchy.record["counts"]["nodes"]))


def engine_settings(parameters: BuildParameters) -> dict[str, Any]:
    """How what can be seen is found, as JSON: see `jobs.visibility.engine`."""
    from jobs.visibility.engine import QUALITIES

    settings = QUALITIES[parameters.quality]
    return dataclasses.asdict(
        dataclasses.replace(
            settings,
            method=parameters.visibility_engine,
            sampled=parameters.sampled,
            seal=parameters.seal or 0.0,
        )
    )


def cell_parameters(parameters: BuildParameters, space: ViewSpace, pixel_angle: float) -> dict[str, Any]:
    """What decides the cells, as JSON: see `jobs.stages.cells`."""
    return {
        "octree_lo": list(space.octree.lo),
        "octree_size": space.octree.size,
        "view_lo": list(space.lo),
        "view_hi": list(space.hi),
        "max_depth": space.max_depth,
        "triangles_per_cell": parameters.triangles_per_cell,
        "max_triangles": parameters.max_triangles,
        "pixel_angle": pixel_angle,
        "pixel_error": parameters.pixel_error,
        "engine": engine_settings(parameters),
    }


class CellsPlan:
    """Tasks on subtrees of view cells: each names the keys below it that are left, and what they will need."""

    def __init__(self, tables: TaskResult, parameters: Mapping[str, Any]) -> None:
        """parameters: see `cell_parameters`."""
        self._tables = tables
        self._parameters = dict(parameters)
        self._options = cells_options(self._parameters)

    def first(self, place: Workplace) -> Task:
        """The task on the octree's topmost cells. Raises ParameterError where no cell can keep to `max_triangles`."""
        from jobs.cells.budget import check_budget
        from jobs.cells.subtree import triangles_needed
        from storage.cells.octree import ROOT
        from storage.geometry_reader import open_geometry

        geometry = open_geometry(place.store, geometry_section_of(place, self._tables.key))
        check_budget(geometry, self._options.max_triangles)
        return self._task(ROOT, triangles_needed(geometry, ROOT, self._options))

    def then(self, result: TaskResult) -> list[Task]:
        """The tasks that can be made now that one more is finished."""
        left = zip(result.record["open_keys"], result.record["open_triangles"], strict=True)
        return [self._task(key, triangles) for key, triangles in left]

    def _task(self, root: int, triangles: int) -> Task:
        engine = self._options.engine
        each = CELLS_PER_TRIANGLE + (CELLS_SEALED_PER_TRIANGLE if engine.seal else 0)
        return Task(
            stages.CELLS,
            {"geometry": self._tables.record["content"], "root": root, "parameters": self._parameters},
            {"tables": self._tables.key},
            PROCESS + CELLS_REST + engine.image_bytes + each * triangles,
        )


def layout_task(cells: Sequence[TaskResult]) -> Task:
    """The order of all cells; `cells` in the order of their roots."""
    payload = {"cells": [[int(result.task.payload["root"]), result.record["content"]] for result in cells]}
    computed = sum(int(result.record["cells"]) for result in cells)
    places = {"cells": [result.key for result in cells]}
    return Task(stages.LAYOUT, payload, places, PROCESS + LAYOUT_PER_CELL * computed)


def shard_tasks(place: Workplace, layout: TaskResult, cells: Sequence[TaskResult]) -> Iterator[Task]:
    """One cell shard for each result of the cell stage, in their order."""
    for number, needs in enumerate(shards_needed(place, layout.key)):
        payload = {
            "layout": layout.record["content"],
            "shard": number,
            "needs": needs,
            "contents": [cells[other].record["content"] for other in needs],
        }
        places = {"layout": layout.key, "cells": [cells[other].key for other in needs]}
        yield Task(stages.SHARDS, payload, places)


def chunks_of_fragments(shapes: Shapes, fragments: Sequence[Fragment]) -> dict[int, list[int]]:
    """For the root of each fragment: the chunks of meshes, increasing, that the pieces in its own leaves are of."""
    counts = np.diff(shapes.start)
    chunk = np.searchsorted(shapes.chunk_start, shapes.placed["piece"][shapes.members], side="right") - 1
    owner = np.empty(len(shapes.end), np.int64)
    for number in range(len(fragments) - 1, -1, -1):  # those above others first
        root = fragments[number].root
        owner[root : int(shapes.end[root])] = number
    leaves = np.flatnonzero(shapes.leaf >= 0)
    of_leaf = np.empty(len(counts), np.int64)
    of_leaf[shapes.leaf[leaves]] = owner[leaves]
    pairs = np.unique(np.stack([np.repeat(of_leaf, counts), chunk], axis=1), axis=0)
    found: dict[int, list[int]] = {fragment.root: [] for fragment in fragments}
    for number, used in pairs.tolist():
        found[fragments[number].root].append(used)
    return found


def _detail_options(parameters: BuildParameters) -> dict[str, Any]:
    return dataclasses.asdict(parameters.detail())


def _pieces_in(results: Sequence[TaskResult]) -> int:
    return sum(int(result.record["pieces"]) for result in results)
