"""The triangles of a soup as one cell sees them: worked out where they are first looked at, and nowhere else.

A cell sees few of a model's triangles, so what it costs must not grow with the model. `look` works out a triangle's
side and its corners in cell coordinates; `begin` forgets what another cell looked at.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.surfaces.planes import side_of
from storage.base.kernels import kernel

#: What a triangle's side is besides +1 (the whole cell lies before its plane, so it sees the front only), -1 (behind
#: it) and 0 (the plane meets the cell, or passes too near to tell; triangles that are not in the cut). TURNED: behind
#: it, and the triangle is one-sided, so that nobody in the cell sees it. UNKNOWN: nobody has looked yet. CLEAR: before
#: or behind it, but the triangle can be seen through and hides nothing: its sides are no matter, and no edge of it is
#: safe.
TURNED, UNKNOWN, CLEAR = -2, 2, 3


class Mesh(NamedTuple):
    """A soup's triangles and edges, a cell, and what is known of the triangles in this cell."""

    vertices: np.ndarray  # (n, 3) int32 grid coordinates (exact in float64, as are the normals' products)
    triangles: np.ndarray  # (m, 3) int32
    triangle_edges: np.ndarray  # (m, 3) int32, see topology.edges
    edge_start: np.ndarray  # (e + 1,) int32
    edge_uses: np.ndarray  # (3 m,) int32
    triangle_drawable: np.ndarray  # (m,) int32
    one_sided: np.ndarray  # (drawables,) bool
    see_through: np.ndarray  # (drawables,) bool: they hide nothing
    active: np.ndarray  # (drawables,) bool what is in the cell's cut
    centre: np.ndarray  # (3,) float64 the cell's middle, in grid units
    half: np.ndarray  # (3,) float64 half its extents
    q: (
        np.ndarray
    )  # (n or more, 3) float64 vertices in cell coordinates: those of triangles of the cut that were looked at
    side: np.ndarray  # (m,) int8: -2 ... 3, see above
    looked: np.ndarray  # (m,) int32 the triangles that were looked at
    looked_count: np.ndarray  # (1,) int64 how many


def make_mesh(
    vertices: np.ndarray,
    triangles: np.ndarray,
    triangle_edges: np.ndarray,
    edge_start: np.ndarray,
    edge_uses: np.ndarray,
    triangle_drawable: np.ndarray,
    one_sided: np.ndarray,
    see_through: np.ndarray,
    more_rows: int = 0,
) -> Mesh:
    """A mesh for any number of cells, one after the other; `q` gets some rows more than there are vertices."""
    m = len(triangles)
    return Mesh(
        vertices, triangles, triangle_edges, edge_start, edge_uses, triangle_drawable, one_sided, see_through,
        np.zeros(len(one_sided), np.bool_), np.zeros(3), np.ones(3), np.zeros((len(vertices) + more_rows, 3)),
        np.full(m, UNKNOWN, np.int8), np.empty(m, np.int32), np.zeros(1, np.int64),
    )  # fmt: skip


@kernel()
def begin(mesh: Mesh, places: np.ndarray, centre: np.ndarray, half: np.ndarray) -> None:
    """Begin a cell: places (c,) int64 the drawables of its cut; centre, half: (3,) float64 in grid units."""
    for k in range(3):
        mesh.centre[k], mesh.half[k] = centre[k], half[k]
    for d in range(mesh.active.shape[0]):
        mesh.active[d] = False
    for d in places:
        mesh.active[d] = True
    for at in range(mesh.looked_count[0]):
        mesh.side[mesh.looked[at]] = UNKNOWN
    mesh.looked_count[0] = 0


@kernel(inline="always")
def look(mesh: Mesh, t: int) -> int:
    """Triangle t's side; from now on its corners are in q, if it is in the cut."""
    side = mesh.side[t]
    if side == UNKNOWN:
        side = _look_first(mesh, t)
    return side


@kernel(inline="always")
def may_occlude(mesh: Mesh, t: int) -> bool:
    """Whether all of the cell lies on one side of triangle t, from which it is seen and cannot be seen through."""
    return abs(look(mesh, t)) == 1


@kernel()
def look_at_all(mesh: Mesh) -> None:
    """Look at each triangle."""
    for t in range(mesh.triangles.shape[0]):
        look(mesh, t)


@kernel()
def _look_first(mesh: Mesh, t: int) -> int:
    """Work triangle t out: its side."""
    side = 0
    drawable = mesh.triangle_drawable[t]
    if mesh.active[drawable]:
        side = side_of(mesh.vertices, mesh.triangles, t, mesh.centre, mesh.half)
        if side < 0 and mesh.one_sided[drawable]:
            side = TURNED
        elif side != 0 and mesh.see_through[drawable]:
            side = CLEAR
        for i in range(3):
            v = mesh.triangles[t, i]
            for k in range(3):
                mesh.q[v, k] = (mesh.vertices[v, k] - mesh.centre[k]) / mesh.half[k]
    mesh.side[t] = side
    mesh.looked[mesh.looked_count[0]] = t
    mesh.looked_count[0] += 1
    return side
