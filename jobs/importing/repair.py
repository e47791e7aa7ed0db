"""Defects of one mesh are removed and counted.

Removed, in this order: faces with an index out of range, with a position that is not finite (or absurdly far), with an
alpha of 0 at all corners (readers make it so where nothing of a face is to be seen), without area, and faces whose
corners lie where another face's corners lie. Of these the first that is opaque stays, where none is the first: what
can be seen through adds nothing to an opaque face in its place, and must not take it away. Of the others, those that
wind the other way are counted on their own: exporters that double every face to show both its sides write them, and
since surfaces are drawn from both sides the second face adds nothing, unless it has another colour: then that of the
one that stays is drawn on both sides, and such faces are counted apart. What is left keeps its order; vertices that no
face uses go, and vertices that are equal in position, normal and colour become one. Vertices that opaque faces share
with faces that can be seen through are doubled before: see `two_kinds`.
"""

from __future__ import annotations

import numpy as np

from jobs.importing.keeping.saved import MeshView
from jobs.importing.reading.defects import Defect
from jobs.importing.reading.equal_rows import first_equal
from jobs.importing.reading.source_scene import SourceMesh
from jobs.importing.reading.vertex_colours import DEFAULT_COLOUR
from jobs.importing.two_kinds import OPAQUE, two_kinds

#: Positions beyond this are taken for garbage: no model needs them, and their squares stay far from overflow.
FARTHEST = 1e15

#: A face whose height is below this share of its longest edge has no area: what float64 leaves of collinear corners.
_FLAT = 1e-14

_CHUNK = 1 << 16


def repair(mesh: SourceMesh) -> tuple[MeshView | None, dict[Defect, int]]:
    """The mesh without its defects, None if nothing is left; and what was removed (without `mesh.defects`)."""
    counts: dict[Defect, int] = {}
    positions = np.ascontiguousarray(mesh.positions, np.float64) + 0.0  # -0 becomes 0
    triangles = mesh.triangles
    kept = np.arange(len(triangles))

    def drop(bad: np.ndarray, defect: Defect) -> None:
        nonlocal kept, triangles
        count = int(np.count_nonzero(bad))
        if count:
            counts[defect] = counts.get(defect, 0) + count
            kept, triangles = kept[~bad], triangles[~bad]

    drop(np.any((triangles < 0) | (triangles >= len(positions)), axis=1), Defect.INDEX)
    bad_position: np.ndarray = np.any(~(np.abs(positions) <= FARTHEST), axis=1)
    if bad_position.any():
        drop(np.any(bad_position[triangles], axis=1), Defect.NOT_FINITE)
    if mesh.colours is not None and (invisible := mesh.colours[:, 3] == 0).any():
        drop(np.all(invisible[triangles], axis=1), Defect.INVISIBLE)
    drop(_without_area(positions, triangles), Defect.NO_AREA)
    if len(triangles):
        clear = np.zeros(len(triangles), bool)
        if mesh.colours is not None and (thin := mesh.colours[:, 3] < OPAQUE).any():
            clear = thin[triangles].any(axis=1)
        corners, staying, opposite = _repeated(positions, triangles, clear)
        repeated = staying != np.arange(len(staying))
        if repeated.any():
            turned = np.flatnonzero(repeated & opposite)
            others = _differing(mesh.colours, triangles, corners, turned, staying[turned])
            counts[Defect.DUPLICATE] = int(np.count_nonzero(repeated)) - len(turned)
            counts[Defect.REVERSED], counts[Defect.OTHER_SIDE] = len(turned) - others, others
            kept, triangles = kept[~repeated], triangles[~repeated]
    if not len(triangles):
        counts[Defect.EMPTY] = 1
        return None, counts
    used = np.zeros(len(positions), bool)
    used[triangles.reshape(-1)] = True
    normals, lost = _unit_normals(mesh, used)
    if lost:
        counts[Defect.NORMAL] = lost
    colours = mesh.colours if mesh.colours is not None else np.full((len(positions), 4), DEFAULT_COLOUR, np.uint8)
    if mesh.colours is not None and (colours[:, 3] < OPAQUE).any():
        doubled, colours, triangles = two_kinds(colours, triangles)
        positions, normals = (np.concatenate([array, array[doubled]]) for array in (positions, normals))
        used = np.append(used, np.ones(len(doubled), bool))
    vertices, triangles = _compact(positions, normals, colours, used, triangles)
    counts = {defect: count for defect, count in counts.items() if count}
    return (
        MeshView(
            positions[vertices],
            normals[vertices],
            np.ascontiguousarray(colours[vertices], np.uint8),
            triangles,
            kept.astype(np.uint32),
        ),
        counts,
    )


def _without_area(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    flat = np.empty(len(triangles), bool)
    for start in range(0, len(triangles), _CHUNK):
        a, b, c = (positions[triangles[start : start + _CHUNK, corner]] for corner in range(3))
        edges = np.stack([b - a, c - b, a - c])
        longest = np.abs(edges).max(axis=(0, 2))
        edges /= np.where(longest > 0, longest, 1.0)[None, :, None]
        (x, y, z), (u, v, w) = edges[0].T, edges[1].T
        i, j, k = y * w - z * v, z * u - x * w, x * v - y * u
        squares = (edges[..., 0] ** 2 + edges[..., 1] ** 2) + edges[..., 2] ** 2
        flat[start : start + _CHUNK] = ((i * i + j * j) + k * k) <= (_FLAT * squares.max(axis=0)) ** 2
    return flat


def _repeated(
    positions: np.ndarray, triangles: np.ndarray, clear: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The places (m, 3) of the faces' corners, by the first vertex at each; of the faces between the same three places
    the one that stays (m,): the first that is opaque, or the first; and whether (m,) a face winds the other way.

    clear: (m,) bool, the faces that can be seen through.
    """
    corners = first_equal(positions)[triangles]
    a, b, c = corners.T
    turned = (a < b) ^ (b < c) ^ (c < a)
    order = np.argsort(clear, kind="stable")  # opaque faces first
    staying = np.empty(len(order), np.int64)
    staying[order] = order[first_equal(np.sort(corners[order], axis=1))]
    return corners, staying, turned != turned[staying]


def _differing(
    colours: np.ndarray | None, triangles: np.ndarray, corners: np.ndarray, some: np.ndarray, others: np.ndarray
) -> int:
    """How many of `some` faces have other colours at their corners than the `others` (k,) between the same places."""
    if colours is None:
        return 0
    shown = [
        colours[np.take_along_axis(triangles[faces], np.argsort(corners[faces], axis=1), axis=1)]
        for faces in (some, others)
    ]
    return int(np.count_nonzero((shown[0] != shown[1]).any(axis=(1, 2))))


def _unit_normals(mesh: SourceMesh, used: np.ndarray) -> tuple[np.ndarray, int]:
    """Unit normals, zeros where the file gave none or none that has a direction; and how many used ones those are."""
    if mesh.normals is None or len(mesh.normals) != len(used):
        return np.zeros((len(used), 3), np.float32), 0
    normals = np.array(mesh.normals, np.float64)
    given = (normals != 0).any(axis=1)
    bad = ~np.isfinite(normals).all(axis=1)
    normals[bad] = 0
    largest = np.abs(normals).max(axis=1, initial=0.0)
    normals /= np.where(largest > 0, largest, 1.0)[:, None]
    length = np.sqrt((normals[:, 0] ** 2 + normals[:, 1] ** 2) + normals[:, 2] ** 2)
    normals /= np.where(length > 0, length, 1.0)[:, None]
    return normals.astype(np.float32) + np.float32(0), int(np.count_nonzero(given & bad & used))


def _compact(
    positions: np.ndarray, normals: np.ndarray, colours: np.ndarray, used: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The vertices to keep, in their order, and the triangles between them."""
    rows = np.zeros((len(positions), 5), np.float64)
    rows[:, :3] = positions
    rest = rows[:, 3:].view(np.uint32)
    rest[:, :3] = normals.view(np.uint32)
    rest[:, 3] = np.ascontiguousarray(colours, np.uint8).view(np.uint32)[:, 0]
    used_rows = np.flatnonzero(used)
    first = np.zeros(len(positions), np.int64)
    first[used_rows] = used_rows[first_equal(np.ascontiguousarray(rows[used_rows]))]
    keep = used_rows[first[used_rows] == used_rows]
    number = np.zeros(len(positions), np.uint32)
    number[keep] = np.arange(len(keep), dtype=np.uint32)
    return keep, number[first[triangles]]
