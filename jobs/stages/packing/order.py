"""Order: in which sequence meshes lie in packs, so that what appears together is read together. One task.

Meshes that some cell sees follow the drawables' tour; behind them come all others, as they lay in space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.running.arrays import save_array
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, content_of_arrays
from jobs.stages import cells, layout, tables
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from jobs.stages.support.written_geometry import open_drafted
from storage.base.typed_json import to_json

if TYPE_CHECKING:
    from storage.geometry_reader import Geometry

STAGE = Stage("order", "jobs.stages.packing.order:order_meshes", code.ORDER, ("numpy", "numba"))

#: Bytes for each id of all cells, measured: 32; and for each node, whose tables are read.
PER_ID = 60
PER_NODE = 3000

#: Files of a task: the meshes' rows of GEOMETRY in their sequence (meshes,) int64; the place of the first of each pack,
#: and the end (packs + 1,) int64.
SEQUENCE = "sequence.npy"
PACKS = "packs.npy"


@dataclass(frozen=True)
class Payload:
    """What decides the order."""

    geometry: str  # content of the tables
    layout: str  # content
    cells: tuple[str, ...]  # content of each subtree, by root


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    tables: str
    layout: str
    cells: tuple[str, ...]


def tasks(state: BuildState) -> Tasks:
    """The task."""
    joined, laid_out, found = state.one(tables.STAGE), state.one(layout.STAGE), cells.finished_cells(state)
    payload = Payload(
        joined.record["content"],
        laid_out.record["content"],
        tuple(result.record["content"] for result in found),
    )
    places = Places(joined.key, laid_out.key, tuple(result.key for result in found))
    ids = sum(int(result.record["ids"]) for result in found)
    memory = PROCESS + PER_ID * ids + PER_NODE * int(joined.record["counts"]["nodes"])
    return Tasks([Task(STAGE, to_json(payload), to_json(places), memory)])


def order_meshes(work: Assignment) -> dict[str, Any]:
    """The sequence of all meshes, and where packs and shards of them begin."""
    from jobs.ordering.columns import columns_of_changes
    from jobs.ordering.packing import pack_starts, shard_starts
    from jobs.ordering.tour import tour
    from storage.geometry_writer import mesh_bytes

    _, places = work.read(Payload, Places)
    geometry = open_drafted(work.place, tables.STAGE.name, places.tables)
    sets: list[np.ndarray] = []
    for key in places.cells:
        folder = work.place.result(cells.STAGE.name, key)
        offsets, ids = np.load(folder / "offsets.npy"), np.load(folder / "ids.npy")
        sets += np.split(ids, offsets[1:-1])
    pairs = np.load(work.place.result(layout.STAGE.name, places.layout) / layout.PAIRS)
    seen = np.zeros(len(geometry.drawables), np.bool_)
    for ids in sets:
        seen[ids] = True
    order = tour(columns_of_changes(sets, pairs, len(seen)))

    sequence = sequence_of_meshes(geometry, order, seen)
    rows = geometry.geometry[sequence]
    marks = marks_of_meshes(geometry)[sequence]
    packs = pack_starts(mesh_bytes(rows["vertices"], rows["triangles"]), marks)
    shards = shard_starts(marks[packs[:-1]])
    save_array(work.out / SEQUENCE, sequence)
    save_array(work.out / PACKS, packs)
    return {"first_packs": shards.tolist(), "content": content_of_arrays(sequence, packs, shards)}


def sequence_of_meshes(geometry: Geometry, order: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """The meshes in the order of the first of their drawables that is seen; those of none behind them, pack by pack.

    order: (drawables,) int64; seen: (drawables,) bool. Returns rows of GEOMETRY (meshes,) int64.
    """
    count = len(geometry.geometry)
    first = np.full(count, len(order), np.int64)
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    mesh = geometry.drawables["geometry"].astype(np.int64)
    np.minimum.at(first, mesh[seen], place[seen])
    return np.lexsort((np.arange(count), geometry.geometry["pack"], first))


def marks_of_meshes(geometry: Geometry) -> np.ndarray:
    """A random number for each mesh, (meshes,) uint64, that follows from its size and where it is placed first."""
    from jobs.ordering.signatures import mixed

    mesh = geometry.drawables["geometry"].astype(np.int64)
    _, drawable = np.unique(mesh, return_index=True)
    rows = geometry.drawables[drawable]
    marks = np.zeros(len(drawable), np.uint64)
    corners = np.ascontiguousarray(np.concatenate([rows["lo"], rows["hi"]], axis=1), np.float64).view(np.uint64)
    for column in (*corners.T, rows["triangles"].astype(np.uint64)):
        marks = mixed(marks ^ column)
    return marks
