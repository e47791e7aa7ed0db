"""Index: the model's tables once more, with where each mesh lies for good. One task."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, content_key
from jobs.stages import tables
from jobs.stages.packing import order, packs
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from jobs.stages.support.written_geometry import SECTION, open_drafted
from storage.base.typed_json import to_json

STAGE = Stage("index", "jobs.stages.packing.index:index_meshes", code.INDEX, ("numpy", "zstandard"))

#: Bytes for each node: the same rows as at the stage of tables.
PER_NODE = 3000


@dataclass(frozen=True)
class Payload:
    """What decides the tables."""

    geometry: str  # content of the tables before
    order: str  # content
    shards: tuple[tuple[str, int], ...]  # names and bytes of the geometry shards
    tables: tuple[str, ...]  # contents of the tasks that wrote them


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    tables: str
    order: str
    packs: tuple[str, ...]


def tasks(state: BuildState) -> Tasks:
    """The task."""
    joined, ordered, written = state.one(tables.STAGE), state.one(order.STAGE), state.all(packs.STAGE)
    payload = Payload(
        joined.record["content"],
        ordered.record["content"],
        tuple(tuple(result.record["shards"][0]) for result in written),
        tuple(result.record["content"] for result in written),
    )
    places = Places(joined.key, ordered.key, tuple(result.key for result in written))
    memory = PROCESS + PER_NODE * int(joined.record["counts"]["nodes"])
    return Tasks([Task(STAGE, to_json(payload), to_json(places), memory)])


def index_meshes(work: Assignment) -> dict[str, Any]:
    """The tables of the whole model, and the manifest's section on geometry."""
    from storage.geometry_writer import GeometryShardRecord, geometry_section, join_geometry, write_tables_shard

    payload, places = work.read(Payload, Places)
    drafted = open_drafted(work.place, tables.STAGE.name, places.tables)
    records = []
    for key, (name, size) in zip(places.packs, payload.shards, strict=True):
        folder = work.place.result(packs.STAGE.name, key)
        records.append(GeometryShardRecord(name, size, np.load(folder / "geometry.npy"), np.load(folder / "packs.npy")))
    joined, packs_table, shards = join_geometry(records)
    geometry = np.empty_like(joined)
    geometry[np.load(work.place.result(order.STAGE.name, places.order) / order.SEQUENCE)] = joined
    written = write_tables_shard(
        work.place.store,
        drafted.parts,
        drafted.part_names,
        drafted.instances,
        geometry,
        packs_table,
        drafted.nodes,
        drafted.drawables,
    )
    content = to_json(geometry_section(drafted.grid.step, written, shards))
    (work.out / SECTION).write_text(json.dumps(content, sort_keys=True))
    return {"shards": [[written.shard.name, written.shard.bytes]], "content": content_key(content)}
