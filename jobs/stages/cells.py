"""The work on view cells: what can be seen from each, their order, and their shards."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.running.arrays import mapped_array, save_array
from jobs.running.tasks import Assignment, Json, content_of_arrays
from jobs.running.workplace import Workplace
from jobs.stages import CELLS, LAYOUT, TABLES
from jobs.stages.detail import SECTION
from storage.base.typed_json import from_json

if TYPE_CHECKING:
    from jobs.cells.subtree import CellParameters
    from storage.geometry_reader import Geometry

#: File of a layout task: see `shards_needed`.
NEEDS = "needs.json"


def compute_cells(work: Assignment) -> dict[str, Any]:
    """A subtree of view cells with what can be seen from each."""
    from jobs.cells.subtree import compute_subtree, triangles_needed

    store = _geometry(work.place.store, work.place.result(TABLES.name, work.places["tables"]) / SECTION)
    parameters = cell_parameters(work.payload["parameters"])
    result = compute_subtree(store, work.payload["root"], parameters)
    save_array(work.out / "cells.npy", result.cells)
    save_array(work.out / "offsets.npy", result.offsets)
    save_array(work.out / "ids.npy", result.ids)
    return {
        "open_keys": [int(key) for key in result.open_keys],
        "open_triangles": [triangles_needed(store, key, parameters) for key in result.open_keys],
        "cells": len(result.cells),
        "content": content_of_arrays(result.cells, result.offsets, result.ids),
    }


def lay_out_cells(work: Assignment) -> dict[str, Any]:
    """The order of all cells, and which of them share a face.

    Each task's cells become one shard, in the order of the tasks' root keys; they are numbered shard by shard.
    """
    from storage.cells.octree import neighbours

    keys = [np.load(work.place.result(CELLS.name, key) / "cells.npy")["key"] for key in work.places["cells"]]
    starts = np.concatenate([[0], np.cumsum([len(part) for part in keys], dtype=np.int64)]).astype(np.int64)
    pairs, _ = neighbours(np.concatenate([np.zeros(0, np.uint64), *keys]))
    save_array(work.out / "starts.npy", starts)
    save_array(work.out / "pairs.npy", pairs)
    shard = np.searchsorted(starts, pairs, side="right") - 1
    needs = [sorted({number, *shard[shard[:, 0] == number, 1].tolist()}) for number in range(len(keys))]
    (work.out / NEEDS).write_text(json.dumps(needs))
    return {"cells": int(starts[-1]), "boundaries": len(pairs), "content": content_of_arrays(starts, pairs)}


def shards_needed(place: Workplace, key: str) -> list[list[int]]:
    """For each cell shard of a layout, the shards whose cells it needs to know, itself among them."""
    needs: list[list[int]] = json.loads((place.result(LAYOUT.name, key) / NEEDS).read_text())
    return needs


def write_cells(work: Assignment) -> dict[str, Any]:
    """One subtree's cells to a cell shard: their vLODs and the changes across their faces."""
    from storage.vlod_writer import write_cell_shard

    layout = work.place.result(LAYOUT.name, work.places["layout"])
    starts = np.load(layout / "starts.npy")
    number = work.payload["shard"]
    first, end = int(starts[number]), int(starts[number + 1])
    pairs = mapped_array(layout / "pairs.npy")
    pairs = pairs[slice(*np.searchsorted(pairs[:, 0], [first, end]))]
    sets: dict[int, np.ndarray] = {}
    cells = np.zeros(0)
    for other, key in zip(work.payload["needs"], work.places["cells"], strict=True):
        folder = work.place.result(CELLS.name, key)
        offsets, ids = np.load(folder / "offsets.npy"), mapped_array(folder / "ids.npy")
        for at in range(len(offsets) - 1):
            sets[int(starts[other]) + at] = ids[offsets[at] : offsets[at + 1]]
        if other == number:
            cells = np.load(folder / "cells.npy")
    shard = write_cell_shard(
        work.place.store,
        cells,
        [sets[cell] for cell in range(first, end)],
        [(a, b, sets[a], sets[b]) for a, b in pairs.tolist()],
        first=first,
    )
    return {"shards": [[shard.name, shard.bytes]], "cells": shard.cells, "codec": shard.codec}


def cell_parameters(payload: Json) -> CellParameters:
    """The parameters of cells from a task's payload."""
    from jobs.cells.subtree import CellParameters
    from jobs.visibility.engine import EngineSettings
    from storage.cells.octree import Octree

    values = dict(payload)
    return CellParameters(
        octree=Octree(tuple(values.pop("octree_lo")), values.pop("octree_size")),
        view_lo=tuple(values.pop("view_lo")),
        view_hi=tuple(values.pop("view_hi")),
        engine=EngineSettings(**values.pop("engine")),
        **values,
    )


@functools.lru_cache(maxsize=1)
def _geometry(root: Path, section: Path) -> Geometry:
    """The geometry of a store that has no cells yet; a worker keeps it for its next task."""
    from storage.geometry_reader import open_geometry
    from storage.shards.sections import GeometrySection

    return open_geometry(root, from_json(GeometrySection, json.loads(section.read_text()), str(section)))
