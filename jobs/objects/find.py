"""The objects of a batch of meshes: snapped to the grid, welded, parted into components, large components split."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jobs.objects.components import components, grouped, outward_closed
from jobs.objects.split import median_split
from jobs.objects.weld import degenerate_triangles, twins, weld


@dataclass(frozen=True)
class Objects:
    """The pieces of a batch of meshes. Triangles lie piece by piece, in the order of the meshes inside each.

    Triangles without area on the grid are kept apart: they are part of the surface that the levels must stay near, but
    are not drawn. Objects all of whose triangles are such have no piece: they are thinner than a grid step.
    """

    welded: np.ndarray  # (n,) int32: the welded vertex of each vertex of the batch
    points: np.ndarray  # (w, 3) int32: grid coordinates of the welded vertices
    triangles: np.ndarray  # (m, 3) int32: welded vertices
    source: np.ndarray  # (m,) int64: the batch's triangle
    twin: np.ndarray  # (3 m,) int32: the other half-edge inside the piece, see jobs.objects.weld
    whole_twin: np.ndarray  # (3 m,) int32: the other half-edge inside the component, in whatever piece
    start: np.ndarray  # (pieces + 1,) int64: first triangle of each piece
    component: np.ndarray  # (pieces,) int64: the component each piece belongs to
    outward: np.ndarray  # (pieces,) bool: its whole component is closed and its shells are wound outward
    cut: np.ndarray  # (w,) bool: the vertex lies on the border between two pieces of one component
    split: np.ndarray  # (pieces,) bool: the piece is one of several of its component
    flat_source: np.ndarray  # (f,) int64: the batch's triangles without area, of components that have pieces
    flat_component: np.ndarray  # (f,) int64: and their components


def find_objects(grid_points: np.ndarray, mesh: np.ndarray, triangles: np.ndarray, limit: int) -> Objects:
    """Part triangles (m, 3) int64 over vertices at grid_points (n, 3) int32 of meshes mesh (n,) int32 into pieces.

    Components of more than `limit` triangles are split. Vertices of different meshes are never welded.
    """
    welded, first = weld(grid_points, mesh)
    points = grid_points[first]
    corners = welded[triangles]
    label, count = components(corners, len(points))
    flat = degenerate_triangles(points, corners)

    kept = np.flatnonzero(~flat)
    order, start = grouped(label[kept], count)
    order = kept[order]
    kept_corners = corners[order]
    twin = twins(kept_corners)
    outward = outward_closed(points, kept_corners, twin, start)
    sizes = np.diff(start)

    cut = np.zeros(len(points), np.bool_)
    large = np.flatnonzero(sizes > limit)
    if len(large):
        pieces_order: list[np.ndarray] = []
        piece_sizes: list[int] = []
        piece_component: list[int] = []
        done = 0
        for c in large:
            between = np.flatnonzero(sizes[done:c] > 0) + done
            pieces_order.append(order[start[done] : start[c]])
            piece_sizes.extend(sizes[between].tolist())
            piece_component.extend(between.tolist())
            own = order[start[c] : start[c + 1]]
            parts = median_split(points[corners[own]].astype(np.int64).sum(axis=1), limit)
            cut |= _on_borders(corners[own], parts, len(points))
            pieces_order.extend(own[p] for p in parts)
            piece_sizes.extend(len(p) for p in parts)
            piece_component.extend([int(c)] * len(parts))
            done = int(c) + 1
        between = np.flatnonzero(sizes[done:] > 0) + done
        pieces_order.append(order[start[done] :])
        piece_sizes.extend(sizes[between].tolist())
        piece_component.extend(between.tolist())
        order = np.concatenate(pieces_order)
        component = np.array(piece_component, np.int64)
        start = np.concatenate([[0], np.cumsum(piece_sizes)]).astype(np.int64)
        kept_corners = np.ascontiguousarray(corners[order])
        whole_twin = twins(kept_corners)
        twin = _twins_inside(kept_corners, start)
    else:
        whole_twin = twin
        component = np.flatnonzero(sizes > 0).astype(np.int64)
        start = np.concatenate([[0], np.cumsum(sizes[component])]).astype(np.int64)

    pieces_of = np.bincount(component, minlength=count)
    flat_source = np.flatnonzero(flat)
    flat_source = flat_source[pieces_of[label[flat_source]] > 0]
    return Objects(
        welded=welded,
        points=points,
        triangles=kept_corners,
        source=order,
        twin=twin,
        whole_twin=whole_twin,
        start=start,
        component=component,
        outward=outward[component],
        cut=cut,
        split=pieces_of[component] > 1,
        flat_source=flat_source,
        flat_component=label[flat_source].astype(np.int64),
    )


def _on_borders(corners: np.ndarray, parts: list[np.ndarray], vertices: int) -> np.ndarray:
    """Which of `vertices` welded vertices occur in more than one of the parts of triangles `corners`: bool."""
    seen = np.zeros(vertices, np.bool_)
    border = np.zeros(vertices, np.bool_)
    for part in parts:
        own = np.unique(corners[part])
        border[own[seen[own]]] = True
        seen[own] = True
    return border


def _twins_inside(triangles: np.ndarray, start: np.ndarray) -> np.ndarray:
    """`twins` with every piece taken by itself: vertices are renumbered so that no two pieces share one."""
    piece = np.repeat(np.arange(len(start) - 1), np.diff(start))
    key = np.repeat(piece, 3) * (int(triangles.max()) + 1) + triangles.reshape(-1)
    _, local = np.unique(key, return_inverse=True)
    return twins(local.reshape(-1, 3).astype(np.int32))
