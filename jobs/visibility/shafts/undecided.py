"""What images leave undecided: shafts between parts of the cell and parts of a drawable, split until they are decided.

Either a ray through a shaft proves that the drawable is seen, or a set of triangles closes the shaft (`closing_sets`),
or the part of the cell or of the drawable is cut in two and both halves are looked at. A drawable of which all shafts
are closed is hidden from the whole cell. Here neither a pixel's width nor the depths within it blur what is hidden, and
parts of the cell may be hidden from by different occluders.

A part of a drawable is a box around some of its triangles at first, and once only one is left, a part of that triangle.
So what a wall hides altogether takes one shaft, however many triangles it has.

**Whose turn it is.** Time goes to the drawable whose triangles, divided by the shafts that it will still take, are
most. The second is foretold: where a part f of the shafts looked at last stayed open, each of which leaves two in its
place, n shafts that wait take n / (1 - 2 f) in all. Drawables that look as if they would take too many are given up:
what ends in a silhouette halves for ever.

Based on: subdivision of the cell and of what is looked at until decided, as in hierarchical radiosity, P. Hanrahan, D.
Salzman, L. Aupperle: A Rapid Hierarchical Radiosity Algorithm, SIGGRAPH 1991.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.flooding.occludees import box_hidden, may_touch, triangle_hidden
from jobs.visibility.proof.aimed_rays import INSET, LEAST_WEIGHT, facing
from jobs.visibility.shafts.closing_sets import OPEN_EDGES, Work, make_work, side_in, stays_open
from jobs.visibility.shafts.shafts import Shaft, make_shaft, span
from jobs.visibility.surfaces.clusters import Clusters, place_cluster
from jobs.visibility.surfaces.planes import side_of
from jobs.visibility.surfaces.ray_tree import APART, SAME, SURELY, Scene, inverse, meets, next_bundle, passes_beside
from jobs.visibility.surfaces.seen_mesh import TURNED, Mesh, look
from storage.base.kernels import allocating_kernel, kernel

#: So many triangles that a segment crosses are tried as the first of a set that closes its shaft.
MOST_SEEDS = 3
#: Shafts that can wait at once, of all drawables.
POOL = 1 << 15
#: So many shafts of a drawable are looked at in turn.
TURN = 16
#: How much the part that stays open follows the last shaft.
FOLLOWS = 1.0 / 24.0
#: The least that waiting shafts are thought to become fewer by, for each that is looked at.
LEAST_PROGRESS = 0.02
#: What becomes of a shaft.
OPEN, CLOSED, SEEN = 0, 1, 2


class Parts(NamedTuple):
    """Shafts that wait, in lists."""

    v: np.ndarray  # (POOL, 6) float64 a part of the cell, lower corner first
    u: np.ndarray  # (POOL, 6) float64 a box around some triangles
    weights: np.ndarray  # (POOL, 6) float64 where there is one: of its first two corners at the part's three corners
    first: np.ndarray  # (POOL,) int32 the triangles, as places in the order of what is open
    last: np.ndarray  # (POOL,) int32
    whole: np.ndarray  # (POOL,) bool: the whole cell
    next: np.ndarray  # (POOL,) int32 the next one in the same list, or among those that are free; -1: none
    free: np.ndarray  # (1,) int32 the first one that is free; -1: none


class Turns(NamedTuple):
    """How far the drawables are that are to be decided, by their numbers."""

    head: np.ndarray  # (c,) int32 lists of shafts that wait
    tail: np.ndarray  # (c,) int32
    waiting: np.ndarray  # (c,) int32 how many; 0: decided, or given up
    looked: np.ndarray  # (c,) int32 shafts that were looked at
    open: np.ndarray  # (c,) float64 the part of the last ones that stayed open
    order: np.ndarray  # (n,) int32 their triangles that are open, drawable by drawable; `Parts` name places in it


class Asked(NamedTuple):
    """Drawables to decide."""

    chosen: np.ndarray  # (c,) int64
    first_cluster: np.ndarray  # (drawables + 1,) int32 offsets of all drawables into the clusters
    triangles: np.ndarray  # (drawables,) int64 how many all drawables have, as stored


class Effort(NamedTuple):
    """How hard to try."""

    shafts: int  # in all
    least_worth: float  # triangles to save for each shaft, or a drawable is given up
    allowed: int  # go no further once drawables with more triangles than this are sure to stay


class Room(NamedTuple):
    """What shafts are looked at in."""

    work: Work
    parts: Parts
    shaft: Shaft  # the one that is looked at
    small: Shaft  # scratch


def make_room(triangles: int) -> Room:
    """What shafts among so many triangles are looked at in, for any number of cells."""
    parts = Parts(
        np.empty((POOL, 6)), np.empty((POOL, 6)), np.empty((POOL, 6)), np.empty(POOL, np.int32),
        np.empty(POOL, np.int32), np.empty(POOL, np.bool_), np.empty(POOL, np.int32), np.zeros(1, np.int32),
    )  # fmt: skip
    return Room(make_work(triangles), parts, make_shaft(), make_shaft())


@kernel()
def _free_all(parts: Parts) -> None:
    """Nothing waits."""
    parts.free[0] = 0
    for at in range(POOL):
        parts.next[at] = at + 1 if at + 1 < POOL else -1


@kernel(inline="always")
def _take(parts: Parts) -> int:
    """A shaft that is free, or -1."""
    at = parts.free[0]
    if at >= 0:
        parts.free[0] = parts.next[at]
    return at


@kernel(inline="always")
def _give_back(parts: Parts, at: int) -> None:
    """A shaft is free from now on."""
    parts.next[at] = parts.free[0]
    parts.free[0] = at


@kernel()
def _append(parts: Parts, turns: Turns, k: int, at: int) -> None:
    """A shaft waits from now on, the last one in the list of a drawable."""
    parts.next[at] = -1
    if turns.waiting[k]:
        parts.next[turns.tail[k]] = at
    else:
        turns.head[k] = at
    turns.tail[k] = at
    turns.waiting[k] += 1


@kernel()
def _take_first(parts: Parts, turns: Turns, k: int) -> int:
    """The first shaft in the list of a drawable, which is in no list from now on."""
    at = turns.head[k]
    turns.head[k] = parts.next[at]
    turns.waiting[k] -= 1
    return at


@kernel()
def _give_up(parts: Parts, turns: Turns, k: int) -> None:
    """Nothing of a drawable waits any more."""
    while turns.waiting[k]:
        _give_back(parts, _take_first(parts, turns, k))


@kernel()
def _look(
    scene: Scene, mesh: Mesh, room: Room, count: int, drawable: int, t: int, weight: float, whole: bool, hint: int
) -> tuple[int, int, float]:
    """What becomes of `room.shaft`, which is filled in.

    Args:
        scene: of what is reported: it alone can stand before what is seen.
        count: corners of what is looked at.
        t: the triangle of `drawable` that the segment from shaft.o along shaft.d ends in.
        weight: the least weight that this end has among the corners of the triangle.
        whole: whether V is the whole cell.
        hint: a triangle to try first, or -1.

    Returns:
        (OPEN, CLOSED or SEEN; the triangle to try first next time; where the shaft is open, from 0 at U to 1 at V, -1
        where nobody knows).
    """
    work, shaft, small = room.work, room.shaft, room.small
    o, d = shaft.o, shaft.d
    reach = 0.0
    for k in range(3):
        reach = max(reach, abs(shaft.u[0, k] - o[k]), abs(shaft.u[1, k] - o[k]))
    begin, where = work.epoch[0], -1.0
    for k in range(OPEN_EDGES):
        work.open_edge[k] = -1
    if (
        hint >= 0
        and abs(meets(scene.vertices, scene.triangles, hint, o, d, reach)) == SURELY
        and side_in(scene, mesh, hint, whole, shaft, shaft, False) != 0
    ):
        where = stays_open(scene, mesh, work, shaft, count, small, hint, whole)
        if where < 0.0:
            return CLOSED, hint, 0.0
    inverse(d, work.inverse[0])
    stack = work.stack[0]
    stack[0] = 0
    waiting, free, seeds = 1, True, 0
    while True:
        c, waiting = next_bundle(scene, o, work.inverse[0], 1.0 + SAME, stack, waiting)
        if c < 0:
            break
        its = scene.triangle_drawable[scene.bundle_start[c]]
        beside = passes_beside(scene.corners, c, o, d, reach)
        for other in range(scene.bundle_start[c], scene.bundle_start[c + 1]):
            if beside >> (other - scene.bundle_start[c]) & 1:
                continue
            met = meets(scene.vertices, scene.triangles, other, o, d, reach)
            if met == APART or (met < APART and scene.one_sided[its]):
                continue
            free &= its == drawable
            if (
                abs(met) == SURELY
                and work.seen[0, other] <= begin
                and side_in(scene, mesh, other, whole, shaft, shaft, False) != 0
            ):
                place = stays_open(scene, mesh, work, shaft, count, small, other, whole)
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
def _place(scene: Scene, order: np.ndarray, parts: Parts, at: int, from_corner: int, shaft: Shaft) -> tuple[int, float]:
    """Fill in a shaft that waits, with a segment from one of the cell's corners to a triangle.

    Args:
        order: (n,) int32 triangles.
        at: which one; from_corner: of V, 0 to 7.

    Returns:
        (corners of what is looked at; the least of the weights that the segment's end has in its triangle).
    """
    first, last = parts.first[at], parts.last[at]
    middle_a, middle_b = 1.0 / 3.0, 1.0 / 3.0
    t = order[(first + last) // 2]
    if last - first == 1:
        middle_a = middle_b = 0.0
        count = 3
        for c in range(3):
            wa, wb = parts.weights[at, 2 * c], parts.weights[at, 2 * c + 1]
            middle_a += wa / 3.0
            middle_b += wb / 3.0
            for k in range(3):
                shaft.corners[c, k] = (
                    wa * scene.vertices[scene.triangles[t, 0], k]
                    + wb * scene.vertices[scene.triangles[t, 1], k]
                    + (1.0 - wa - wb) * scene.vertices[scene.triangles[t, 2], k]
                )
    else:
        count = 8
        for c in range(8):
            for k in range(3):
                shaft.corners[c, k] = parts.u[at, 3 * (c >> k & 1) + k]
    for k in range(3):
        shaft.v[0, k], shaft.v[1, k] = parts.v[at, k], parts.v[at, 3 + k]
        inside = 1.0 - 0.5 * INSET if from_corner >> k & 1 else 0.5 * INSET
        shaft.o[k] = shaft.v[0, k] + (shaft.v[1, k] - shaft.v[0, k]) * inside
        shaft.d[k] = (
            middle_a * scene.vertices[scene.triangles[t, 0], k]
            + middle_b * scene.vertices[scene.triangles[t, 1], k]
            + (1.0 - middle_a - middle_b) * scene.vertices[scene.triangles[t, 2], k]
        ) - shaft.o[k]
    span(shaft, count)
    return count, min(middle_a, middle_b, 1.0 - middle_a - middle_b)


@kernel()
def _box(scene: Scene, order: np.ndarray, parts: Parts, at: int) -> None:
    """Fill in the box around the triangles of a shaft that waits, which is of all three of their corners."""
    u = parts.u
    for k in range(3):
        u[at, k], u[at, 3 + k] = np.inf, -np.inf
    for place in range(parts.first[at], parts.last[at]):
        for c in range(3):
            vertex = scene.triangles[order[place], c]
            for k in range(3):
                x = float(scene.vertices[vertex, k])
                u[at, k] = min(u[at, k], x)
                u[at, 3 + k] = max(u[at, 3 + k], x)
    for k in range(6):
        parts.weights[at, k] = 1.0 if k in (0, 3) else 0.0


@kernel()
def _middle(scene: Scene, order: np.ndarray, first: int, last: int, u: np.ndarray) -> int:
    """Where some triangles are cut in two, sorted so that those on either side of their box's middle hang together.

    Which triangles go where depends on which they are alone, not on their order, unless one half would be empty: so
    parts of the same triangles that are cut after one another keep what they have in common. u: (6,) float64 their box.
    """
    axis, wide = 0, -1.0
    for k in range(3):
        if u[3 + k] - u[k] > wide:
            axis, wide = k, u[3 + k] - u[k]
    middle = 1.5 * (u[axis] + u[3 + axis])
    i, j = first, last - 1
    while True:
        while i <= j and _three_middles(scene, order[i], axis) < middle:
            i += 1
        while i <= j and not _three_middles(scene, order[j], axis) < middle:
            j -= 1
        if i > j:
            break
        order[i], order[j] = order[j], order[i]
    return (first + last) // 2 if i in (first, last) else i


@kernel(inline="always")
def _three_middles(scene: Scene, t: int, axis: int) -> float:
    """Three times the middle of a triangle along an axis."""
    a, b, c = scene.triangles[t, 0], scene.triangles[t, 1], scene.triangles[t, 2]
    return float(scene.vertices[a, axis]) + scene.vertices[b, axis] + scene.vertices[c, axis]


@kernel()
def _halve(scene: Scene, order: np.ndarray, parts: Parts, at: int, other: int, shaft: Shaft, where: float) -> None:
    """Cut the part of the cell or of the drawable in two, whichever is larger where the shaft is open, in place.

    at: the shaft, which receives the first half; other: receives the second; shaft: `at`, filled in.
    """
    axis, wide = 0, -1.0
    for k in range(3):
        if parts.v[at, 3 + k] - parts.v[at, k] > wide:
            axis, wide = k, parts.v[at, 3 + k] - parts.v[at, k]
    one = parts.last[at] - parts.first[at] == 1
    edge, long = 0, -1.0
    for c in range(3):
        length = 0.0
        if one:
            for k in range(3):
                length += (shaft.corners[c, k] - shaft.corners[(c + 1) % 3, k]) ** 2
        else:
            length = (parts.u[at, 3 + c] - parts.u[at, c]) ** 2
        if length > long:
            edge, long = c, length
    for k in range(6):
        parts.v[other, k], parts.u[other, k] = parts.v[at, k], parts.u[at, k]
        parts.weights[other, k] = parts.weights[at, k]
    parts.first[other], parts.last[other] = parts.first[at], parts.last[at]
    if where >= 0.0:
        wide *= where
        long *= (1.0 - where) ** 2
    if long <= wide * wide:
        middle = 0.5 * (parts.v[at, axis] + parts.v[at, 3 + axis])
        parts.v[at, 3 + axis] = parts.v[other, axis] = middle
        parts.whole[at] = parts.whole[other] = False
        return
    parts.whole[other] = parts.whole[at]
    if one:
        a, b = edge, (edge + 1) % 3
        for k in range(2):
            half = 0.5 * (parts.weights[at, 2 * a + k] + parts.weights[at, 2 * b + k])
            parts.weights[at, 2 * b + k] = parts.weights[other, 2 * a + k] = half
        return
    cut = _middle(scene, order, parts.first[at], parts.last[at], parts.u[at])
    parts.last[at] = parts.first[other] = cut
    _box(scene, order, parts, at)
    _box(scene, order, parts, other)


@kernel(inline="always")
def _worth(turns: Turns, k: int, triangles: int) -> float:
    """The triangles that a drawable may save for each shaft that it will still take."""
    return triangles / (turns.waiting[k] / max(1.0 - 2.0 * turns.open[k], LEAST_PROGRESS))


@kernel(inline="always")
def _hopeful(turns: Turns, k: int, triangles: int, least_worth: float) -> bool:
    """Whether shafts of a drawable wait that may be worth looking at."""
    return turns.waiting[k] > 0 and _worth(turns, k, triangles) > least_worth


@kernel()
def _find_open(
    mesh: Mesh, first_cluster: int, end_cluster: int, clusters: Clusters, layers: np.ndarray, polygon: np.ndarray,
    box: np.ndarray, order: np.ndarray, first: int,
) -> int:  # fmt: skip
    """Write the triangles of some clusters that images do not hide into `order`, from place `first` on.

    polygon: (4, 2), box: (2, 3) float64 scratch. Returns the place after the last, -1 where one may touch the cell.
    """
    end = first
    for c in range(first_cluster, end_cluster):
        place_cluster(clusters, c, mesh.centre, mesh.half, box)
        if box_hidden(box[0], box[1], layers, False):
            continue
        for t in range(clusters.start[c], clusters.start[c + 1]):
            side = look(mesh, t)
            if side == TURNED:
                continue
            i, j, k = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
            if side == 0 and may_touch(mesh.q, i, j, k):
                return -1
            if not triangle_hidden(mesh.q, i, j, k, layers, polygon):
                order[end] = t
                end += 1
    return end


@kernel()
def _take_turn(
    scene: Scene, mesh: Mesh, room: Room, turns: Turns, k: int, drawable: int, most: int, hint: int
) -> tuple[int, int, int]:
    """Look at so many of the shafts of a drawable, and halve those that stay open.

    Args: as for `_look`; k: the drawable's number among the turns.

    Returns:
        (what becomes of the drawable: OPEN, CLOSED or SEEN; the shafts that were looked at; the next hint).
    """
    parts, shaft, order = room.parts, room.shaft, turns.order
    for number in range(1, most + 1):
        at = _take_first(parts, turns, k)
        t = order[(parts.first[at] + parts.last[at]) // 2]
        count, weight = _place(scene, order, parts, at, turns.looked[k] & 7, shaft)
        found, where = CLOSED, 0.0
        turned = (
            count == 3
            and scene.one_sided[drawable]
            and side_of(scene.vertices, scene.triangles, t, shaft.centre, shaft.half) < 0
        )
        if not turned:
            found, hint, where = _look(scene, mesh, room, count, drawable, t, weight, parts.whole[at], hint)
        turns.looked[k] += 1
        turns.open[k] += FOLLOWS * ((1.0 if found == OPEN else 0.0) - turns.open[k])
        other = _take(parts) if found == OPEN else -1
        if other >= 0:
            _halve(scene, order, parts, at, other, shaft, where)
            _append(parts, turns, k, at)
            _append(parts, turns, k, other)
            continue
        _give_back(parts, at)
        if found == CLOSED and turns.waiting[k]:
            continue
        _give_up(parts, turns, k)
        return found, number, hint
    return OPEN, most, hint


@allocating_kernel()
def decide(
    scene: Scene, mesh: Mesh, clusters: Clusters, layers: np.ndarray, room: Room, asked: Asked, lo: np.ndarray,
    hi: np.ndarray, effort: Effort, hidden: np.ndarray, proven: np.ndarray,
) -> int:  # fmt: skip
    """Decide of drawables that images leave undecided whether they are hidden or seen.

    Args:
        scene: of what is reported: it alone can stand before what is seen.
        layers: see `occludees`: parts that these hide are not looked at again.
        room: see `make_room`.
        lo, hi: (3,) float64 the cell, grid units.
        hidden, proven: (drawables,) bool, set to True where a drawable is surely hidden, or seen.

    Returns:
        The shafts that were looked at.
    """
    chosen, least_worth = asked.chosen, effort.least_worth
    n = len(chosen)
    counts = np.zeros(n, np.int64)
    for k in range(n):
        first, last = asked.first_cluster[chosen[k]], asked.first_cluster[chosen[k] + 1]
        counts[k] = clusters.start[last] - clusters.start[first]
    turns = Turns(
        np.full(n, -1, np.int32), np.full(n, -1, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n),
        np.empty(counts.sum(), np.int32),
    )  # fmt: skip
    _begin(scene, mesh, clusters, layers, room.parts, turns, asked, lo, hi, hidden)
    shafts, hint, staying = 0, -1, 0
    for k in range(n):
        if not hidden[chosen[k]] and not _hopeful(turns, k, counts[k], least_worth):
            staying += asked.triangles[chosen[k]]
    while shafts < effort.shafts and staying <= effort.allowed:
        k, best = -1, least_worth
        for other in range(n):
            if turns.waiting[other] > 0 and _worth(turns, other, counts[other]) > best:
                k, best = other, _worth(turns, other, counts[other])
        if k < 0:
            break
        most = min(TURN, effort.shafts - shafts)
        found, looked, hint = _take_turn(scene, mesh, room, turns, k, chosen[k], most, hint)
        shafts += looked
        if found == CLOSED:
            hidden[chosen[k]] = True
        elif not _hopeful(turns, k, counts[k], least_worth):
            staying += asked.triangles[chosen[k]]
        if found == SEEN:
            proven[chosen[k]] = True
    return shafts


@allocating_kernel(inline="always")
def _begin(
    scene: Scene, mesh: Mesh, clusters: Clusters, layers: np.ndarray, parts: Parts, turns: Turns, asked: Asked,
    lo: np.ndarray, hi: np.ndarray, hidden: np.ndarray,
) -> None:  # fmt: skip
    """Let one shaft of each drawable wait, from the whole cell to all that is open of it. Args: see `decide`."""
    polygon, box = np.empty((4, 2), np.float64), np.empty((2, 3), np.float64)
    _free_all(parts)
    begin = 0
    for k in range(len(asked.chosen)):
        drawable = asked.chosen[k]
        first, last = asked.first_cluster[drawable], asked.first_cluster[drawable + 1]
        end = _find_open(mesh, first, last, clusters, layers, polygon, box, turns.order, begin)
        if end == begin:
            hidden[drawable] = True
        at = _take(parts) if end > begin else -1
        if at < 0:
            continue
        for i in range(3):
            parts.v[at, i], parts.v[at, 3 + i] = lo[i], hi[i]
        parts.first[at], parts.last[at], parts.whole[at] = begin, end, True
        _box(scene, turns.order, parts, at)
        _append(parts, turns, k, at)
        begin = end
