"""Packs: meshes along the order, copied into the packs and shards that stay. One task for each shard."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from jobs.running.arrays import mapped_array, save_array
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, content_of_arrays
from jobs.stages import tables
from jobs.stages.packing import order
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from jobs.stages.support.written_geometry import open_drafted
from storage.base.typed_json import to_json

STAGE = Stage("packs", "jobs.stages.packing.packs:write_packs_of_shard", code.PACKS, ("numpy", "numba", "zstandard"))

#: Bytes for each node, whose tables are read; and for all else: what the reader keeps of the packs that the meshes lay
#: in, 256 MiB at most, and a shard's meshes, 13 MiB.
PER_NODE = 1500
REST = 350 << 20


@dataclass(frozen=True)
class Payload:
    """What decides a shard."""

    geometry: str  # content of the tables
    order: str  # content
    first: int  # of its packs
    end: int


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    tables: str
    order: str


def tasks(state: BuildState) -> Tasks:
    """One task for each shard, in their order."""
    joined, ordered = state.one(tables.STAGE), state.one(order.STAGE)
    starts = ordered.record["first_packs"]
    places = to_json(Places(joined.key, ordered.key))
    memory = PROCESS + REST + PER_NODE * int(joined.record["counts"]["nodes"])
    return Tasks(
        [
            Task(
                STAGE,
                to_json(Payload(joined.record["content"], ordered.record["content"], first, end)),
                places,
                memory,
            )
            for first, end in itertools.pairwise(starts)
        ]
    )


def write_packs_of_shard(work: Assignment) -> dict[str, Any]:
    """Copies the meshes of a shard's packs into them."""
    from storage.geometry_writer import write_packs

    payload, places = work.read(Payload, Places)
    geometry = open_drafted(work.place, tables.STAGE.name, places.tables)
    ordered = work.place.result(order.STAGE.name, places.order)
    sequence = mapped_array(ordered / order.SEQUENCE)
    starts = np.load(ordered / order.PACKS)[payload.first : payload.end + 1]
    meshes = {
        int(number): geometry.packed_mesh(int(number))
        for number in sorted(sequence[starts[0] : starts[-1]], key=lambda mesh: geometry.geometry["pack"][mesh])
    }
    shard = write_packs(
        work.place.store,
        ([meshes.pop(number) for number in sequence[a:b].tolist()] for a, b in itertools.pairwise(starts.tolist())),
    )
    save_array(work.out / "geometry.npy", shard.geometry)
    save_array(work.out / "packs.npy", shard.packs)
    return {"shards": [[shard.name, shard.bytes]], "content": content_of_arrays(shard.geometry, shard.packs)}
