"""The triangles of many drawables as one set of arrays: what a task's cells share.

Built once per task from the drawables that any of its cells may use; a cell then switches drawables on and off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jobs.objects.weld import degenerate_triangles
from jobs.visibility.surfaces import topology
from jobs.visibility.surfaces.gaps import find_gaps


@dataclass(frozen=True)
class Gaps:
    """Narrow gaps of a soup: see `gaps.find_gaps`."""

    distance: float  # that they are no wider than, in grid units
    start: np.ndarray  # (e + 1,) int64
    near: np.ndarray  # (g,) int32
    part: np.ndarray  # (g, 2) float32


@dataclass(frozen=True)
class Soup:
    """Triangles of drawables on welded vertices; a drawable's triangles and a cluster's are contiguous.

    Coordinates are in grid units. `drawables` are the store's ids, sorted; everything else counts them from 0.
    """

    drawables: np.ndarray  # (d,) int64 sorted ids
    one_sided: np.ndarray  # (d,) bool
    see_through: np.ndarray  # (d,) bool: they hide nothing
    drawable_lo: np.ndarray  # (d, 3) float64 boxes of the meshes; lo > hi where a drawable has no triangles
    drawable_hi: np.ndarray  # (d, 3)
    drawable_clusters: np.ndarray  # (d + 1,) int32 offsets into the clusters
    triangle_counts: np.ndarray  # (d,) int64 triangles as stored
    vertices: np.ndarray  # (n, 3) int32
    triangles: np.ndarray  # (m, 3) int32
    triangle_drawable: np.ndarray  # (m,) int32
    triangle_edges: np.ndarray  # (m, 3) int32
    edge_start: np.ndarray  # (e + 1,) int32
    edge_uses: np.ndarray  # (3 m,) int32
    cluster_start: np.ndarray  # (k + 1,) int32
    cluster_drawable: np.ndarray  # (k,) int32
    cluster_lo: np.ndarray  # (k, 3) float64
    cluster_hi: np.ndarray  # (k, 3) float64
    # (k,) float64 how broad an image the sheet that the cluster belongs to can have; 0 where it can be seen through
    cluster_breadth: np.ndarray
    gaps: Gaps | None = None  # that count as closed; None: there are none

    def places(self, ids: np.ndarray) -> np.ndarray:
        """Positions in `drawables` of the given ids, all of which must be there."""
        places = np.searchsorted(self.drawables, ids)
        if len(ids) and (places.max() >= len(self.drawables) or (self.drawables[places] != ids).any()):
            raise ValueError("the soup does not hold all the drawables asked for")
        return places


def build_soup(
    drawables: Sequence[int] | np.ndarray,
    one_sided: np.ndarray,
    see_through: np.ndarray,
    points: np.ndarray,
    corners: np.ndarray,
    counts: np.ndarray,
    cluster_size: int = 32,
    seal: float = 0.0,
) -> Soup:
    """Weld the drawables' triangles by position, find their edges and cut them into clusters.

    Args:
        drawables: (d,) sorted ids.
        one_sided: (d,) bool.
        see_through: (d,) bool which of them can be seen through.
        points: (n, 3) int32 positions in grid units; corners: (m, 3) triangles into them, one drawable after the other.
        counts: (d,) int64 triangles of each drawable.
        cluster_size: most triangles in a cluster.
        seal: gaps no wider than this, in grid units, count as closed; 0: none.

    Triangles without area (after snapping to the grid) cannot be seen and hide nothing; they are left out.
    """
    ids = np.asarray(drawables, np.int64)
    owner = np.repeat(np.arange(len(ids), dtype=np.int32), counts)
    with np.errstate(over="ignore"):  # hashes wrap around, which numpy tells of where kernels are not compiled
        index, first = topology.weld(np.ascontiguousarray(points, np.int32))
    vertices = points[first].astype(np.int32)
    welded = index[corners].astype(np.int32).reshape(-1, 3)
    keep = ~degenerate_triangles(vertices, welded)
    welded, owner = welded[keep], owner[keep]

    with np.errstate(over="ignore"):
        triangle_edges, edge_vertices, start, uses = topology.edges(welded)
    order, offsets = topology.clusters(triangle_edges, start, uses, owner, cluster_size)
    welded, owner = welded[order], owner[order]
    triangle_edges = triangle_edges[order]
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order), dtype=np.int32)
    uses = place[uses >> 1] * 2 + (uses & 1)

    k = len(offsets) - 1
    cluster_drawable = owner[offsets[:-1]] if k else np.zeros(0, np.int32)
    cluster_lo, cluster_hi = (box.astype(np.float64) for box in topology.boxes(vertices, welded, offsets))
    cluster_breadth = np.zeros(k)
    if k:
        sheet = topology.sheets(triangle_edges, start, uses.astype(np.int32), np.asarray(see_through, np.bool_)[owner])
        each = topology.boxes(vertices, welded, np.arange(len(welded) + 1, dtype=np.int32))
        cluster_breadth = _breadths(sheet, *each)[offsets[:-1]]
        cluster_breadth[np.asarray(see_through, np.bool_)[cluster_drawable]] = 0.0
    gaps = None
    if seal > 0:
        found = find_gaps(
            vertices, welded, edge_vertices, start, uses.astype(np.int32), offsets, cluster_lo, cluster_hi, seal
        )
        gaps = Gaps(seal, *found) if len(found[1]) else None
    drawable_clusters = np.searchsorted(cluster_drawable, np.arange(len(ids) + 1)).astype(np.int32)
    drawable_lo = np.full((len(ids), 3), 1.0)
    drawable_hi = np.full((len(ids), 3), -1.0)
    full = np.flatnonzero(np.diff(drawable_clusters))
    if len(full):
        drawable_lo[full] = np.minimum.reduceat(cluster_lo, drawable_clusters[full], axis=0)
        drawable_hi[full] = np.maximum.reduceat(cluster_hi, drawable_clusters[full], axis=0)
    return Soup(
        drawables=ids,
        # Columns of a table are strided, but not those of a table of one row: kernels would be compiled for both.
        one_sided=np.ascontiguousarray(one_sided, np.bool_),
        see_through=np.ascontiguousarray(see_through, np.bool_),
        drawable_lo=drawable_lo,
        drawable_hi=drawable_hi,
        drawable_clusters=drawable_clusters,
        triangle_counts=counts,
        vertices=vertices,
        triangles=np.ascontiguousarray(welded),
        triangle_drawable=owner,
        triangle_edges=np.ascontiguousarray(triangle_edges),
        edge_start=start,
        edge_uses=uses.astype(np.int32),
        cluster_start=offsets,
        cluster_drawable=cluster_drawable,
        cluster_lo=cluster_lo,
        cluster_hi=cluster_hi,
        cluster_breadth=cluster_breadth,
        gaps=gaps,
    )


def _breadths(sheet: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(m,) float64: for each triangle, the diagonal of the two lesser extents of its whole sheet's box.

    Seen from anywhere, a sheet's image is at most about this broad in its narrowest direction.
    """
    order = np.argsort(sheet, kind="stable")
    begins = np.flatnonzero(np.diff(sheet[order], prepend=-1))
    lo = np.minimum.reduceat(low[order], begins, axis=0).astype(np.float64)
    hi = np.maximum.reduceat(high[order], begins, axis=0).astype(np.float64)
    extent = np.sort(hi - lo, axis=1)
    breadth: np.ndarray = np.hypot(extent[:, 0], extent[:, 1])[sheet]
    return breadth
