"""What a node of the hierarchy consists of, and how one is made from a patch of surface.

A leaf's levels are made from its pieces (`leaf`), an inner node's from what its children offer (`inner`). All of them
are dressed here: normals with creases kept, colours, vertices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jobs.detail.bounds.closest import Surface
from jobs.detail.collapsing.attributes import (
    build_vertices,
    corner_normals,
    sampled_colours,
    take_over_border_normals,
)
from jobs.detail.collapsing.borders import indices_of
from jobs.detail.collapsing.face_normals import face_normals
from jobs.detail.levels import CoarseLevel
from storage.base.kernels import kernel


@dataclass(frozen=True, eq=False)
class Level:
    """One level of detail of a node."""

    positions: np.ndarray  # (n, 3) int32; local coordinates = positions * the node's scale
    triangles: np.ndarray  # (m, 3) uint32
    normals: np.ndarray  # (n, 3) float32, unit
    colours: np.ndarray  # (n, 4) uint8
    source_faces: np.ndarray | None  # (m, 2) uint32: part and face of the model; finest levels of leaves only
    error: float  # from which on it may be shown, in local units: at least the two-sided Hausdorff distance to the
    # imported triangles that the node stands for, and more where things are lost that are wide compared with that
    one_sided: bool  # closed (with what lies beyond its locked borders) and wound outward


@dataclass(frozen=True, eq=False)
class Node:
    """A node's levels."""

    scale: float  # local units per integer step, a power of two
    levels: tuple[Level, ...]  # finest first, errors strictly increasing


class Locks(NamedTuple):
    """Vertices that surfaces share across the borders of leaves. They stay as long as one of the leaves is outside."""

    points: np.ndarray  # (k, 3) int32: grid positions
    first: np.ndarray  # (k,) int64: the first leaf that each one lies in
    last: np.ndarray  # (k,) int64: the last one

    def outside(self, first: int, last: int) -> Locks:
        """Those that also lie in a leaf other than first ... last."""
        kept = (self.first < first) | (self.last > last)
        return Locks(self.points[kept], self.first[kept], self.last[kept])


def no_locks() -> Locks:
    """None at all."""
    return Locks(np.zeros((0, 3), np.int32), np.zeros(0, np.int64), np.zeros(0, np.int64))


class Offer(NamedTuple):
    """What a node gives its parent to simplify: a surface in model space."""

    points: np.ndarray  # (n, 3) int32: positions on the model's grid
    triangles: np.ndarray  # (m, 3) int32
    colours: np.ndarray  # (3 m, 4) uint8: of the corners
    error: float  # to the model's surface, in grid steps
    lost: float  # largest width of a thing that is lost, in grid steps: see `bounds.coverage`
    outward: bool  # closed (with what lies beyond locked borders) and wound outward
    locks: Locks


class Finest(NamedTuple):
    """What coarser levels take over from the surface that they are made from."""

    surface: Surface
    points: np.ndarray  # (n, 3) int32
    triangles: np.ndarray  # (m, 3) int32
    shading: np.ndarray  # (3 m, 3) float32: normals of the corners; nothing where no vertex is held
    colours: np.ndarray  # (3 m, 4) uint8: colours of the corners
    gradients: bool  # whether colours differ within a triangle


@kernel()
def has_gradients(colours: np.ndarray) -> bool:
    """Whether corners' colours (3 m, 4) differ within a triangle."""
    for corner in range(0, len(colours), 3):
        for c in range(4):
            if colours[corner, c] != colours[corner + 1, c] or colours[corner, c] != colours[corner + 2, c]:
                return True
    return False


def dressed(level: CoarseLevel, finest: Finest, crease: float, scale: float) -> tuple[Level, np.ndarray]:
    """A coarser level with normals and colours; and its corners' colours (3 m, 4). crease: cosine of an angle."""
    points, triangles, twin = level.mesh
    normals, areas = face_normals(points, triangles)
    shading = corner_normals(points, triangles, twin, normals, areas, crease)
    if len(level.held):
        places = points[level.held]
        before = indices_of(finest.points, places)
        take_over_border_normals(
            shading, triangles, normals, level.held, finest.shading, finest.triangles, before, crease
        )
    if finest.gradients:
        colours = sampled_colours(level.surface, finest.surface, finest.colours)
    else:  # each triangle keeps its own
        colours = finest.colours.reshape(-1, 3, 4)[level.source].reshape(-1, 4)
    return level_of(points, triangles, shading, colours, None, level.shown * scale, level.outward), colours


def level_of(
    points: np.ndarray,
    triangles: np.ndarray,
    shading: np.ndarray,
    colours: np.ndarray,
    source_faces: np.ndarray | None,
    error: float,
    one_sided: bool,
) -> Level:
    """A level from what its corners carry: shading (3 m, 3), colours (3 m, 4)."""
    whole = np.array([0, len(triangles)])
    positions, vertex_normals, vertex_colours, indices, _ = build_vertices(points, triangles, whole, shading, colours)
    return Level(positions, indices, vertex_normals, vertex_colours, source_faces, error, one_sided)
