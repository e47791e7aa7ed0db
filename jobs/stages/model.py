"""The work on the model as a whole: its import, its pieces, and the hierarchy of its objects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.running.arrays import mapped_array, save_array
from jobs.running.tasks import Assignment, Json, content_of_arrays
from jobs.running.workplace import Workplace
from jobs.stages import HIERARCHY, IMPORT, PIECES

if TYPE_CHECKING:
    from jobs.detail.detail_options import DetailOptions
    from jobs.importing.model import Model
    from jobs.objects.object_options import ObjectOptions


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


def find_pieces(work: Assignment) -> dict[str, Any]:
    """Some meshes to pieces, no larger than Partition I allows."""
    from jobs.detail.pieces import make_pieces, save_pieces

    model = imported_model(work.place, work.places["import"])
    found = make_pieces(model, work.payload["meshes"], detail_options(work.payload["options"]))
    save_pieces(work.out, found)
    return {
        "pieces": len(found.pieces),
        "triangles": len(found.faces),
        "content": content_of_arrays(found.pieces, found.faces, found.shading, found.shared_points, found.sharing),
    }


def make_hierarchy(work: Assignment) -> dict[str, Any]:
    """All placed pieces to objects, and the tree above them."""
    from jobs.detail.assemble import largest_stretch
    from jobs.objects.hierarchy import PLACED_PIECE, build_hierarchy

    model = imported_model(work.place, work.places["import"])
    tables = [np.load(work.place.result(PIECES.name, key) / "pieces.npy") for key in work.places["pieces"]]
    pieces = np.concatenate(tables)
    mesh_start = np.searchsorted(pieces["mesh"], np.arange(len(model.meshes) + 1))
    counts = np.diff(mesh_start)[model.parts["mesh"]]
    part_start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    part = np.repeat(np.arange(len(model.parts)), counts)
    piece = np.arange(part_start[-1]) - part_start[part] + mesh_start[model.parts["mesh"]][part]
    placed = np.zeros(len(piece), PLACED_PIECE)
    placed["piece"], placed["part"] = piece, part
    placed["triangles"], placed["outward"] = pieces["triangles"][piece], pieces["outward"][piece]
    placed["instanced"] = ~model.parts["identity"][part]
    placed["lo"], placed["hi"] = _placed_boxes(pieces["lo"][piece], pieces["hi"][piece], model.parts["matrix"][part])
    made = build_hierarchy(placed, object_options(work.payload["options"]), model.lo, model.hi)
    shapes = Shapes(
        end=made.tree.end,
        leaf=made.tree.leaf,
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
    """The result of a hierarchy task: which placed pieces make which leaf, and the tree above."""

    end: np.ndarray  # (n,) int64: see jobs.objects.tree
    leaf: np.ndarray  # (n,) int64: the object of a leaf, -1 of inner nodes
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
        folder = place.result(HIERARCHY.name, key)
        names = Shapes.__dataclass_fields__
        return Shapes(**{name: mapped_array(folder / f"{name}.npy") for name in names})

    def object_of_placed(self) -> np.ndarray:
        """The object (p,) int64 of each placed piece."""
        objects = np.empty(len(self.members), np.int64)
        objects[self.members] = np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))
        return objects


def detail_options(payload: Json) -> DetailOptions:
    """Options of detail from a task's payload."""
    from jobs.detail.detail_options import DetailOptions
    from jobs.objects.object_options import Limits

    values = dict(payload)
    return DetailOptions(partition=Limits(**values.pop("partition")), **values)


def object_options(payload: Json) -> ObjectOptions:
    """Options of objects from a task's payload."""
    from jobs.objects.object_options import Clustering, Limits, ObjectOptions

    return ObjectOptions(clustering=Clustering(**payload["clustering"]), again=Limits(**payload["again"]))


def _placed_boxes(lo: np.ndarray, hi: np.ndarray, matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (n, 3) in model space around boxes lo, hi (n, 3) placed by matrices (n, 3, 4)."""
    low, high = matrices[:, :, 3].copy(), matrices[:, :, 3].copy()
    for column in range(3):
        one = matrices[:, :, column] * lo[:, None, column]
        other = matrices[:, :, column] * hi[:, None, column]
        low += np.minimum(one, other)
        high += np.maximum(one, other)
    return low, high
