"""Shards: what can be seen from the cells, in cell shards. One task for each subtree of cells."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.running.arrays import mapped_array, save_array
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task
from jobs.stages import cells, tables
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from jobs.stages.support.written_geometry import open_drafted
from storage.base.typed_json import to_json
from storage.cells.codecs import CODECS

if TYPE_CHECKING:
    from storage.vlod_writer import WrittenCells

STAGE = Stage(
    "shards",
    "jobs.stages.shards:write_cells",
    code.SHARDS,
    ("numpy", "numba", "zstandard"),
    apart=code.CODECS,
)

#: Bytes for each id and each cell of the subtree, and for each node, whose tables are read. Measured: 2 to 3 an id,
#: 600 a cell.
PER_ID = 8
PER_CELL = 2000
PER_NODE = 1500

#: File of a task: GROUP, what the table of all cells says of the shard.
GROUPS = "groups.npy"


@dataclass(frozen=True)
class Payload:
    """What decides a cell shard."""

    geometry: str  # content of the tables
    cells: str  # content
    pixel_angle: float
    codec: str  # the name of the codec that it is written in


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    tables: str
    cells: str


def tasks(state: BuildState) -> Tasks:
    """One task for each result of the cells that holds some, in their order."""
    return Tasks(_shards(state))


def _shards(state: BuildState) -> Iterator[Task]:
    codec = state.parameters.codec
    stage = dataclasses.replace(STAGE, code=(*STAGE.code, *_code_of(codec)))
    joined = state.one(tables.STAGE)
    nodes = int(joined.record["counts"]["nodes"])
    for found in cells.finished_cells(state):
        payload = Payload(joined.record["content"], found.record["content"], state.parameters.pixel_angle(), codec)
        ids, count = int(found.record["ids"]), int(found.record["cells"])
        memory = PROCESS + PER_ID * ids + PER_CELL * count + PER_NODE * nodes
        yield Task(stage, to_json(payload), to_json(Places(joined.key, found.key)), memory)


def _code_of(codec: str) -> tuple[str, ...]:
    """The modules of a codec: a new one beside it throws no finished shard away."""
    return code.with_imports(CODECS[codec], "storage.cells.codecs")


def write_cells(work: Assignment) -> dict[str, Any]:
    """One subtree's cells to a cell shard."""
    from storage.known_cells import KnownCells
    from storage.vlod_writer import write_cell_shard

    payload, places = work.read(Payload, Places)
    geometry = open_drafted(work.place, tables.STAGE.name, places.tables)
    folder = work.place.result(cells.STAGE.name, places.cells)
    offsets, ids = np.load(folder / "offsets.npy"), mapped_array(folder / "ids.npy")
    written = write_cell_shard(
        work.place.store,
        np.load(folder / "cells.npy"),
        np.split(ids, offsets[1:-1]),
        KnownCells(geometry.nodes, geometry.drawables, payload.pixel_angle),
        codec=payload.codec,
    )
    save_array(work.out / GROUPS, written.groups)
    shard = written.record
    return {"shards": [[shard.name, shard.bytes]], "cells": shard.cells, "codec": shard.codec}


def written_shards(state: BuildState) -> list[WrittenCells]:
    """The cell shards of a build, in the order of their cells' numbers."""
    from storage.shards.sections import CellShardRecord
    from storage.vlod_writer import WrittenCells

    found = []
    for result, source in zip(state.all(STAGE), cells.finished_cells(state), strict=True):
        ((name, size),) = result.record["shards"]
        record = CellShardRecord(name, size, result.record["cells"], result.record["codec"])
        rows = np.load(state.place.result(cells.STAGE.name, source.key) / "cells.npy")
        found.append(WrittenCells(record, rows, np.load(state.place.result(STAGE.name, result.key) / GROUPS)))
    return found
