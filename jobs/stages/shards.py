"""Shards: vLODs and the changes across faces, in cell shards. One task for each subtree of cells."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.running.arrays import mapped_array
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task
from jobs.stages import cells, layout
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from storage.base.typed_json import to_json
from storage.cells.codecs import CODECS

if TYPE_CHECKING:
    from storage.shards.sections import CellShardRecord

STAGE = Stage(
    "shards",
    "jobs.stages.shards:write_cells",
    code.SHARDS,
    ("numpy", "zstandard"),
    apart=code.CODECS,
)

#: Bytes for each id, and for each cell, of the subtrees that are looked at: its own and those beside it. Measured: 2 to
#: 3 an id, 600 a cell; ids of cells that nothing is shared with are never read.
PER_ID = 8
PER_CELL = 2000


@dataclass(frozen=True)
class Payload:
    """What decides a cell shard."""

    layout: str  # content
    shard: int  # its number
    needs: tuple[int, ...]  # numbers of the shards whose cells are looked at, its own among them
    contents: tuple[str, ...]  # of their cells
    codec: str  # the name of the codec that it is written in


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    layout: str
    cells: tuple[str, ...]  # of the shards that are needed


def tasks(state: BuildState) -> Tasks:
    """One task for each result of the cells that holds some, in their order."""
    return Tasks(_shards(state))


def _shards(state: BuildState) -> Iterator[Task]:
    codec = state.parameters.codec
    stage = dataclasses.replace(STAGE, code=(*STAGE.code, *_code_of(codec)))
    laid_out, found = state.one(layout.STAGE), cells.finished_cells(state)
    for number, needs in enumerate(layout.shards_needed(state.place, laid_out.key)):
        payload = Payload(
            layout=laid_out.record["content"],
            shard=number,
            needs=tuple(needs),
            contents=tuple(found[other].record["content"] for other in needs),
            codec=codec,
        )
        places = Places(laid_out.key, tuple(found[other].key for other in needs))
        ids, count = (sum(int(found[other].record[name]) for other in needs) for name in ("ids", "cells"))
        memory = PROCESS + PER_ID * ids + PER_CELL * count
        yield Task(stage, to_json(payload), to_json(places), memory)


def _code_of(codec: str) -> tuple[str, ...]:
    """The modules of a codec: a new one beside it throws no finished shard away."""
    return code.with_imports(CODECS[codec], "storage.cells.codecs")


def write_cells(work: Assignment) -> dict[str, Any]:
    """One subtree's cells to a cell shard: their vLODs and the changes across their faces."""
    from storage.vlod_writer import write_cell_shard

    payload, places = work.read(Payload, Places)
    laid_out = work.place.result(layout.STAGE.name, places.layout)
    starts = np.load(laid_out / layout.STARTS)
    number = payload.shard
    first, end = int(starts[number]), int(starts[number + 1])
    pairs = mapped_array(laid_out / layout.PAIRS)
    pairs = pairs[slice(*np.searchsorted(pairs[:, 0], [first, end]))]
    sets: dict[int, np.ndarray] = {}
    rows = np.zeros(0)
    for other, key in zip(payload.needs, places.cells, strict=True):
        folder = work.place.result(cells.STAGE.name, key)
        offsets, ids = np.load(folder / "offsets.npy"), mapped_array(folder / "ids.npy")
        for at in range(len(offsets) - 1):
            sets[int(starts[other]) + at] = ids[offsets[at] : offsets[at + 1]]
        if other == number:
            rows = np.load(folder / "cells.npy")
    shard = write_cell_shard(
        work.place.store,
        rows,
        [sets[cell] for cell in range(first, end)],
        [(a, b, sets[a], sets[b]) for a, b in pairs.tolist()],
        first=first,
        codec=payload.codec,
    )
    return {"shards": [[shard.name, shard.bytes]], "cells": shard.cells, "codec": shard.codec}


def written_shards(state: BuildState) -> list[CellShardRecord]:
    """The cell shards of a build, in the order of their cells' numbers."""
    from storage.shards.sections import CellShardRecord

    found = []
    for result in state.all(STAGE):
        ((name, size),) = result.record["shards"]
        found.append(CellShardRecord(name, size, result.record["cells"], result.record["codec"]))
    return found
