"""The pieces of a batch of meshes: snapped to the grid, welded, parted into components, large ones split."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jobs.objects.components import components, grouped, outward_closed
from jobs.objects.flat_faces import with_area
from jobs.objects.object_options import Limits
from jobs.objects.partition import boxes, partition
from jobs.objects.weld import twins, weld


@dataclass(frozen=True)
class GridPieces:
    """The pieces of a batch of meshes. Triangles lie piece by piece, mesh after mesh.

    Triangles that are not drawn for want of area (see `flat_faces`) are kept apart: they are part of the surface that
    the levels must stay near.
    """

    points: np.ndarray  # (w, 3) int32: grid coordinates of the welded vertices
    triangles: np.ndarray  # (m, 3) int32: welded vertices
    source: np.ndarray  # (m,) int64: the batch's triangle
    twin: np.ndarray  # (3 m,) int32: the other half-edge in the whole mesh, see jobs.objects.weld
    start: np.ndarray  # (pieces + 1,) int64: first triangle of each piece
    mesh: np.ndarray  # (pieces,) int32: the mesh each piece belongs to
    lo: np.ndarray  # (pieces, 3) float64: box, in grid steps
    hi: np.ndarray  # (pieces, 3) float64
    outward: np.ndarray  # (pieces,) bool: all its components are closed and their shells are wound outward
    shared: np.ndarray  # (s,) int32, increasing: welded vertices that lie in more than one piece
    sharing_start: np.ndarray  # (s + 1,) int64 into sharing
    sharing: np.ndarray  # (n,) int32: the pieces that each shared vertex lies in, increasing
    flat_source: np.ndarray  # (f,) int64: the batch's triangles that are not drawn
    flat_component: np.ndarray  # (f,) int32: and their components
    component: np.ndarray  # (m,) int32: component of each triangle


def find_pieces(
    grid_points: np.ndarray, mesh: np.ndarray, triangles: np.ndarray, meshes: int, limits: Limits, size: np.ndarray
) -> GridPieces:
    """Part triangles (m, 3) int64 over vertices at grid_points (n, 3) int32 of meshes mesh (n,) int32 into pieces.

    size (meshes,): see `partition`. Those of different meshes are never welded. A mesh without triangles has no piece.
    """
    welded, first = weld(grid_points, mesh)
    label, count = components(welded[triangles], len(first))
    points, corners, kept, _ = with_area(grid_points[first], welded[triangles])

    by_component, component_start = grouped(label[kept], count)
    of_components = np.ascontiguousarray(corners[kept[by_component]])
    outward = outward_closed(points, of_components, twins(of_components), component_start)

    of_mesh = mesh[triangles[kept, 0]]
    order, start = partition(points, corners[kept], label[kept], of_mesh, meshes, limits, size)
    source = kept[order]
    own = np.ascontiguousarray(corners[source])
    component = label[source]
    piece = np.repeat(np.arange(len(start) - 1, dtype=np.int32), np.diff(start))
    closed = np.ones(len(start) - 1, np.bool_)
    np.logical_and.at(closed, piece, outward[component])
    lo, hi = boxes(points, own, start)
    shared, sharing_start, sharing = _shared_vertices(own, piece)

    flat_source = np.delete(np.arange(len(triangles)), kept)
    return GridPieces(
        points=points,
        triangles=own,
        source=source,
        twin=twins(own),
        start=start,
        mesh=of_mesh[order[start[:-1]]],
        lo=lo,
        hi=hi,
        outward=closed,
        shared=shared,
        sharing_start=sharing_start,
        sharing=sharing,
        flat_source=flat_source,
        flat_component=label[flat_source],
        component=component,
    )


def _shared_vertices(triangles: np.ndarray, piece: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices that lie in several pieces, where the list of each one's pieces begins, and these lists."""
    pairs = np.unique(triangles.astype(np.int64) * (int(piece.max(initial=0)) + 1) + piece[:, None])
    vertex, owner = np.divmod(pairs, int(piece.max(initial=0)) + 1)
    begin = np.flatnonzero(np.append(True, np.diff(vertex) > 0)) if len(vertex) else np.zeros(0, np.int64)
    counts = np.diff(np.append(begin, len(vertex)))
    several = counts > 1
    lists = np.repeat(several, counts)
    starts = np.concatenate([[0], np.cumsum(counts[several])]).astype(np.int64)
    return vertex[begin[several]].astype(np.int32), starts, owner[lists].astype(np.int32)
