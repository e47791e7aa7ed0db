"""What images leave undecided: shafts between parts of the cell and parts of a drawable, split until they are decided.

A *shaft* is the convex hull of a part of the cell (a box V) and of a part of a drawable (a box U that holds it). Either
a ray through it proves that the drawable is seen, or a set of triangles is found that closes the shaft, or V or U is
cut in two and both halves are looked at, as long as there is time. There are no pixels here: neither a pixel's width
nor the depths within it blur what is hidden, and parts of the cell may be hidden from by different occluders.

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

S is flooded from a triangle that a segment surely crosses, over the edges that meet the shaft. Where an edge is not
safe, a set S' is looked for of which all edges are, and that closes the shaft from V to the edge's part in the shaft,
or the one from that part to U; the first kind alone proves that. Then all segments through the edge cross S', the edge
is of the second kind, and S' becomes part of S, with edges in the whole shaft that must be of one of the two kinds in
their turn. So two screens that overlap hide together what neither hides alone, and a wall's opening is no silhouette
behind the frame in it.

**An edge and a shaft.** The hull of two boxes is the union of the boxes a V + (1 - a) U over 0 <= a <= 1. So a point
A + t (B - A) of an edge lies in it if and only if six inequalities hold that are linear in a and t; whether any a and t
fulfil them is decided by eliminating t (Fourier and Motzkin) and clipping the range of a.

Based on: the count of what a moving segment crosses, as in `occluders`; shafts between boxes, E. Haines, J. Wallace:
Shaft Culling for Efficient Ray-Traced Radiosity, Eurographics Workshop on Rendering 1991; subdivision of the cell and
of what is looked at until decided, as in hierarchical radiosity, P. Hanrahan, D. Salzman, L. Aupperle, SIGGRAPH 1991.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.aimed_rays import INSET, LEAST_WEIGHT, facing
from jobs.visibility.clusters import Clusters, place_cluster
from jobs.visibility.mesh import TURNED, Mesh, look, side_of
from jobs.visibility.occludees import box_hidden, may_touch, triangle_hidden
from jobs.visibility.ray_tree import APART, SAME, STACK, SURELY, Scene, inverse, meets, next_bundle
from storage.kernels import allocating_kernel, kernel

#: Boxes are grown by this many grid units: a million times what rounding moves a point by.
GROWN = 2.0**-10
#: Most triangles in a set that closes a shaft.
LARGEST_SET = 256
#: So many triangles that a segment crosses are tried as the first of a set: of one for a shaft, and of one beside an
#: edge that is not safe.
MOST_SEEDS, EDGE_SEEDS = 3, 2
#: For so many edges of a set that are not safe another set is looked for.
MOST_BESIDES = 8
#: So many edges that keep a shaft open are remembered while it is looked at.
OPEN_EDGES = 8
#: Shafts that can wait at once.
QUEUE = 8192
#: Marks are cleared once so many floods have been counted: they fit int32, whatever a cell adds.
MOST_EPOCHS = 1 << 30
#: What becomes of a shaft.
OPEN, CLOSED, SEEN = 0, 1, 2


class Shaft(NamedTuple):
    """A shaft, in grid units."""

    v: np.ndarray  # (2, 3) float64 the box V
    u: np.ndarray  # (2, 3) float64 the box U, grown
    corners: np.ndarray  # (3, 3) float64 what is looked at: U holds their hull
    low: np.ndarray  # (2, 3) float64 the lower bounds: at U, and how they change from there to V
    high: np.ndarray  # (2, 3) float64 the upper bounds
    centre: np.ndarray  # (3,) float64 of V
    half: np.ndarray  # (3,) float64 half the extents of V, grown
    o: np.ndarray  # (3,) float64 where a segment through the shaft starts
    d: np.ndarray  # (3,) float64 where it leads from there


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


@kernel()
def edge_meets(ax: np.ndarray, bx: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
    """Where an edge meets a shaft: the range of a, within 0 (at U) to 1 (at V); empty, the first above the second,
    where it does not. See the module's docstring.

    Args:
        ax, bx: (3,) int32 the ends of the edge, grid units.
        low, high: (2, 3) float64: the shaft's part at a reaches from low[0] + a low[1] to high[0] + a high[1].
    """
    for k in range(3):
        a, b = float(ax[k]), float(bx[k])
        if max(a, b) < low[0, k] + min(low[1, k], 0.0) or min(a, b) > high[0, k] + max(high[1, k], 0.0):
            return 1.0, 0.0
    first, last = 0.0, 1.0
    for i in range(3):
        di = float(bx[i]) - ax[i]
        if di == 0.0:
            first, last = _not_above(first, last, low[0, i] - ax[i], low[1, i])
            first, last = _not_above(first, last, ax[i] - high[0, i], -high[1, i])
            continue
        # t is at least p + q a for this axis
        if di > 0.0:
            p, q = (low[0, i] - ax[i]) / di, low[1, i] / di
            r, s = (high[0, i] - ax[i]) / di, high[1, i] / di
        else:
            p, q = (high[0, i] - ax[i]) / di, high[1, i] / di
            r, s = (low[0, i] - ax[i]) / di, low[1, i] / di
        first, last = _not_above(first, last, p - 1.0, q)
        first, last = _not_above(first, last, -r, -s)
        if first > last:
            return 1.0, 0.0
        for j in range(3):
            dj = float(bx[j]) - ax[j]
            if j == i or dj == 0.0:
                continue
            # and at most r + s a for the others
            if dj > 0.0:
                r, s = (high[0, j] - ax[j]) / dj, high[1, j] / dj
            else:
                r, s = (low[0, j] - ax[j]) / dj, low[1, j] / dj
            first, last = _not_above(first, last, p - r, q - s)
    return first, last


@kernel(inline="always")
def _not_above(first: float, last: float, value: float, slope: float) -> tuple[float, float]:
    """The part of [first, last] where value + a slope <= 0; empty where the first result is above the second."""
    if slope > 0.0:
        last = min(last, -value / slope)
    elif slope < 0.0:
        first = max(first, -value / slope)
    elif value > 0.0:
        last = first - 1.0
    return first, last


@kernel()
def part_within(
    ax: np.ndarray, bx: np.ndarray, low: np.ndarray, high: np.ndarray, first: float, last: float
) -> tuple[float, float]:
    """A range of t that holds the part of an edge within a shaft; first, last: the range of a, see `edge_meets`."""
    t0, t1 = 0.0, 1.0
    for k in range(3):
        dk = float(bx[k]) - ax[k]
        if dk == 0.0:
            continue
        least = low[0, k] + min(first * low[1, k], last * low[1, k])
        most = high[0, k] + max(first * high[1, k], last * high[1, k])
        if dk > 0.0:
            t0, t1 = max(t0, (least - ax[k]) / dk), min(t1, (most - ax[k]) / dk)
        else:
            t0, t1 = max(t0, (most - ax[k]) / dk), min(t1, (least - ax[k]) / dk)
    return t0, max(t0, t1)


@kernel()
def _apart(vertices: np.ndarray, triangles: np.ndarray, t: int, corners: np.ndarray, count: int, u: np.ndarray) -> bool:
    """Whether triangle t surely does not touch the hull of some corners (count of (3, 3) float64); u: (2, 3) their box.

    They are apart where their boxes are, or where all corners lie on one side of the triangle's plane, by GROWN.
    """
    i0, i1, i2 = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    for k in range(3):
        x, y, z = float(vertices[i0, k]), float(vertices[i1, k]), float(vertices[i2, k])
        if max(x, y, z) < u[0, k] or min(x, y, z) > u[1, k]:
            return True
    x0, y0, z0 = float(vertices[i0, 0]), float(vertices[i0, 1]), float(vertices[i0, 2])
    ux, uy, uz = vertices[i1, 0] - x0, vertices[i1, 1] - y0, vertices[i1, 2] - z0
    wx, wy, wz = vertices[i2, 0] - x0, vertices[i2, 1] - y0, vertices[i2, 2] - z0
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    slack = GROWN * (abs(nx) + abs(ny) + abs(nz))
    above = below = True
    for k in range(count):
        along = nx * (corners[k, 0] - x0) + ny * (corners[k, 1] - y0) + nz * (corners[k, 2] - z0)
        above &= along > slack
        below &= along < -slack
    return above or below


@kernel(inline="always")
def _occludes(scene: Scene, facets: Mesh, t: int, whole: bool, centre: np.ndarray, half: np.ndarray) -> int:
    """The side of triangle t on which a part of the cell lies, 0 where it may not occlude; whole: all of the cell."""
    drawable = scene.triangle_drawable[t]
    if not facets.active[drawable]:
        return 0
    side = look(facets, t)
    if side == 0 and not whole:
        side = side_of(scene.vertices, scene.triangles, t, centre, half)
    if side < 0 and scene.one_sided[drawable]:
        return 0
    return side


@kernel()
def _span(shaft: Shaft, count: int) -> None:
    """Fill in a shaft of which V and `count` corners are known."""
    for k in range(3):
        least, most = np.inf, -np.inf
        for c in range(count):
            least = min(least, shaft.corners[c, k])
            most = max(most, shaft.corners[c, k])
        shaft.u[0, k], shaft.u[1, k] = least - GROWN, most + GROWN
        shaft.low[0, k] = shaft.u[0, k]
        shaft.low[1, k] = shaft.v[0, k] - GROWN - shaft.u[0, k]
        shaft.high[0, k] = shaft.u[1, k]
        shaft.high[1, k] = shaft.v[1, k] + GROWN - shaft.u[1, k]
        shaft.centre[k] = 0.5 * (shaft.v[0, k] + shaft.v[1, k])
        shaft.half[k] = 0.5 * (shaft.v[1, k] - shaft.v[0, k]) * (1.0 + 1e-9) + GROWN


@kernel(inline="always")
def _side(scene: Scene, facets: Mesh, t: int, whole: bool, view: Shaft, shaft: Shaft, beyond: bool) -> int:
    """The side of triangle t on which the shaft's V lies, 0 where it may not occlude.

    whole: whether view.v is the whole cell; beyond: whether the shaft is one from an edge on: both must be on one side.
    """
    side = _occludes(scene, facets, t, whole, view.centre, view.half)
    if beyond and side != 0 and side_of(scene.vertices, scene.triangles, t, shaft.centre, shaft.half) != side:
        return 0
    return side


@kernel(inline="always")
def _partner(
    scene: Scene, facets: Mesh, t: int, i: int, side: int, whole: bool, view: Shaft, shaft: Shaft, beyond: bool,
    seen: np.ndarray, epoch: int,
) -> int:  # fmt: skip
    """A triangle surely on the other side of edge i of t as seen from V, one of the set where there is one, or -1."""
    mine = side if scene.triangles[t, i] < scene.triangles[t, (i + 1) % 3] else -side
    e = facets.triangle_edges[t, i]
    partner = -1
    for j in range(facets.edge_start[e], facets.edge_start[e + 1]):
        other = facets.edge_uses[j] >> 1
        if other == t:
            continue
        its = _side(scene, facets, other, whole, view, shaft, beyond)
        if its != 0 and (-its if facets.edge_uses[j] & 1 else its) == -mine:
            partner = other
            if seen[other] == epoch:
                break
    return partner


@kernel()
def _closes_alone(
    scene: Scene, facets: Mesh, work: Work, view: Shaft, shaft: Shaft, count: int, seed: int, whole: bool,
    beyond: bool,
) -> int:  # fmt: skip
    """The size of the set (in work.flood[1]) flooded from a triangle that closes a shaft by itself; 0: it does not.

    Args: as for `_side`; count: corners of what is looked at; seed: a triangle that a segment in the shaft crosses.
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
        if not _apart(scene.vertices, scene.triangles, t, shaft.corners, count, shaft.u):
            return 0
        side = _side(scene, facets, t, whole, view, shaft, beyond)
        for i in range(3):
            a, b = scene.triangles[t, i], scene.triangles[t, (i + 1) % 3]
            first, last = edge_meets(scene.vertices[a], scene.vertices[b], shaft.low, shaft.high)
            if first > last:
                continue
            partner = _partner(scene, facets, t, i, side, whole, view, shaft, beyond, seen, epoch)
            if partner < 0 or (seen[partner] != epoch and size == LARGEST_SET):
                return 0
            if seen[partner] != epoch:
                flood[size] = partner
                seen[partner] = epoch
                size += 1
    return size


@kernel()
def _find_set(
    scene: Scene, standing: np.ndarray, facets: Mesh, work: Work, view: Shaft, shaft: Shaft, count: int, whole: bool,
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
        c, waiting = next_bundle(scene, shaft.o, shaft.d, work.inverse[1], 1.0, stack, waiting)
        if c < 0:
            return 0
        if not standing[scene.triangle_drawable[scene.bundle_start[c]]]:
            continue
        for t in range(scene.bundle_start[c], scene.bundle_start[c + 1]):
            if (
                work.seen[1, t] <= begin
                and abs(meets(scene.vertices, scene.triangles, t, shaft.o, shaft.d, reach)) == SURELY
                and _side(scene, facets, t, whole, view, shaft, beyond) != 0
            ):
                size = _closes_alone(scene, facets, work, view, shaft, count, t, whole, beyond)
                if size:
                    return size
                seeds += 1
                if seeds == EDGE_SEEDS:
                    return 0


@kernel()
def _set_beside(
    scene: Scene, standing: np.ndarray, facets: Mesh, work: Work, shaft: Shaft, small: Shaft, a: int, b: int,
    first: float, last: float, whole: bool,
) -> int:  # fmt: skip
    """The size of a set (in work.flood[1]) that all segments through an edge in a shaft cross besides; 0: none found.

    Args:
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
    _span(small, 2)
    size = _find_set(scene, standing, facets, work, shaft, small, 2, whole, False)
    if size:
        return size
    for k in range(3):
        x, y = small.corners[0, k], small.corners[1, k]
        small.v[0, k], small.v[1, k] = min(x, y), max(x, y)
        small.o[k] = 0.5 * (x + y)
    for k in range(3):
        small.d[k] = shaft.o[k] + shaft.d[k] - small.o[k]
        for c in range(3):
            small.corners[c, k] = shaft.corners[c, k]
    _span(small, 3)
    return _find_set(scene, standing, facets, work, shaft, small, 3, whole, True)


@kernel()
def _stays_open(
    scene: Scene, standing: np.ndarray, facets: Mesh, work: Work, shaft: Shaft, small: Shaft, seed: int, whole: bool
) -> float:
    """Where a shaft stays open (a, from 0 at U to 1 at V) when a set is flooded from a triangle; -1: the set closes it.

    Args:
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
        if not _apart(scene.vertices, scene.triangles, t, shaft.corners, 3, shaft.u):
            return 0.0
        side = _side(scene, facets, t, whole, shaft, shaft, False)
        for i in range(3):
            a, b = scene.triangles[t, i], scene.triangles[t, (i + 1) % 3]
            first, last = edge_meets(scene.vertices[a], scene.vertices[b], shaft.low, shaft.high)
            if first > last:
                continue
            partner = _partner(scene, facets, t, i, side, whole, shaft, shaft, False, seen, epoch)
            added = 1
            if partner >= 0:
                work.flood[1, 0] = partner
            elif besides == MOST_BESIDES:
                return 0.5 * (first + last)
            else:
                e = facets.triangle_edges[t, i]
                known = False
                for k in range(OPEN_EDGES):
                    known |= work.open_edge[k] == e
                if known:
                    return 0.5 * (first + last)
                besides += 1
                added = _set_beside(scene, standing, facets, work, shaft, small, a, b, first, last, whole)
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


@kernel()
def _decide(
    scene: Scene, standing: np.ndarray, facets: Mesh, work: Work, shaft: Shaft, small: Shaft, drawable: int, t: int,
    weight: float, whole: bool, from_corner: int, hint: int,
) -> tuple[int, int, float]:  # fmt: skip
    """What becomes of the shaft from shaft.v to the hull of shaft.corners.

    Args:
        standing: (drawables,) bool what is reported: it alone can stand before what is seen.
        small: scratch.
        t: the triangle of `drawable` of which the corners are a part.
        weight: the least weight that the part's middle has among the corners of the triangle.
        whole: whether V is the whole cell.
        from_corner: of V, 0 to 7, that a segment starts from.
        hint: a triangle to try first, or -1.

    Returns:
        (OPEN, CLOSED or SEEN; the triangle to try first next time; where the shaft is open, from 0 at U to 1 at V, -1
        where nobody knows).
    """
    _span(shaft, 3)
    if scene.one_sided[drawable] and side_of(scene.vertices, scene.triangles, t, shaft.centre, shaft.half) < 0:
        return CLOSED, hint, 0.0
    o, d = shaft.o, shaft.d
    reach = 0.0
    for k in range(3):
        part = 1.0 - 0.5 * INSET if from_corner >> k & 1 else 0.5 * INSET
        o[k] = shaft.v[0, k] + (shaft.v[1, k] - shaft.v[0, k]) * part
        d[k] = (shaft.corners[0, k] + shaft.corners[1, k] + shaft.corners[2, k]) / 3.0 - o[k]
        reach = max(reach, abs(shaft.u[0, k] - o[k]), abs(shaft.u[1, k] - o[k]))
    begin, where = work.epoch[0], -1.0
    for k in range(OPEN_EDGES):
        work.open_edge[k] = -1
    if (
        hint >= 0
        and abs(meets(scene.vertices, scene.triangles, hint, o, d, reach)) == SURELY
        and _side(scene, facets, hint, whole, shaft, shaft, False) != 0
    ):
        where = _stays_open(scene, standing, facets, work, shaft, small, hint, whole)
        if where < 0.0:
            return CLOSED, hint, 0.0
    inverse(d, work.inverse[0])
    stack = work.stack[0]
    stack[0] = 0
    waiting, free, seeds = 1, True, 0
    while True:
        c, waiting = next_bundle(scene, o, d, work.inverse[0], 1.0 + SAME, stack, waiting)
        if c < 0:
            break
        its = scene.triangle_drawable[scene.bundle_start[c]]
        if not standing[its]:
            continue
        for other in range(scene.bundle_start[c], scene.bundle_start[c + 1]):
            met = meets(scene.vertices, scene.triangles, other, o, d, reach)
            if met == APART or (met < APART and scene.one_sided[its]):
                continue
            free &= its == drawable
            if (
                abs(met) == SURELY
                and work.seen[0, other] <= begin
                and _side(scene, facets, other, whole, shaft, shaft, False) != 0
            ):
                place = _stays_open(scene, standing, facets, work, shaft, small, other, whole)
                if place < 0.0:
                    return CLOSED, other, 0.0
                if where < 0.0:
                    where = place
                seeds += 1
                if seeds == MOST_SEEDS:
                    return OPEN, hint, where
    if free and weight >= LEAST_WEIGHT:
        ahead, slack = facing(scene, t, o, reach)
        if abs(ahead) > slack and not (ahead > 0 and scene.one_sided[drawable]):
            return SEEN, hint, 0.0
    return OPEN, hint, where


@kernel()
def _place_part(scene: Scene, t: int, weights: np.ndarray, shaft: Shaft) -> float:
    """Put the corners of a part of triangle t into shaft.corners; returns the least weight of its middle.

    weights: (6,) float64 the weights of the triangle's first two corners at the part's three corners.
    """
    middle_a, middle_b = 0.0, 0.0
    for c in range(3):
        wa, wb = weights[2 * c], weights[2 * c + 1]
        middle_a += wa / 3.0
        middle_b += wb / 3.0
        for k in range(3):
            shaft.corners[c, k] = (
                wa * scene.vertices[scene.triangles[t, 0], k]
                + wb * scene.vertices[scene.triangles[t, 1], k]
                + (1.0 - wa - wb) * scene.vertices[scene.triangles[t, 2], k]
            )
    return min(middle_a, middle_b, 1.0 - middle_a - middle_b)


@kernel()
def _halve(
    v: np.ndarray, weights: np.ndarray, shaft: Shaft, where: float, other_v: np.ndarray, other_weights: np.ndarray
) -> bool:
    """Cut the larger of a part of the cell and a part of a triangle in two, in place; the second half goes to other_*.

    v, other_v: (6,) float64 boxes, lower corner first; weights, other_weights: (6,) float64, see `_place_part`, whose
    corners are still in `shaft`. Returns whether it was the part of the cell.
    """
    axis, wide = 0, -1.0
    for k in range(3):
        if v[3 + k] - v[k] > wide:
            axis, wide = k, v[3 + k] - v[k]
    edge, long = 0, -1.0
    for c in range(3):
        length = 0.0
        for k in range(3):
            length += (shaft.corners[c, k] - shaft.corners[(c + 1) % 3, k]) ** 2
        if length > long:
            edge, long = c, length
    for k in range(6):
        other_v[k], other_weights[k] = v[k], weights[k]
    if where >= 0.0:
        wide *= where
        long *= (1.0 - where) ** 2
    if long > wide * wide:
        a, b = edge, (edge + 1) % 3
        for k in range(2):
            middle = 0.5 * (weights[2 * a + k] + weights[2 * b + k])
            weights[2 * b + k] = middle
            other_weights[2 * a + k] = middle
        return False
    middle = 0.5 * (v[axis] + v[3 + axis])
    v[3 + axis] = middle
    other_v[axis] = middle
    return True


@allocating_kernel()
def decide(
    scene: Scene, standing: np.ndarray, facets: Mesh, work: Work, chosen: np.ndarray, first_cluster: np.ndarray,
    clusters: Clusters, lo: np.ndarray, hi: np.ndarray, layers: np.ndarray, most: int, at_one: int, hidden: np.ndarray,
    proven: np.ndarray,
) -> int:  # fmt: skip
    """Decide of drawables that images leave undecided whether they are hidden or seen.

    Args:
        standing: (drawables,) bool what is reported.
        work: see `make_work`.
        chosen: (c,) int64 drawables to decide, in the order in which they may use up the time.
        first_cluster: (drawables + 1,) int32 offsets into the clusters.
        lo, hi: (3,) float64 the cell, grid units.
        layers: see `occludees`: parts that these hide are not looked at again.
        most: shafts in all; at_one: at one drawable, besides one for each of its triangles.
        hidden, proven: (drawables,) bool, set to True where a drawable is surely hidden, or seen.

    Returns:
        The shafts that were looked at.
    """
    shaft = Shaft(
        np.empty((2, 3)), np.empty((2, 3)), np.empty((3, 3)), np.empty((2, 3)), np.empty((2, 3)), np.empty(3),
        np.empty(3), np.empty(3), np.empty(3),
    )  # fmt: skip
    small = Shaft(
        np.empty((2, 3)), np.empty((2, 3)), np.empty((3, 3)), np.empty((2, 3)), np.empty((2, 3)), np.empty(3),
        np.empty(3), np.empty(3), np.empty(3),
    )  # fmt: skip
    if work.epoch.max() > MOST_EPOCHS:
        work.epoch[:] = 0
        work.seen[:] = 0
    polygon, placed = np.empty((4, 2), np.float64), np.empty((2, 3), np.float64)
    part_v, part_weights = np.empty((QUEUE, 6)), np.empty((QUEUE, 6))
    part_triangle, part_whole = np.empty(QUEUE, np.int32), np.empty(QUEUE, np.bool_)
    shafts, hint = 0, -1
    for drawable in chosen:
        count, head = 0, 0
        result = CLOSED
        for c in range(first_cluster[drawable], first_cluster[drawable + 1]):
            place_cluster(clusters, c, facets.centre, facets.half, placed)
            if box_hidden(placed[0], placed[1], layers, False):
                continue
            for t in range(clusters.start[c], clusters.start[c + 1]):
                if look(facets, t) == TURNED:
                    continue
                a, b, corner = scene.triangles[t, 0], scene.triangles[t, 1], scene.triangles[t, 2]
                if look(facets, t) == 0 and may_touch(facets.q, a, b, corner):
                    result = OPEN
                    break
                if triangle_hidden(facets.q, a, b, corner, layers, polygon):
                    continue
                if count == QUEUE:
                    result = OPEN
                    break
                for k in range(3):
                    part_v[count, k], part_v[count, 3 + k] = lo[k], hi[k]
                part_weights[count, 0], part_weights[count, 1] = 1.0, 0.0
                part_weights[count, 2], part_weights[count, 3] = 0.0, 1.0
                part_weights[count, 4], part_weights[count, 5] = 0.0, 0.0
                part_triangle[count], part_whole[count] = t, True
                count += 1
            if result == OPEN:
                break
        if result == OPEN:
            continue
        left = min(at_one + count, most - shafts)
        while head < count:
            if left <= 0:
                result = OPEN
                break
            left -= 1
            shafts += 1
            at = head % QUEUE
            t = part_triangle[at]
            for k in range(3):
                shaft.v[0, k], shaft.v[1, k] = part_v[at, k], part_v[at, 3 + k]
            weight = _place_part(scene, t, part_weights[at], shaft)
            found, hint, where = _decide(
                scene, standing, facets, work, shaft, small, drawable, t, weight, part_whole[at], head & 7, hint
            )
            head += 1
            if found == SEEN:
                result = SEEN
                break
            if found == CLOSED:
                continue
            if count + 2 - head > QUEUE:
                result = OPEN
                break
            first, second = count % QUEUE, (count + 1) % QUEUE
            for k in range(6):
                part_v[first, k], part_weights[first, k] = part_v[at, k], part_weights[at, k]
            whole = part_whole[at]
            if _halve(part_v[first], part_weights[first], shaft, where, part_v[second], part_weights[second]):
                whole = False
            part_triangle[first] = part_triangle[second] = t
            part_whole[first] = part_whole[second] = whole
            count += 2
        if result == CLOSED:
            hidden[drawable] = True
        elif result == SEEN:
            proven[drawable] = True
    return shafts
