"""From meshes to pieces: parts of meshes as Partition I leaves them, ready to become the leaves of the hierarchy.

    plan_chunks(model, triangles)            lists of meshes, for tasks of about equal work
    make_pieces(model, meshes, options)      the pieces of some meshes
    save_pieces, open_pieces                 as files that are mapped into memory

A mesh's triangles that can be seen through are parted as if they were a mesh of their own: no piece is of both kinds.
What needs a whole mesh is worked out here: which triangles belong together, normals averaged across the borders of
pieces, which vertices pieces share, and how far snapping to the grid moved the surface. What is cheap per triangle is
done for a batch of meshes at once, so that thousands of boxes cost no more than one mesh of their size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from jobs.detail.bounds.displacement import group_maximum, snapped
from jobs.detail.collapsing.attributes import corner_normals, keep_given_normals
from jobs.detail.collapsing.face_normals import face_normals
from jobs.detail.detail_options import DetailOptions
from jobs.importing.model import Model
from jobs.objects.find import GridPieces, find_pieces
from jobs.running.arrays import mapped_array, save_array
from storage.meshes.normals import to_octahedral
from storage.model.tables import GRID_LIMIT

#: Meshes are handled together up to this many triangles, so that the tables over them stay in the processor's cache.
BATCH_TRIANGLES = 1 << 15
#: A mesh's grid may be coarser than the model's by this relative amount: rounding in a rotation's stretch.
STRETCH_TOLERANCE = 1e-6
#: What rounding may have done to a displacement, relative.
ROUNDING = 1e-12

#: One piece.
PIECE = np.dtype(
    [
        ("mesh", "<u4"),  # index of the imported mesh
        ("start", "<u8"),  # first triangle in the set's arrays
        ("triangles", "<u4"),
        ("scale", "<f8"),  # local units per grid step, a power of two
        ("lo", "<f8", (3,)),  # box in local units
        ("hi", "<f8", (3,)),
        ("error", "<f8"),  # how far what is snapped lies from the imported triangles, both ways, in grid steps
        ("left_out", "<f8"),  # how far faces that are not drawn lie from the imported ones that are, 0 without any
        ("outward", "?"),  # opaque, and its components are closed (with their other pieces) and wound outward
        ("split", "?"),  # it shares vertices with other pieces
        ("see_through", "?"),  # all its triangles can be seen through; else none can
    ]
)


@dataclass(frozen=True, eq=False)
class PieceSet:
    """The pieces of some meshes, mesh after mesh."""

    pieces: np.ndarray  # PIECE (p,)
    faces: np.ndarray  # (m,) uint32: triangles of the imported mesh, piece by piece
    shading: np.ndarray  # (3 m, 2) int16: octahedral normals of the corners
    shared_points: np.ndarray  # (s, 3) int32: grid positions of vertices that lie in several pieces of a mesh
    sharing_start: np.ndarray  # (s + 1,) int64 into sharing
    sharing: np.ndarray  # (n,) int32: the pieces that each of them lies in
    touching_start: np.ndarray  # (p + 1,) int64 into touching
    touching: np.ndarray  # (n,) int32: the shared vertices of each piece


def save_pieces(folder: Path, pieces: PieceSet) -> None:
    """Write a set's arrays into a folder."""
    for field in fields(PieceSet):
        save_array(folder / f"{field.name}.npy", getattr(pieces, field.name))


def open_pieces(folder: Path) -> PieceSet:
    """A set that was saved, mapped into memory."""
    return PieceSet(**{field.name: mapped_array(folder / f"{field.name}.npy") for field in fields(PieceSet)})


def plan_chunks(model: Model, triangles: int) -> list[list[int]]:
    """Group the model's meshes, in their order, into chunks of about that many triangles each."""
    return _grouped_by_size(model, range(len(model.meshes)), triangles)


def make_pieces(model: Model, mesh_ids: Sequence[int], options: DetailOptions) -> PieceSet:
    """The pieces of some of the model's meshes. Memory is proportional to the largest batch, and to the result."""
    return _joined(list(_batches(model, mesh_ids, options)))


def mesh_scales(model: Model, mesh_ids: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Local units per grid step, a power of two, for each mesh (k,) float64; and the largest stretch by a placement.

    The model's grid step for meshes that lie in model space; for instanced ones the largest power of two that is at
    most a grid step under every placement, but large enough that coordinates stay within GRID_LIMIT.
    """
    scales = np.full(len(mesh_ids), model.grid.step)
    position = np.full(len(model.meshes), -1)
    position[list(mesh_ids)] = np.arange(len(mesh_ids))
    own = position[model.parts["mesh"]]
    placed = np.flatnonzero((own >= 0) & ~model.parts["identity"])
    if len(placed) == 0:
        return scales, np.ones(len(mesh_ids))
    stretch = np.zeros(len(mesh_ids))
    linear = np.ascontiguousarray(model.parts["matrix"][placed][:, :, :3])
    np.maximum.at(stretch, own[placed], np.linalg.svd(linear, compute_uv=False).max(axis=1))
    for i in np.flatnonzero(stretch > 0).tolist():
        largest = float(np.abs(model.mesh(mesh_ids[i]).positions).max(initial=0.0))
        fine = np.floor(np.log2(model.grid.step / stretch[i] * (1 + STRETCH_TOLERANCE)))
        coarse = np.ceil(np.log2(largest * 1.001 / GRID_LIMIT)) if largest > 0 else fine
        scales[i] = 2.0 ** max(fine, coarse)
    return scales, np.where(stretch > 0, stretch, 1.0)


def _grouped_by_size(model: Model, mesh_ids: Sequence[int], triangles: int) -> list[list[int]]:
    """Consecutive meshes in groups: a new one begins where the next mesh would lift the last above `triangles`."""
    groups: list[list[int]] = []
    held = 0
    for mesh in mesh_ids:
        size = int(model.meshes["triangles"][mesh])
        if not groups or held + size > triangles:
            groups.append([])
            held = 0
        groups[-1].append(int(mesh))
        held += size
    return groups


def _batches(model: Model, mesh_ids: Sequence[int], options: DetailOptions) -> Iterator[PieceSet]:
    """The pieces of the meshes, some meshes at a time."""
    extent = model.hi - model.lo
    diagonal = float(np.sqrt((extent * extent).sum()))
    crease = float(np.cos(np.deg2rad(options.crease_angle)))
    for batch in _grouped_by_size(model, mesh_ids, BATCH_TRIANGLES):
        views = [model.mesh(mesh) for mesh in batch]
        scales, stretch = mesh_scales(model, batch)
        counts = np.array([len(view.positions) for view in views])
        mesh_of_vertex = np.repeat(np.arange(len(batch), dtype=np.int32), counts)
        first_vertex = np.concatenate([[0], np.cumsum(counts)])
        triangles = np.concatenate(
            [view.triangles.astype(np.int64) + first for view, first in zip(views, first_vertex[:-1], strict=True)]
        )
        first_face = np.cumsum([0, *(len(view.triangles) for view in views)])
        grid_points, displacement = snapped(np.concatenate([view.positions for view in views]), scales[mesh_of_vertex])
        size = np.repeat(options.partition.size * diagonal / (stretch * scales), 2)
        clear = np.concatenate([view.colours[:, 3] < 255 for view in views])
        found = find_pieces(grid_points, 2 * mesh_of_vertex + clear, triangles, len(size), options.partition, size)
        mesh, see_through = found.mesh >> 1, (found.mesh & 1).astype(np.bool_)

        corners = triangles[found.source].reshape(-1)
        normals, areas = face_normals(found.points, found.triangles)
        shading = corner_normals(found.points, found.triangles, found.twin, normals, areas, crease)
        keep_given_normals(shading, np.concatenate([view.normals for view in views]), corners, normals)
        errors = group_maximum(displacement[corners], 3 * found.start)
        worst = _left_out(found, displacement[triangles])

        count = len(found.start) - 1
        pieces = np.zeros(count, PIECE)
        pieces["mesh"] = np.array(batch)[mesh]
        pieces["start"], pieces["triangles"] = found.start[:-1], np.diff(found.start)
        pieces["scale"] = scales[mesh]
        pieces["lo"], pieces["hi"] = found.lo * scales[mesh, None], found.hi * scales[mesh, None]
        pieces["error"] = np.maximum(errors, worst) * (1.0 + ROUNDING)
        pieces["left_out"] = np.where(worst >= 0, errors + worst, 0.0) * (1.0 + ROUNDING)
        pieces["outward"], pieces["see_through"] = found.outward & ~see_through, see_through
        owners = np.argsort(found.sharing, kind="stable")
        vertices = np.repeat(np.arange(len(found.shared), dtype=np.int32), np.diff(found.sharing_start))
        touching = np.bincount(found.sharing, minlength=count)
        pieces["split"] = touching > 0
        yield PieceSet(
            pieces,
            (found.source - np.repeat(first_face[mesh], np.diff(found.start))).astype(np.uint32),
            to_octahedral(shading).astype(np.int16),
            found.points[found.shared],
            found.sharing_start,
            found.sharing,
            np.concatenate([[0], np.cumsum(touching)]).astype(np.int64),
            vertices[owners],
        )


def _joined(sets: Sequence[PieceSet]) -> PieceSet:
    """Several sets as one."""
    if len(sets) == 1:
        return sets[0]
    pieces = np.concatenate([s.pieces for s in sets])
    triangle_starts = np.cumsum([0, *(len(s.faces) for s in sets)])
    piece_starts = np.cumsum([0, *(len(s.pieces) for s in sets)])
    shared_starts = np.cumsum([0, *(len(s.shared_points) for s in sets)])
    pieces["start"] += np.repeat(triangle_starts[:-1], np.diff(piece_starts)).astype(np.uint64)
    return PieceSet(
        pieces,
        np.concatenate([s.faces for s in sets]),
        np.concatenate([s.shading for s in sets]),
        np.concatenate([s.shared_points for s in sets]),
        _joined_starts([s.sharing_start for s in sets]),
        np.concatenate([s.sharing + np.int32(n) for s, n in zip(sets, piece_starts[:-1], strict=True)]),
        _joined_starts([s.touching_start for s in sets]),
        np.concatenate([s.touching + np.int32(n) for s, n in zip(sets, shared_starts[:-1], strict=True)]),
    )


def _joined_starts(starts: Sequence[np.ndarray]) -> np.ndarray:
    """Where lists begin when sets of lists follow each other: (n + 1,) int64."""
    return np.concatenate([[0], np.cumsum(np.concatenate([np.diff(s) for s in starts]))]).astype(np.int64)


def _left_out(found: GridPieces, displacement: np.ndarray) -> np.ndarray:
    """How far snapping moved faces that are not drawn and may belong to each piece: (pieces,), -1 without any.

    displacement (m, 3): of the corners of all faces. On the grid such a face lies on others of its component, in one
    piece of it or in several.
    """
    worst = np.full(len(found.start) - 1, -1.0)
    if len(found.flat_source):
        of_component = np.full(int(found.component.max()) + 1, -1.0)
        np.maximum.at(of_component, found.flat_component, displacement[found.flat_source].max(axis=1))
        np.maximum.at(worst, np.repeat(np.arange(len(worst)), np.diff(found.start)), of_component[found.component])
    return worst
