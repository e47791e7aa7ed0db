"""The work of each kind of task. These functions run in worker processes; heavy modules are imported inside.

Each is a `jobs.tasks.Work`: it gets an assignment, writes its result into a fresh directory and the store's shards, and
returns a small record.
"""

from __future__ import annotations

import functools
import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.tasks import Assignment, Json, Stage, content_key
from jobs.workplace import Workplace

if TYPE_CHECKING:
    from jobs.cells import CellParameters
    from jobs.importing.model import Model
    from storage.store import Geometry

#: File of a tables task: the manifest's section on geometry.
SECTION = "geometry.json"

#: File of a layout task: see `shards_needed`.
NEEDS = "needs.json"

#: The reading and writing of stores decides what any of them gives.
_ALL = ("jobs.stages", "storage")

IMPORT = Stage("import", "jobs.stages:import_files", (*_ALL, "jobs.importing"), ("numpy", "trimesh"))
DETAIL = Stage(
    "detail",
    "jobs.stages:make_detail",
    (*_ALL, "jobs.assemble", "jobs.importing", "jobs.objects", "jobs.detail"),
    ("numpy", "numba", "fast-simplification", "zstandard"),
)
TABLES = Stage("tables", "jobs.stages:join_tables", (*_ALL, "jobs.assemble", "jobs.importing"), ("zstandard",))
CELLS = Stage("cells", "jobs.stages:compute_cells", (*_ALL, "jobs.cells", "jobs.visibility"), ("numpy", "numba"))
LAYOUT = Stage("layout", "jobs.stages:lay_out_cells", _ALL)
SHARDS = Stage("shards", "jobs.stages:write_cells", _ALL, ("zstandard",))


def import_files(work: Assignment) -> dict[str, Any]:
    """Model files to parts."""
    from jobs.importing.model import ImportOptions, import_model, open_model

    options = ImportOptions(**work.payload["options"])
    import_model([Path(path) for path in work.places["inputs"]], work.out / "model", options)
    model = open_model(work.out / "model")
    return {
        "model": {
            "digest": model.digest,
            "triangles": int(model.triangle_count),
            "lo": [float(value) for value in model.lo],
            "hi": [float(value) for value in model.hi],
            "origin": [float(value) for value in model.origin],
            "up": model.up,
            "unit_in_metres": model.unit_in_metres,
        },
        "repairs": dict(model.report),
    }


def imported_model(place: Workplace, key: str) -> Model:
    """The result of an import task."""
    from jobs.importing.model import open_model

    return open_model(place.result(IMPORT.name, key) / "model")


def make_detail(work: Assignment) -> dict[str, Any]:
    """Some meshes' levels to a geometry shard, and the nodes and drawables of all their placements."""
    from jobs.assemble import Placement, join, largest_stretch, place_piece
    from jobs.detail.pieces import DetailOptions, build_pieces
    from storage.writer import write_geometry_shard

    model = imported_model(work.place, work.places["import"])
    meshes = work.payload["meshes"]
    parts = np.flatnonzero(np.isin(model.parts["mesh"], meshes))
    instances = np.cumsum(~model.parts["identity"]) - 1
    stretch = largest_stretch(model.parts["matrix"][parts])
    placements: dict[int, list[Placement]] = {mesh: [] for mesh in meshes}
    for part, factor in zip(parts.tolist(), stretch.tolist(), strict=True):
        row = model.parts[part]
        instance = -1 if row["identity"] else int(instances[part])
        placements[int(row["mesh"])].append(Placement(part, instance, row["matrix"], factor))

    tables: list[tuple[np.ndarray, np.ndarray, int]] = []

    def stored() -> Any:
        for piece in build_pieces(model, meshes, DetailOptions(**work.payload["options"])):
            tables.append((*place_piece(piece, placements[piece.mesh], model.grid, 0), len(piece.levels)))
            yield [
                (level.positions, level.triangles, level.normals, level.colours, level.source_faces, piece.scale)
                for level in piece.levels
            ]

    shard = write_geometry_shard(work.place.store, stored())
    nodes, drawables = join(tables, model.lo, model.hi)
    np.save(work.out / "nodes.npy", nodes)
    np.save(work.out / "drawables.npy", drawables)
    np.save(work.out / "geometry.npy", shard.geometry)
    np.save(work.out / "packs.npy", shard.packs)
    return {"shards": [[shard.name, shard.bytes]], "content": _content(nodes, drawables, shard.geometry, shard.packs)}


def join_tables(work: Assignment) -> dict[str, Any]:
    """The small tables of all detail tasks to the model's tables and the manifest's section on geometry."""
    from jobs.assemble import join
    from storage.tables import INSTANCE, PART
    from storage.writer import GeometryShardRecord, geometry_section, join_geometry, write_tables_shard

    model = imported_model(work.place, work.places["import"])
    records, chunks = [], []
    for key, (name, size) in zip(work.places["detail"], work.payload["shards"], strict=True):
        folder = work.place.result(DETAIL.name, key)
        geometry = np.load(folder / "geometry.npy")
        records.append(GeometryShardRecord(name, size, geometry, np.load(folder / "packs.npy")))
        chunks.append((np.load(folder / "nodes.npy"), np.load(folder / "drawables.npy"), len(geometry)))
    nodes, drawables = join(chunks, model.lo, model.hi)
    geometry, packs, shards = join_geometry(records)

    triangles = model.meshes["triangles"][model.parts["mesh"]]
    parts = np.zeros(len(model.parts), PART)
    parts["mesh"], parts["faces"] = model.parts["mesh"], triangles
    placed = model.parts["matrix"][~model.parts["identity"]]
    instances = np.zeros(len(placed), INSTANCE)
    instances["matrix"] = placed
    names = [model.names[name] for name in model.parts["name"].tolist()]
    tables = write_tables_shard(work.place.store, parts, names, instances, geometry, packs, nodes, drawables)
    section = geometry_section(work.place.store, model.grid.step, tables, shards)
    (work.out / SECTION).write_text(json.dumps(section, sort_keys=True))
    return {"shards": [section["tables"]], "content": content_key(section), "counts": section["counts"]}


def geometry_section_of(place: Workplace, key: str) -> dict[str, Any]:
    """The manifest's section on geometry, from a tables task."""
    section: dict[str, Any] = json.loads((place.result(TABLES.name, key) / SECTION).read_text())
    return section


def compute_cells(work: Assignment) -> dict[str, Any]:
    """A subtree of view cells with what can be seen from each."""
    from jobs.cells import compute_subtree

    store = _geometry(work.place.store, work.place.result(TABLES.name, work.places["tables"]) / SECTION)
    result = compute_subtree(store, work.payload["root"], cell_parameters(work.payload["parameters"]))
    np.save(work.out / "cells.npy", result.cells)
    np.save(work.out / "offsets.npy", result.offsets)
    np.save(work.out / "ids.npy", result.ids)
    return {
        "open_keys": [int(key) for key in result.open_keys],
        "cells": len(result.cells),
        "content": _content(result.cells, result.offsets, result.ids),
    }


def lay_out_cells(work: Assignment) -> dict[str, Any]:
    """The order of all cells, and which of them share a face.

    Each task's cells become one shard, in the order of the tasks' root keys; they are numbered shard by shard.
    """
    from storage.octree import neighbours

    keys = [np.load(work.place.result(CELLS.name, key) / "cells.npy")["key"] for key in work.places["cells"]]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in keys], dtype=np.int64)]).astype(np.int64)
    pairs, _ = neighbours(np.concatenate([np.zeros(0, np.uint64), *keys]))
    np.save(work.out / "starts.npy", starts)
    np.save(work.out / "pairs.npy", pairs)
    shard = np.searchsorted(starts, pairs, side="right") - 1
    needs = [sorted({number, *shard[shard[:, 0] == number, 1].tolist()}) for number in range(len(keys))]
    (work.out / NEEDS).write_text(json.dumps(needs))
    return {"cells": int(starts[-1]), "boundaries": len(pairs), "content": _content(starts, pairs)}


def shards_needed(place: Workplace, key: str) -> list[list[int]]:
    """For each cell shard of a layout, the shards whose cells it needs to know, itself among them."""
    needs: list[list[int]] = json.loads((place.result(LAYOUT.name, key) / NEEDS).read_text())
    return needs


def write_cells(work: Assignment) -> dict[str, Any]:
    """One subtree's cells to a cell shard: their vLODs and the changes across their faces."""
    from storage.writer import write_cell_shard

    layout = work.place.result(LAYOUT.name, work.places["layout"])
    starts = np.load(layout / "starts.npy")
    number = work.payload["shard"]
    first, end = int(starts[number]), int(starts[number + 1])
    pairs = np.load(layout / "pairs.npy", mmap_mode="r")
    pairs = pairs[slice(*np.searchsorted(pairs[:, 0], [first, end]))]
    sets: dict[int, np.ndarray] = {}
    cells = np.zeros(0)
    for other, key in zip(work.payload["needs"], work.places["cells"], strict=True):
        folder = work.place.result(CELLS.name, key)
        offsets, ids = np.load(folder / "offsets.npy"), np.load(folder / "ids.npy", mmap_mode="r")
        for at in range(len(offsets) - 1):
            sets[int(starts[other]) + at] = ids[offsets[at] : offsets[at + 1]]
        if other == number:
            cells = np.load(folder / "cells.npy")
    name = write_cell_shard(
        work.place.store,
        cells,
        [sets[cell] for cell in range(first, end)],
        [(a, b, sets[a], sets[b]) for a, b in pairs.tolist()],
        first=first,
    )
    return {"shards": [[name, (work.place.store / "shards" / name).stat().st_size]]}


def cell_parameters(payload: Json) -> CellParameters:
    """The parameters of cells from a task's payload."""
    from jobs.cells import CellParameters
    from jobs.visibility.engine import EngineSettings
    from storage.octree import Octree

    values = dict(payload)
    return CellParameters(
        octree=Octree(tuple(values.pop("octree_lo")), values.pop("octree_size")),
        view_lo=tuple(values.pop("view_lo")),
        view_hi=tuple(values.pop("view_hi")),
        engine=EngineSettings(**values.pop("engine")),
        **values,
    )


def _content(*arrays: np.ndarray) -> str:
    """Hash of arrays' bytes."""
    digest = hashlib.blake2b(digest_size=16)
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@functools.lru_cache(maxsize=1)
def _geometry(root: Path, section: Path) -> Geometry:
    """The geometry of a store that has no cells yet; a worker keeps it for its next task."""
    from storage.store import open_geometry

    return open_geometry(root, json.loads(section.read_text()))
