"""Hierarchy: pieces to objects, and the trees above them. One task, which sees boxes only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jobs.objects.object_options import ObjectOptions
from jobs.running.arrays import mapped_array, save_array
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, content_of_arrays
from jobs.running.workplace import Workplace
from jobs.stages import import_model, pieces
from jobs.stages.import_model import imported_model
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from storage.base.typed_json import to_json

STAGE = Stage(
    "hierarchy",
    "jobs.stages.hierarchy:make_hierarchy",
    code.HIERARCHY,
    ("numpy", "numba"),
    apart=code.IMPORTERS,
)

#: Bytes for each placed piece.
PER_PIECE = 2000

#: Bytes for each placed piece where `Shapes` are looked into.
SHAPES_PER_PIECE = 400


@dataclass(frozen=True)
class Payload:
    """What decides the objects and their trees."""

    model: str  # digest
    pieces: tuple[str, ...]  # contents of all chunks
    options: ObjectOptions


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    model: str  # of the import
    pieces: tuple[str, ...]


def tasks(state: BuildState) -> Tasks:
    """The task: clusters, objects and the trees."""
    imported, found = state.one(import_model.STAGE), state.all(pieces.STAGE)
    payload = Payload(
        model=imported.record["model"]["digest"],
        pieces=tuple(chunk.record["content"] for chunk in found),
        options=state.parameters.objects(),
    )
    places = Places(imported.key, tuple(chunk.key for chunk in found))
    count = sum(int(chunk.record["pieces"]) for chunk in found)
    return Tasks([Task(STAGE, to_json(payload), to_json(places), PROCESS + PER_PIECE * count)])


def make_hierarchy(work: Assignment) -> dict[str, Any]:
    """All placed pieces to objects, and the trees above them."""
    from jobs.detail.assemble import largest_stretch
    from jobs.objects.hierarchy import PLACED_PIECE, build_hierarchy

    payload, places = work.read(Payload, Places)
    model = imported_model(work.place, places.model)
    tables = [np.load(work.place.result(pieces.STAGE.name, key) / "pieces.npy") for key in places.pieces]
    rows = np.concatenate(tables)
    mesh_start = np.searchsorted(rows["mesh"], np.arange(len(model.meshes) + 1))
    counts = np.diff(mesh_start)[model.parts["mesh"]]
    part_start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    part = np.repeat(np.arange(len(model.parts)), counts)
    piece = np.arange(part_start[-1]) - part_start[part] + mesh_start[model.parts["mesh"]][part]
    placed = np.zeros(len(piece), PLACED_PIECE)
    placed["piece"], placed["part"] = piece, part
    for name in ("triangles", "outward", "see_through"):
        placed[name] = rows[name][piece]
    placed["instanced"] = ~model.parts["identity"][part]
    placed["lo"], placed["hi"] = _placed_boxes(rows["lo"][piece], rows["hi"][piece], model.parts["matrix"][part])
    made = build_hierarchy(placed, payload.options, model.lo, model.hi)
    shapes = Shapes(
        end=made.tree.end,
        leaf=made.tree.leaf,
        roots=made.roots,
        members=made.members,
        start=made.start,
        shared=made.shared,
        placed=placed,
        part_start=part_start,
        mesh_start=mesh_start,
        chunk_start=np.cumsum([0, *(len(table) for table in tables)]),
        stretch=largest_stretch(model.parts["matrix"]),
    )
    shapes.save(work.out)
    return {
        "counts": {
            "parts": len(model.parts),
            "pieces": len(placed),
            "clusters": made.clusters,
            "objects": len(made.start) - 1,
            "shared": int(made.shared.sum()),
            "nodes": len(made.tree.end),
        },
        "content": content_of_arrays(made.tree.end, made.members, made.start, placed),
    }


@dataclass(frozen=True, eq=False)
class Shapes:
    """The result of a hierarchy task: which placed pieces make which leaf, and the trees above."""

    end: np.ndarray  # (n,) int64: see jobs.objects.tree
    leaf: np.ndarray  # (n,) int64: the object of a leaf, -1 of inner nodes
    roots: np.ndarray  # (trees,) int64: the node above all others of each tree; what can be seen through is the last's
    members: np.ndarray  # (p,) int64: placed pieces, object by object
    start: np.ndarray  # (objects + 1,) int64 into members
    shared: np.ndarray  # (objects,) bool: one placement of an instanced piece, with levels that all of them share
    placed: np.ndarray  # PLACED_PIECE (p,): part by part, in each the pieces of its mesh in their order
    part_start: np.ndarray  # (parts + 1,) int64 into placed
    mesh_start: np.ndarray  # (meshes + 1,) int64: first piece of each mesh
    chunk_start: np.ndarray  # (chunks + 1,) int64: first piece of each task that found pieces
    stretch: np.ndarray  # (parts,) float64: upper bound of the factor by which each part's matrix lengthens

    def save(self, folder: Path) -> None:
        """Writes all arrays into a folder."""
        for name, array in vars(self).items():
            save_array(folder / f"{name}.npy", array)

    @staticmethod
    def open(place: Workplace, key: str) -> Shapes:
        """The result of a task, mapped into memory."""
        folder = place.result(STAGE.name, key)
        names = Shapes.__dataclass_fields__
        return Shapes(**{name: mapped_array(folder / f"{name}.npy") for name in names})

    def object_of_placed(self) -> np.ndarray:
        """The object (p,) int64 of each placed piece."""
        objects = np.empty(len(self.members), np.int64)
        objects[self.members] = np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))
        return objects


def _placed_boxes(lo: np.ndarray, hi: np.ndarray, matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (n, 3) in model space around boxes lo, hi (n, 3) placed by matrices (n, 3, 4)."""
    low, high = matrices[:, :, 3].copy(), matrices[:, :, 3].copy()
    for column in range(3):
        one = matrices[:, :, column] * lo[:, None, column]
        other = matrices[:, :, column] * hi[:, None, column]
        low += np.minimum(one, other)
        high += np.maximum(one, other)
    return low, high
