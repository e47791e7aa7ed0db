"""Sets of triangles that close a shaft: nothing at its one end is seen from the other.

**When a set S closes a shaft, and why.** Let no triangle of S touch V or U, let some segment from V to U cross a
triangle of S, and let each edge of S that meets the shaft be of one of two kinds:

1. *safe*: two triangles of S lie strictly on opposite sides of it as seen from all of V (see `occluders`);
2. *looked past in vain*: every segment from V to U through the edge crosses S elsewhere, at triangles that do not touch
   the edge's part in the shaft.

Then no point of U is seen from V. *Proof.* Move the segment's two ends, the one within V and the other within U, to any
two points of these; the segment stays in the shaft, which is convex. The number of triangles of S that it crosses
changes only where it passes an edge, since its ends never touch S. Past a safe edge it meets one of the two opposite
triangles (it goes on beyond the edge, or the edge would touch U); past one of the second kind it crosses S elsewhere,
before and after. So the number stays at least 1. (Passing through a vertex is avoided by moving the ends a little.)

As in `occluders`, S is of opaque triangles, and U may be part of anything.

S is flooded from a triangle that a segment surely crosses, over the edges that meet the shaft. Where an edge is not
safe, a set S' is looked for of which all edges are, and that closes the shaft from V to the edge's part in the shaft,
or the one from that part to U; the first kind alone proves that. Then all segments through the edge cross S', the edge
is of the second kind, and S' becomes part of S, with edges in the whole shaft that must be of one of the two kinds in
their turn. So two screens that overlap hide together what neither hides alone, and a wall's opening is no silhouette
behind the frame in it.

Based on: the count of what a moving segment crosses, as in `occluders`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.shafts.shafts import Shaft, apart, edge_meets, part_within, span
from jobs.visibility.surfaces.planes import side_of
from jobs.visibility.surfaces.ray_tree import STACK, SURELY, Scene, inverse, meets, next_bundle, passes_beside
from jobs.visibility.surfaces.seen_mesh import Mesh, look
from storage.base.kernels import allocating_kernel, kernel

#: Most triangles in a set that closes a shaft.
LARGEST_SET = 256
#: So many triangles that a segment crosses are tried as the first of a set beside an edge that is not safe.
EDGE_SEEDS = 4
#: For so many edges of a set that are not safe another set is looked for.
MOST_BESIDES = 8
#: So many edges that keep a shaft open are remembered while it is looked at.
OPEN_EDGES = 8
#: Marks are cleared once so many floods have been counted: they fit int32, whatever a cell adds.
MOST_EPOCHS = 1 << 30


class Work(NamedTuple):
    """What shafts are worked out in. Epochs tell what was marked for which flood; they only grow."""

    epoch: np.ndarray  # (2,) int64 of the last flood of each kind: of whole shafts, and of those of their edges
    seen: np.ndarray  # (2, m) int32 the epoch of the last flood of each kind that took a triangle in
    flood: np.ndarray  # (2, LARGEST_SET) int32
    stack: np.ndarray  # (2, STACK) int32
    inverse: np.ndarray  # (2, 3) float64
    open_edge: np.ndarray  # (OPEN_EDGES,) int32 edges of the present shaft that nothing was found beside, in turn; -1


def make_work(triangles: int) -> Work:
    """What shafts among so many triangles are worked out in, for any number of cells."""
    return Work(
        np.zeros(2, np.int64), np.zeros((2, triangles), np.int32), np.empty((2, LARGEST_SET), np.int32),
        np.empty((2, STACK), np.int32), np.empty((2, 3)), np.empty(OPEN_EDGES, np.int32),
    )  # fmt: skip


@allocating_kernel()
def forget_marks(work: Work) -> None:
    """Clear the marks where so many floods have been counted that they would not fit soon."""
    if work.epoch.max() > MOST_EPOCHS:
        work.epoch[:] = 0
        work.seen[:] = 0


@kernel(inline="always")
def _occludes(scene: Scene, mesh: Mesh, t: int, whole: bool, centre: np.ndarray, half: np.ndarray) -> int:
    """The side of triangle t on which a part of the cell lies, 0 where it may not occlude; whole: all of the cell."""
    drawable = scene.triangle_drawable[t]
    if not mesh.active[drawable] or mesh.see_through[drawable]:
        return 0
    side = look(mesh, t)
    if side == 0 and not whole:
        side = side_of(scene.vertices, scene.triangles, t, centre, half)
    if side < 0 and scene.one_sided[drawable]:
        return 0
    return side


@kernel(inline="always")
def side_in(scene: Scene, mesh: Mesh, t: int, whole: bool, view: Shaft, shaft: Shaft, beyond: bool) -> int:
    """The side of triangle t on which the shaft's V lies, 0 where it may not occlude.

    whole: whether view.v is the whole cell; beyond: whether the shaft is one from an edge on: both must be on one side.
    """
    side = _occludes(scene, mesh, t, whole, view.centre, view.half)
    if beyond and side != 0 and side_of(scene.vertices, scene.triangles, t, shaft.centre, shaft.half) != side:
        return 0
    return side


@kernel(inline="always")
def _partner(
    scene: Scene, mesh: Mesh, t: int, i: int, side: int, whole: bool, view: Shaft, shaft: Shaft, beyond: bool,
    seen: np.ndarray, epoch: int,
) -> int:  # fmt: skip
    """A triangle surely on the other side of edge i of t as seen from V, one of the set where there is one, or -1."""
    mine = side if scene.triangles[t, i] < scene.triangles[t, (i + 1) % 3] else -side
    e = mesh.triangle_edges[t, i]
    partner = -1
    for j in range(mesh.edge_start[e], mesh.edge_start[e + 1]):
        other = mesh.edge_uses[j] >> 1
        if other == t:
            continue
        its = side_in(scene, mesh, other, whole, view, shaft, beyond)
        if its != 0 and (-its if mesh.edge_uses[j] & 1 else its) == -mine:
            partner = other
            if seen[other] == epoch:
                break
    return partner


@kernel()
def _closes_alone(
    scene: Scene, mesh: Mesh, work: Work, view: Shaft, shaft: Shaft, count: int, seed: int, whole: bool,
    beyond: bool,
) -> int:  # fmt: skip
    """The size of the set (in work.flood[1]) flooded from a triangle that closes a shaft by itself; 0: it does not.

    Args: as for `side_in`; count: corners of what is looked at; seed: a triangle that a segment in the shaft crosses.
    """
    flood, seen = work.flood[1], work.seen[1]
    work.epoch[1] += 1
    epoch = work.epoch[1]
    flood[0] = seed
    seen[seed] = epoch
    size, head = 1, 0
    while head < size:
        t = flood[head]
        head += 1
        if not apart(scene.vertices, scene.triangles, t, shaft.corners, count, shaft.u):
            return 0
        side = side_in(scene, mesh, t, whole, view, shaft, beyond)
        for i in range(3):
            partner = _partner(scene, mesh, t, i, side, whole, view, shaft, beyond, seen, epoch)
            if partner >= 0 and seen[partner] == epoch:
                continue
            a, b = scene.triangles[t, i], scene.triangles[t, (i + 1) % 3]
            first, last = edge_meets(scene.vertices[a], scene.vertices[b], shaft.low, shaft.high)
            if first > last:
                continue
            if partner < 0 or size == LARGEST_SET:
                return 0
            flood[size] = partner
            seen[partner] = epoch
            size += 1
    return size


@kernel()
def _find_set(
    scene: Scene, mesh: Mesh, work: Work, view: Shaft, shaft: Shaft, count: int, whole: bool,
    beyond: bool,
) -> int:  # fmt: skip
    """The size of a set (in work.flood[1]) that closes a shaft by itself, 0 where none is found: see `_closes_alone`.

    Triangles are tried that the segment from shaft.o along shaft.d crosses.
    """
    reach = 0.0
    for k in range(3):
        reach = max(reach, abs(shaft.u[0, k] - shaft.o[k]), abs(shaft.u[1, k] - shaft.o[k]))
    inverse(shaft.d, work.inverse[1])
    stack = work.stack[1]
    stack[0] = 0
    waiting, begin, seeds = 1, work.epoch[1], 0
    while True:
        c, waiting = next_bundle(scene, shaft.o, work.inverse[1], 1.0, stack, waiting)
        if c < 0:
            return 0
        beside = passes_beside(scene.corners, c, shaft.o, shaft.d, reach)
        for t in range(scene.bundle_start[c], scene.bundle_start[c + 1]):
            if (
                not beside >> (t - scene.bundle_start[c]) & 1
                and work.seen[1, t] <= begin
                and abs(meets(scene.vertices, scene.triangles, t, shaft.o, shaft.d, reach)) == SURELY
                and side_in(scene, mesh, t, whole, view, shaft, beyond) != 0
            ):
                size = _closes_alone(scene, mesh, work, view, shaft, count, t, whole, beyond)
                if size:
                    return size
                seeds += 1
                if seeds == EDGE_SEEDS:
                    return 0


@kernel()
def _set_beside(
    scene: Scene, mesh: Mesh, work: Work, shaft: Shaft, count: int, small: Shaft, a: int,
    b: int, first: float, last: float, whole: bool,
) -> int:  # fmt: skip
    """The size of a set (in work.flood[1]) that all segments through an edge in a shaft cross besides; 0: none found.

    Args:
        count: corners of what is looked at.
        small: receives the shaft from V to the edge's part in the shaft, or from there to U.
        a, b: the vertices of the edge; first, last: see `edge_meets`.
    """
    t0, t1 = part_within(scene.vertices[a], scene.vertices[b], shaft.low, shaft.high, first, last)
    for k in range(3):
        x, y = float(scene.vertices[a, k]), float(scene.vertices[b, k])
        small.corners[0, k], small.corners[1, k] = x + t0 * (y - x), x + t1 * (y - x)
        small.v[0, k], small.v[1, k] = shaft.v[0, k], shaft.v[1, k]
        small.o[k] = shaft.o[k]
        small.d[k] = 0.5 * (small.corners[0, k] + small.corners[1, k]) - shaft.o[k]
    span(small, 2)
    size = _find_set(scene, mesh, work, shaft, small, 2, whole, False)
    if size:
        return size
    for k in range(3):
        x, y = small.corners[0, k], small.corners[1, k]
        small.v[0, k], small.v[1, k] = min(x, y), max(x, y)
        small.o[k] = 0.5 * (x + y)
    for k in range(3):
        small.d[k] = shaft.o[k] + shaft.d[k] - small.o[k]
        for c in range(count):
            small.corners[c, k] = shaft.corners[c, k]
    span(small, count)
    return _find_set(scene, mesh, work, shaft, small, count, whole, True)


@kernel()
def stays_open(
    scene: Scene, mesh: Mesh, work: Work, shaft: Shaft, count: int, small: Shaft, seed: int,
    whole: bool,
) -> float:  # fmt: skip
    """Where a shaft stays open (a, from 0 at U to 1 at V) when a set is flooded from a triangle; -1: the set closes it.

    Args:
        count: corners of what is looked at.
        small: scratch.
        seed: a triangle that the segment in the shaft crosses.
        whole: whether V is the whole cell.
    """
    flood, seen = work.flood[0], work.seen[0]
    work.epoch[0] += 1
    epoch = work.epoch[0]
    flood[0] = seed
    seen[seed] = epoch
    size, head, besides = 1, 0, 0
    while head < size:
        t = flood[head]
        head += 1
        if not apart(scene.vertices, scene.triangles, t, shaft.corners, count, shaft.u):
            return 0.0
        side = side_in(scene, mesh, t, whole, shaft, shaft, False)
        for i in range(3):
            partner = _partner(scene, mesh, t, i, side, whole, shaft, shaft, False, seen, epoch)
            if partner >= 0 and seen[partner] == epoch:
                continue
            a, b = scene.triangles[t, i], scene.triangles[t, (i + 1) % 3]
            first, last = edge_meets(scene.vertices[a], scene.vertices[b], shaft.low, shaft.high)
            if first > last:
                continue
            added = 1
            if partner >= 0:
                work.flood[1, 0] = partner
            elif besides == MOST_BESIDES:
                return 0.5 * (first + last)
            else:
                e = mesh.triangle_edges[t, i]
                known = False
                for k in range(OPEN_EDGES):
                    known |= work.open_edge[k] == e
                if known:
                    return 0.5 * (first + last)
                besides += 1
                added = _set_beside(scene, mesh, work, shaft, count, small, a, b, first, last, whole)
                if not added:
                    work.open_edge[e % OPEN_EDGES] = e
                    return 0.5 * (first + last)
            for k in range(added):
                other = work.flood[1, k]
                if seen[other] != epoch:
                    if size == LARGEST_SET:
                        return 0.5 * (first + last)
                    flood[size] = other
                    seen[other] = epoch
                    size += 1
    return -1.0
