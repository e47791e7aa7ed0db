"""From meshes to pieces: objects and parts of objects, each with its chain of levels.

    build_pieces(model, meshes, options) -> Iterator[Piece]
    plan_chunks(model, options) -> list of lists of meshes, for tasks of about equal work

What is cheap per triangle is done for a batch of meshes at once (snapping, welding, components, the finest levels), so
that thousands of boxes cost no more than one mesh of their size; only pieces that can be simplified are handled alone.

Positions are integers on the mesh's own grid, finest level included; a level's error bounds its two-sided Hausdorff
distance to the imported float64 triangles of the piece: their largest displacement by snapping, plus the certified
distance between the snapped level and the finest snapped one. Faces that have no area once snapped are left out of the
levels, but not out of the error; an object that consists of nothing else, thinner than a grid step, has no piece.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jobs.detail.attributes import (
    build_vertices,
    corner_normals,
    keep_given_normals,
    sampled_colours,
    take_over_border_normals,
)
from jobs.detail.borders import local_meshes
from jobs.detail.closest import Surface, make_surface
from jobs.detail.displacement import group_maximum, snapped
from jobs.detail.hausdorff import one_sided_bound
from jobs.detail.levels import FEWEST, ROUNDING_STEPS, SLACK, CoarseLevel, Mesh, coarser_levels
from jobs.detail.normal_cone import face_normals, normal_cones
from jobs.importing.model import Model
from jobs.objects.find import Objects, find_objects
from storage.errors import ParameterError
from storage.tables import GRID_LIMIT

#: Meshes are handled together up to this many triangles.
BATCH_TRIANGLES = 200_000
#: A mesh's grid may be coarser than the model's by this relative amount: rounding in a rotation's stretch.
STRETCH_TOLERANCE = 1e-6
#: Faces without area are not measured more closely than this, in grid steps.
FLAT_STEPS = 1e-2
#: What rounding may have done to a displacement, relative.
ROUNDING = 1e-12


@dataclass(frozen=True)
class DetailOptions:
    """How models are parted into pieces and simplified."""

    component_triangle_limit: int = 10_000  # larger connected components are split, in triangles
    crease_angle: float = 40.0  # edges with a sharper angle between their faces' normals stay hard, in degrees
    triangles_per_chunk: int = 500_000  # meshes of a task together, about, in triangles

    def __post_init__(self) -> None:
        if self.component_triangle_limit < FEWEST:
            raise ParameterError(
                f"component_triangle_limit must be at least {FEWEST}, not {self.component_triangle_limit}"
            )
        if not 0.0 <= self.crease_angle <= 180.0:
            raise ParameterError(f"crease_angle must be from 0 to 180 degrees, not {self.crease_angle}")
        if self.triangles_per_chunk < 1:
            raise ParameterError(f"triangles_per_chunk must be at least 1, not {self.triangles_per_chunk}")


@dataclass(frozen=True, eq=False)
class Level:
    """One level of detail of a piece."""

    positions: np.ndarray  # (n, 3) int32; local coordinates = positions * the piece's scale
    triangles: np.ndarray  # (m, 3) uint32
    normals: np.ndarray  # (n, 3) float32, unit
    colours: np.ndarray  # (n, 4) uint8
    source_faces: np.ndarray | None  # (m,) uint32: faces of the imported mesh's source; finest level only
    error: float  # two-sided Hausdorff bound to the piece's imported triangles, in local units
    cone_axis: np.ndarray  # (3,) float32, unit: axis of a cone around all face normals
    cone_angle: float  # its half angle in radians, rounded up; pi where there is no useful cone


@dataclass(frozen=True, eq=False)
class Piece:
    """An object, or a part of one that was too large, with its levels."""

    mesh: int  # index of the imported mesh
    scale: float  # local units per integer step, a power of two
    one_sided: bool  # every level is closed (with its neighbours, if the object was split) and wound outward
    levels: tuple[Level, ...]  # finest first, errors strictly increasing


class Finest(NamedTuple):
    """What coarser levels take over from the finest one."""

    surface: Surface
    triangles: np.ndarray  # (m, 3) int32: vertices of the piece
    shading: np.ndarray  # (3 m, 3) float32: normals of the corners
    colours: np.ndarray  # (3 m, 4) uint8: colours of the corners
    locked: np.ndarray  # int32: vertices on the border to other pieces


def plan_chunks(model: Model, options: DetailOptions) -> list[list[int]]:
    """Group the model's meshes, in their order, into chunks of about `options.triangles_per_chunk` triangles each."""
    return _grouped_by_size(model, range(len(model.meshes)), options.triangles_per_chunk)


def build_pieces(
    model: Model,
    mesh_ids: Sequence[int],
    options: DetailOptions,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Piece]:
    """The pieces of some of the model's meshes, mesh by mesh, with all their levels.

    Memory is proportional to the largest batch: BATCH_TRIANGLES, or the largest mesh. `progress(done, total)` counts
    triangles.
    """
    total = int(model.meshes["triangles"][list(mesh_ids)].sum())
    done = 0
    for batch in _grouped_by_size(model, mesh_ids, BATCH_TRIANGLES):
        for piece, triangles in _batch_pieces(model, batch, options):
            yield piece
            done += triangles
            if progress is not None:
                progress(done, total)
    if progress is not None:
        progress(total, total)


def mesh_scales(model: Model, mesh_ids: Sequence[int]) -> np.ndarray:
    """Local units per grid step, a power of two, for each mesh: (k,) float64.

    The model's grid step for meshes that lie in model space; for instanced ones the largest power of two that is at
    most a grid step under every placement, but large enough that coordinates stay within GRID_LIMIT.
    """
    scales = np.full(len(mesh_ids), model.grid.step)
    position = np.full(len(model.meshes), -1)
    position[list(mesh_ids)] = np.arange(len(mesh_ids))
    own = position[model.parts["mesh"]]
    placed = np.flatnonzero((own >= 0) & ~model.parts["identity"])
    if len(placed) == 0:
        return scales
    stretch = np.zeros(len(mesh_ids))
    linear = np.ascontiguousarray(model.parts["matrix"][placed][:, :, :3])
    np.maximum.at(stretch, own[placed], np.linalg.svd(linear, compute_uv=False).max(axis=1))
    for i in np.flatnonzero(stretch > 0).tolist():
        largest = float(np.abs(model.mesh(mesh_ids[i]).positions).max(initial=0.0))
        fine = np.floor(np.log2(model.grid.step / stretch[i] * (1 + STRETCH_TOLERANCE)))
        coarse = np.ceil(np.log2(largest * 1.001 / GRID_LIMIT)) if largest > 0 else fine
        scales[i] = 2.0 ** max(fine, coarse)
    return scales


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


def _batch_pieces(model: Model, batch: list[int], options: DetailOptions) -> Iterator[tuple[Piece, int]]:
    """The pieces of a batch of meshes, each with the number of triangles of its finest level."""
    views = [model.mesh(mesh) for mesh in batch]
    scales = mesh_scales(model, batch)
    counts = np.array([len(view.positions) for view in views])
    mesh_of_vertex = np.repeat(np.arange(len(batch), dtype=np.int32), counts)
    first_vertex = np.concatenate([[0], np.cumsum(counts)])
    triangles = np.concatenate(
        [view.triangles.astype(np.int64) + first for view, first in zip(views, first_vertex[:-1], strict=True)]
    )
    if len(triangles) == 0:
        return
    source_faces = np.concatenate([view.source_faces for view in views])
    grid_points, displacement = snapped(np.concatenate([view.positions for view in views]), scales[mesh_of_vertex])
    objects = find_objects(grid_points, mesh_of_vertex, triangles, options.component_triangle_limit)
    pieces = len(objects.start) - 1
    if pieces == 0:
        return

    corners = triangles[objects.source].reshape(-1)
    normals, areas = face_normals(objects.points, objects.triangles)
    crease = float(np.cos(np.deg2rad(options.crease_angle)))
    shading = corner_normals(objects.points, objects.triangles, objects.whole_twin, normals, areas, crease)
    keep_given_normals(shading, np.concatenate([view.normals for view in views]), corners, normals)
    colours = np.concatenate([view.colours for view in views])[corners]
    vertices = build_vertices(objects.points, objects.triangles, objects.start, shading, colours)
    positions, vertex_normals, vertex_colours, indices, vertex_start = vertices
    axes, angles = normal_cones(normals, objects.start)
    local, used, used_start = local_meshes(objects.triangles, objects.start, len(objects.points))
    errors = group_maximum(displacement[corners], 3 * objects.start)
    _raise_by_flat(errors, objects, grid_points, triangles, displacement)
    errors *= 1.0 + ROUNDING
    mesh_of_piece = mesh_of_vertex[corners[3 * objects.start[:-1]]]

    for p in range(pieces):
        first, last = int(objects.start[p]), int(objects.start[p + 1])
        own = slice(first, last)
        own_vertices = slice(int(vertex_start[p]), int(vertex_start[p + 1]))
        scale = float(scales[mesh_of_piece[p]])
        levels = [
            Level(
                positions[own_vertices],
                indices[own],
                vertex_normals[own_vertices],
                vertex_colours[own_vertices],
                source_faces[objects.source[own]],
                float(errors[p]) * scale,
                axes[p],
                float(angles[p]),
            )
        ]
        if last - first >= FEWEST:
            of_piece = used[used_start[p] : used_start[p + 1]]
            twin = objects.twin[3 * first : 3 * last]
            split = bool(objects.split[p])
            locked = np.flatnonzero(objects.cut[of_piece] & split).astype(np.int32)
            mesh = Mesh(objects.points[of_piece], local[own], np.where(twin >= 0, twin - np.int32(3 * first), twin))
            chain = coarser_levels(mesh, float(errors[p]), locked, split, bool(objects.outward[p]))
            of_corners = slice(3 * first, 3 * last)
            finest = Finest(chain.finest, mesh.triangles, shading[of_corners], colours[of_corners], locked)
            levels += [_dressed(level, finest, crease, scale) for level in chain.levels]
        yield Piece(batch[mesh_of_piece[p]], scale, bool(objects.outward[p]), tuple(levels)), last - first


def _dressed(level: CoarseLevel, finest: Finest, crease: float, scale: float) -> Level:
    """A coarser level with normals and colours."""
    points, triangles, twin = level.mesh
    normals, areas = face_normals(points, triangles)
    shading = corner_normals(points, triangles, twin, normals, areas, crease)
    take_over_border_normals(
        shading, triangles, normals, level.held, finest.shading, finest.triangles, finest.locked, crease
    )
    colours = finest.colours
    if (colours == colours[0]).all():
        own_colours = np.repeat(colours[:1], 3 * len(triangles), axis=0)
    else:
        own_colours = sampled_colours(level.surface, finest.surface, colours)
    whole = np.array([0, len(triangles)])
    positions, vertex_normals, vertex_colours, indices, _ = build_vertices(
        points, triangles, whole, shading, own_colours
    )
    axes, angles = normal_cones(normals, whole)
    return Level(
        positions, indices, vertex_normals, vertex_colours, None, level.error * scale, axes[0], float(angles[0])
    )


def _raise_by_flat(
    errors: np.ndarray, objects: Objects, grid_points: np.ndarray, triangles: np.ndarray, displacement: np.ndarray
) -> None:
    """Raise the finest levels' errors (pieces,), in grid steps, so that they cover the faces that lost their area.

    Each object's flat faces are charged to the one of its pieces that they are nearest to.
    """
    if len(objects.flat_component) == 0:
        return
    order = np.argsort(objects.flat_component, kind="stable")
    components, begin = np.unique(objects.flat_component[order], return_index=True)
    for component, own in zip(components, np.split(objects.flat_source[order], begin[1:]), strict=True):
        corners, local = np.unique(triangles[own], return_inverse=True)
        flat = make_surface(grid_points[corners].astype(np.float64), local.reshape(-1, 3).astype(np.int32))
        nearest, smallest = 0, np.inf
        for p in range(*np.searchsorted(objects.component, [component, component + 1])):
            mesh = objects.triangles[objects.start[p] : objects.start[p + 1]]
            used, local = np.unique(mesh, return_inverse=True)
            surface = make_surface(objects.points[used].astype(np.float64), local.reshape(-1, 3).astype(np.int32))
            bound = one_sided_bound(flat, surface, FLAT_STEPS, SLACK)
            if bound < smallest:
                nearest, smallest = p, bound
        charge = float(displacement[corners].max()) + smallest + (ROUNDING_STEPS if smallest > 0 else 0.0)
        errors[nearest] = max(errors[nearest], charge)
