"""Polygons become triangles that cover what their outlines enclose, no more and no less.

Most polygons are convex, or can at least be fanned out from their first corner: that is tested for all of them at once,
and those stay fans. Quads that cannot are split along their other diagonal. What is left, and what has holes, is cut by
ears in the plane of its Newell normal: flat outlines are covered exactly, warped ones as they look along that normal,
those that touch themselves keep their area. An outline that crosses itself encloses nothing that is certain: it is cut
as well as it can be, and counted.

Based on: mapbox/earcut.hpp, after Held: FIST: Fast Industrial-Strength Triangulation of Polygons, Algorithmica 30
(2001), and Eberly: Triangulation by Ear Clipping (2002).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import mapbox_earcut
import numpy as np

from jobs.importing.reading.faces.corners import fan
from jobs.importing.reading.faces.turning import DIAGONAL, EARS, SEAM, how_to_cut

#: An outline of size one whose corners' shares of its area sum up to less than this for each of them has no area.
_NO_AREA = 1e-15

#: Triangles that differ from their outline's area by more than this share of it show that the outline crosses itself.
_CROSSING = 1e-6

#: Edges of an outline that are tried for crossings, each against each; of more only the area is compared.
_MOST_EDGES = 1 << 10


class Triangles(NamedTuple):
    """What polygons become, in their order."""

    corners: np.ndarray  # (m, 3) int64 corner numbers, wound as the outlines are
    counts: np.ndarray  # (f,) int64 triangles of each polygon
    crossing: int  # outlines that cross themselves


def triangulate(
    positions: np.ndarray,
    corners: np.ndarray,
    counts: np.ndarray,
    holes: Mapping[int, int] = MappingProxyType({}),
    *,
    fans: bool = False,
) -> Triangles:
    """Triangles of polygons of `counts` (f,) corners, whose corners lie one after another.

    `corners` (c,) index `positions` (n, 3) float64. So many of the polygons that follow one are `holes` in it, by its
    number; they give no triangles of their own. Polygons of fewer than three corners give no triangle; those with an
    index out of range or a position that is not finite stay fans, for the repair to remove. `fans`: they are fans by
    what the format says, whatever their outlines.
    """
    counts = np.asarray(counts, np.int64)
    triangles, each = fan(counts), np.maximum(counts - 2, 0)
    largest = int(counts.max(initial=0))
    if fans or not len(positions) or not (largest >= 4 or holes):
        return Triangles(triangles, each, 0)
    how, crosses = np.empty(len(counts), np.uint8), np.empty(len(counts), np.bool_)
    how_to_cut(positions, corners, counts, how, crosses, np.empty((max(largest, 3), 3)))
    if not how.any() and not crosses.any() and not holes:
        return Triangles(triangles, each, 0)
    firsts = np.cumsum(each) - each
    starts = np.cumsum(counts) - counts
    pieces: dict[int, np.ndarray] = {}
    rings = {face: 1 + number for face, number in holes.items() if number}
    for face, number in rings.items():
        pieces.update({hole: np.empty((0, 3), np.int64) for hole in range(face + 1, face + number)})
    quads = np.flatnonzero(how == DIAGONAL)
    triangles[firsts[quads]] = starts[quads, None] + np.array([1, 2, 3])
    triangles[firsts[quads] + 1] = starts[quads, None] + np.array([1, 3, 0])
    crosses[list(pieces | rings)] = False
    crossing = int(np.count_nonzero(crosses))
    for face in sorted({*np.flatnonzero(how == EARS).tolist(), *rings} - pieces.keys()):
        sizes = counts[face : face + rings.get(face, 1)].tolist()
        start = int(starts[face])
        index = corners[start : start + sum(sizes)]
        if ((index < 0) | (index >= len(positions))).any() or not np.isfinite(positions[index]).all():
            continue
        cut, whole = cut_outlines(positions[index], sizes)
        crossing += not whole
        if len(cut):
            pieces[face] = cut + start
    return Triangles(*_replaced(triangles, each, firsts, pieces), crossing)


def cut_outlines(points: np.ndarray, sizes: Sequence[int]) -> tuple[np.ndarray, bool]:
    """Triangles (m, 3) int64 of one polygon, wound as its outline is; and whether they cover just what is enclosed.

    `points` (c, 3) float64 are the outline's corners, then those of each hole; `sizes` counts them. A polygon without
    area gives no triangle.
    """
    flat = _projected(points, sizes[0])
    if flat is None:
        return np.empty((0, 3), np.int64), False
    cut = mapbox_earcut.triangulate_float64(flat, np.cumsum(sizes).astype(np.uint32)).astype(np.int64).reshape(-1, 3)
    areas = _areas(flat, cut)
    cut[areas < 0] = cut[areas < 0, ::-1]
    ends = np.cumsum(sizes).tolist()
    rings = [abs(_ring_area(flat[end - size : end])) for end, size in zip(ends, sizes, strict=True)]
    enclosed = rings[0] - sum(rings[1:])
    same_area = abs(float(np.abs(areas).sum()) - enclosed) <= _CROSSING * rings[0]
    return cut, same_area and not _edges_cross(flat, sizes)


def _replaced(
    triangles: np.ndarray, each: np.ndarray, firsts: np.ndarray, pieces: dict[int, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """All triangles, and how many each polygon has, where some polygons have others than their fans."""
    if not pieces:
        return triangles, each
    counts = each.copy()
    for face, piece in pieces.items():
        counts[face] = len(piece)
    found = np.empty((int(counts.sum()), 3), np.int64)
    at = np.cumsum(counts) - counts
    kept = np.ones(len(each), bool)
    kept[list(pieces)] = False
    sizes = each[kept]
    steps = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    found[np.repeat(at[kept], sizes) + steps] = triangles[np.repeat(firsts[kept], sizes) + steps]
    for face, piece in pieces.items():
        found[at[face] : at[face] + len(piece)] = piece
    return found, counts


def _projected(points: np.ndarray, size: int) -> np.ndarray | None:
    """Points (c, 2) along the normal of the first `size` of them, which wind counterclockwise; None without a normal.

    The plane is that of the two axes that the normal faces least: what lies flat in it keeps its coordinates' bits.
    """
    if not np.isfinite(points).all():
        return None
    local = points - points[0]
    reach = float(np.abs(local).max())
    if not 0 < reach < np.inf:
        return None
    local = local / 2.0 ** int(np.frexp(reach)[1])  # a power of two: no bit is lost, no square overflows
    ring, following = local[:size], np.roll(local[:size], -1, axis=0)
    normal = np.array(
        [
            float(((ring[:, i] - following[:, i]) * (ring[:, j] + following[:, j])).sum())
            for i, j in ((1, 2), (2, 0), (0, 1))
        ]
    )
    axis = int(np.abs(normal).argmax())
    if not abs(normal[axis]) > _NO_AREA * size:
        return None
    i, j = ((axis + 1) % 3, (axis + 2) % 3) if normal[axis] > 0 else ((axis + 2) % 3, (axis + 1) % 3)
    slopes = normal / normal[axis]
    return np.stack([local[:, k] - local[:, axis] * slopes[k] for k in (i, j)], axis=1)


def _areas(flat: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the area (m,) of triangles between points (c, 2), negative where they wind clockwise."""
    a, b, c = (flat[triangles[:, corner]] for corner in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def _ring_area(ring: np.ndarray) -> float:
    """Twice the area within a closed line (c, 2)."""
    following = np.roll(ring, -1, axis=0)
    return float((ring[:, 0] * following[:, 1] - ring[:, 1] * following[:, 0]).sum())


def _edges_cross(flat: np.ndarray, sizes: Sequence[int]) -> bool:
    """Whether two edges of closed lines, which lie one after another in `flat` (c, 2), cross within both."""
    if len(flat) > _MOST_EDGES:
        return False
    following = np.arange(1, len(flat) + 1)
    ends = np.cumsum(sizes)
    following[ends - 1] = ends - np.asarray(sizes)
    along = flat[following] - flat
    before = flat[None, :] - flat[:, None]  # from the start of the edge of the row to that of the column
    start = along[:, None, 0] * before[..., 1] - along[:, None, 1] * before[..., 0]
    end = start[:, following]
    apart = (start > SEAM) & (end < -SEAM) | (start < -SEAM) & (end > SEAM)
    return bool((apart & apart.T).any())
