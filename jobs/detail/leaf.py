"""Leaves: a piece, or the pieces of a cluster, with a chain of levels.

    gather(model, members, scale, leaf) -> Patch     the triangles of some pieces, welded, on one grid
    make_leaf(patch, scale, crease) -> Leaf          its levels, and what it offers its parent

Positions are integers on the grid, finest level included; a level's error bounds its two-sided Hausdorff distance to
the imported float64 triangles of its pieces: their largest displacement by snapping, plus the certified distance
between the snapped level and the finest snapped one. Faces that have no area once snapped are left out of the levels,
but not out of the error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from jobs.detail.bounds.displacement import snapped
from jobs.detail.collapsing.borders import same_places
from jobs.detail.levels import FEWEST, Mesh, coarser_levels
from jobs.detail.node import Finest, Locks, Node, Offer, dressed, has_gradients, level_of
from jobs.detail.pieces import ROUNDING, PieceSet
from jobs.importing.keeping.saved import turned
from jobs.importing.model import Model
from jobs.objects.flat_faces import with_area
from jobs.objects.weld import compacted, degenerate_triangles, twins, weld
from storage.meshes.normals import from_octahedral
from storage.meshes.placement import normal_matrix, placed, transform_points

#: The finest level that a leaf offers its parent, if it has so many: its own finest are for those who are near.
OFFERED = 3
#: The same where it shares vertices with other leaves: these are free to move in the parent only.
OFFERED_LOCKED = 1
#: Levels of a leaf: above that, its parent is as good. A leaf that many placements share has as many as can be.
MOST_LEVELS = 8
SHARED_LEVELS = 32
#: Lock of a vertex that no parent may move.
ALWAYS = -2


class Member(NamedTuple):
    """A piece as a leaf holds it."""

    set: PieceSet
    piece: int  # index in the set
    part: int  # the part that places it; 0 in a leaf that is shared by several
    matrix: np.ndarray | None  # (3, 4) float64, local to model space; None where the leaf lies in the piece's own space
    stretch: float  # upper bound of the factor by which the matrix lengthens
    leaf_of: Callable[[np.ndarray], np.ndarray] | None  # leaves of pieces of the set, as the part places them


class Patch(NamedTuple):
    """Surface from which a leaf is made."""

    mesh: Mesh  # welded inside each part
    shading: np.ndarray  # (3 m, 3) float32: normals of the corners
    colours: np.ndarray  # (3 m, 4) uint8: of the corners
    source_faces: np.ndarray  # (m, 2) uint32: part and face
    error: float  # what snapping moved, in grid steps
    outward: bool
    locks: Locks


class Leaf(NamedTuple):
    """A leaf's levels and its offers, finest first."""

    node: Node
    offers: list[Offer]


def gather(model: Model, members: Sequence[Member], scale: float, leaf: int) -> Patch:
    """The triangles of a leaf's members on the grid of `scale` units a step."""
    taken = [_taken(model, member) for member in members]
    points = _joined([t.points for t in taken])
    shading, colours = _joined([t.shading for t in taken]), _joined([t.colours for t in taken])
    source_faces = _joined([t.source_faces for t in taken])
    grid, displacement = snapped(points, np.full(len(points), scale))
    group = np.zeros(len(points), np.int32)
    if len(members) > 1:
        group = np.repeat(_ordinals([member.part for member in members]), [len(t.points) for t in taken])
    ids, first = weld(grid, group)
    points, triangles, kept, widened = with_area(grid[first], ids.reshape(-1, 3))
    error = max(t.error for t in taken) / scale
    if any(member.matrix is not None for member in members):
        error += float(displacement.max())
    outward = bool(all(member.set.pieces["outward"][member.piece] for member in members))
    if len(widened) or len(kept) < len(triangles):
        error += 1.0 if len(widened) else 0.0
        used, triangles = compacted(triangles[kept], len(points))
        points = points[used]
        corners = (3 * kept[:, None] + np.arange(3)).reshape(-1)
        shading, colours, source_faces = shading[corners], colours[corners], source_faces[kept]
        outward = False
    locks = [_locks(member, scale) for member in members]
    return Patch(
        Mesh(points, triangles, twins(triangles)),
        shading,
        colours,
        source_faces,
        error * (1.0 + ROUNDING),
        outward,
        Locks(*(_joined([getattr(lock, name) for lock in locks]) for name in Locks._fields)).outside(leaf, leaf),
    )


def make_leaf(patch: Patch, scale: float, crease: float, most: int) -> Leaf:
    """At most `most` levels of a patch, and its offers; crease: cosine of the sharpest angle that is smoothed."""
    mesh = patch.mesh
    finest = level_of(
        mesh.points, mesh.triangles, patch.shading, patch.colours, patch.source_faces,
        patch.error * scale, patch.outward,
    )  # fmt: skip
    levels = [finest]
    offers = [Offer(mesh.points, mesh.triangles, patch.colours, patch.error, 0.0, patch.outward, patch.locks)]
    if len(mesh.triangles) >= FEWEST:
        locked = np.flatnonzero(same_places(mesh.points, patch.locks.points)).astype(np.int32)
        chain = coarser_levels(mesh, patch.colours, patch.error, locked, patch.outward, most - 1)
        whole = Finest(
            chain.finest, mesh.points, mesh.triangles, patch.shading, patch.colours, has_gradients(patch.colours)
        )
        for coarse in chain.levels:
            level, colours = dressed(coarse, whole, crease, scale)
            levels.append(level)
            offers.append(
                Offer(
                    coarse.mesh.points,
                    coarse.mesh.triangles,
                    colours,
                    coarse.error,
                    coarse.lost,
                    coarse.outward,
                    patch.locks,
                )
            )
    first = min(OFFERED_LOCKED if len(patch.locks.points) else OFFERED, len(offers) - 1)
    return Leaf(Node(scale, tuple(levels)), offers[first:])


def place_offer(offer: Offer, scale: float, member: Member, step: float) -> Offer:
    """A shared leaf's offer, in its own space on a grid of `scale`, as the member's part places it on the model's."""
    assert member.matrix is not None
    points = placed(offer.points, scale, member.matrix, step)
    triangles, colours = offer.triangles, offer.colours
    if normal_matrix(member.matrix)[1]:
        triangles = np.ascontiguousarray(triangles[:, ::-1])
        colours = _reversed(colours)
    longer = scale * member.stretch / step
    error = offer.error * longer + np.sqrt(3.0) / 2
    if degenerate_triangles(points, triangles).any():
        ids, first = weld(points, np.zeros(len(points), np.int32))
        points, triangles, kept, widened = with_area(points[first], ids[triangles])
        error += 1.0 if len(widened) else 0.0
        colours = colours.reshape(-1, 3, 4)[kept].reshape(-1, 4)
        used, triangles = compacted(triangles[kept], len(points))
        points = points[used]
    return Offer(
        points, triangles, colours, error * (1.0 + ROUNDING), offer.lost * longer, offer.outward, _locks(member, step)
    )


class _Taken(NamedTuple):
    """A member's corners in the leaf's space."""

    points: np.ndarray  # (3 m, 3) float64
    shading: np.ndarray  # (3 m, 3) float32
    colours: np.ndarray  # (3 m, 4) uint8
    source_faces: np.ndarray  # (m, 2) uint32
    error: float  # in the leaf's units


def _taken(model: Model, member: Member) -> _Taken:
    piece = member.set.pieces[member.piece]
    first, count = int(piece["start"]), int(piece["triangles"])
    mesh = model.meshes[int(piece["mesh"])]
    face = int(mesh["triangle_start"]) + member.set.faces[first : first + count].astype(np.int64)
    vertices = (model.triangles[face].astype(np.int64) + int(mesh["vertex_start"])).reshape(-1)
    points = np.asarray(model.positions[vertices])
    colours = model.colours[vertices]
    shading = from_octahedral(member.set.shading[3 * first : 3 * (first + count)].astype(np.int32))
    source = np.stack([np.full(count, member.part, np.uint32), model.source_faces[face]], axis=1)
    error = float(piece["error"]) * float(piece["scale"])
    if member.matrix is not None:
        linear, mirrored = normal_matrix(member.matrix)
        points = transform_points(member.matrix, points)
        shading = turned(shading, linear)
        error = float(piece["left_out"]) * float(piece["scale"]) * member.stretch
        if mirrored:
            points, shading, colours = (
                a.reshape(count, 3, -1)[:, ::-1].reshape(3 * count, -1) for a in (points, shading, colours)
            )
    return _Taken(points, shading, colours, source, error)


def _reversed(corners: np.ndarray) -> np.ndarray:
    """What triangles' corners (3 m, k) carry, the other way round in each."""
    return corners.reshape(len(corners) // 3, 3, -1)[:, ::-1].reshape(len(corners), -1)


def _ordinals(parts: Sequence[int]) -> np.ndarray:
    """Parts numbered from 0: (n,) int32."""
    return np.unique(np.asarray(parts), return_inverse=True)[1].astype(np.int32)


def _locks(member: Member, scale: float) -> Locks:
    """The vertices that the member's piece shares with others, on the grid of the space that it is placed in."""
    pieces = member.set
    ids = pieces.touching[pieces.touching_start[member.piece] : pieces.touching_start[member.piece + 1]]
    points = pieces.shared_points[ids]
    if member.matrix is not None:
        points = placed(points, float(pieces.pieces["scale"][member.piece]), member.matrix, scale)
    if member.leaf_of is None or len(ids) == 0:
        return Locks(points, np.full(len(ids), ALWAYS), np.full(len(ids), ALWAYS))
    starts, ends = pieces.sharing_start[ids], pieces.sharing_start[ids + 1]
    counts = ends - starts
    begin = np.cumsum(counts) - counts
    sharing = pieces.sharing[np.repeat(starts - begin, counts) + np.arange(counts.sum())]
    leaves = member.leaf_of(sharing)
    return Locks(points, np.minimum.reduceat(leaves, begin), np.maximum.reduceat(leaves, begin))


def _joined(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Several arrays as one; a single one as it is."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)
