"""Tables: the rows of all tasks on nodes to the tables of the whole model, for the tasks that come after. One task."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, content_key
from jobs.stages import hierarchy, import_model, nodes, shared
from jobs.stages.hierarchy import Shapes
from jobs.stages.import_model import imported_model
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from jobs.stages.support.written_geometry import SECTION
from storage.base.typed_json import to_json

STAGE = Stage(
    "tables",
    "jobs.stages.tables:join_tables",
    code.TABLES,
    ("numpy", "zstandard"),
    apart=(*code.IMPORTERS, "storage.geometry_reader"),
)

#: Bytes for each node. Measured: 1,700.
PER_NODE = 3000


@dataclass(frozen=True)
class Payload:
    """What decides the tables."""

    model: str  # digest
    hierarchy: str  # content
    shards: tuple[tuple[str, int], ...]  # names and bytes of the geometry shards
    tables: tuple[str, ...]  # contents of the tasks that wrote them


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    model: str  # of the import
    hierarchy: str
    written: tuple[tuple[str, str], ...]  # stage and key of each task that wrote nodes, in the order of the shards


def tasks(state: BuildState) -> Tasks:
    """The task: what is shared first, then the trees' fragments in the order of their roots."""
    imported, tree = state.one(import_model.STAGE), state.one(hierarchy.STAGE)
    in_tree = sorted(state.all(nodes.STAGE), key=lambda result: int(result.task.payload["root"]))
    written = [*state.all(shared.STAGE), *in_tree]
    payload = Payload(
        model=imported.record["model"]["digest"],
        hierarchy=tree.record["content"],
        shards=tuple(tuple(result.record["drafts"][0]) for result in written),
        tables=tuple(result.record["content"] for result in written),
    )
    places = Places(imported.key, tree.key, tuple((result.task.stage.name, result.key) for result in written))
    memory = PROCESS + PER_NODE * int(tree.record["counts"]["nodes"])
    return Tasks([Task(STAGE, to_json(payload), to_json(places), memory)])


def join_tables(work: Assignment) -> dict[str, Any]:
    """The small tables of all tasks on detail to the model's tables and the manifest's section on geometry."""
    from jobs.detail.assemble import join_nodes
    from storage.geometry_writer import GeometryShardRecord, geometry_section, join_geometry, write_tables_shard
    from storage.model.tables import INSTANCE, PART

    payload, places = work.read(Payload, Places)
    model = imported_model(work.place, places.model)
    shapes = Shapes.open(work.place, places.hierarchy)
    records, chunks = [], []
    for (stage, key), (name, size) in zip(places.written, payload.shards, strict=True):
        folder = work.place.result(stage, key)
        geometry = np.load(folder / "geometry.npy")
        records.append(GeometryShardRecord(name, size, geometry, np.load(folder / "packs.npy")))
        chunks.append(
            (np.load(folder / "places.npy"), np.load(folder / "nodes.npy"), np.load(folder / "drawables.npy"))
        )
    sizes = [len(record.geometry) for record in records]
    joined, drawables = join_nodes(np.asarray(shapes.end), chunks, sizes)
    geometry, packs, shards = join_geometry(records)

    triangles = model.meshes["triangles"][model.parts["mesh"]]
    parts = np.zeros(len(model.parts), PART)
    parts["mesh"], parts["faces"] = model.parts["mesh"], triangles
    placed = model.parts["matrix"][~model.parts["identity"]]
    instances = np.zeros(len(placed), INSTANCE)
    instances["matrix"] = placed
    names = [model.names[name] for name in model.parts["name"].tolist()]
    written = write_tables_shard(work.place.drafts, parts, names, instances, geometry, packs, joined, drawables)
    section = geometry_section(model.grid.step, written, shards)
    content = to_json(section)
    (work.out / SECTION).write_text(json.dumps(content, sort_keys=True))
    return {
        "drafts": [[section.tables.name, section.tables.bytes]],
        "content": content_key(content),
        "counts": content["counts"],
    }
