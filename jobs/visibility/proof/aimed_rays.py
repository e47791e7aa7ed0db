"""Rays from points of a cell at points of drawables: a drawable that one of them surely meets first is proven visible.

A ray ends at a point well inside a triangle, given by its weights on the corners, so that it meets the triangle needs
no proof. What remains is that nothing of another drawable stands before that point, and that it is seen from the front
where backs are not drawn; both are claimed only with a margin some thousand times float64's rounding (`ray_tree`). So
exact arithmetic would say the same: what is called proven can be seen.

What can be seen through stands before nothing: it is left out of the scenes that rays are blocked in, and is looked at
as anything else is.

Only what is reported as visible must be looked at: what is hidden from the whole cell cannot stand before anything that
somebody in the cell sees.

Based on: aiming at what is not known to be seen, P. Wonka, M. Wimmer, K. Zhou, S. Maierhofer, G. Hesina, A. Reshetov:
Guided Visibility Sampling, SIGGRAPH 2006; the points are those of an additive recurrence (M. Roberts: The Unreasonable
Effectiveness of Quasirandom Sequences, 2018), the same for all drawables.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.surfaces.planes import plane_of
from jobs.visibility.surfaces.ray_tree import (
    MARGIN,
    SAME,
    STACK,
    Scene,
    edge_volumes,
    find_blocker,
    find_first,
    inverse,
    may_block,
    met_at,
    next_bundle,
)
from storage.base.kernels import allocating_kernel, kernel

#: Rays start this part of the cell's half extents inside its faces: what lies in the plane of a face stands before
#: those who look through it.
INSET = 2.0**-10
#: The least weight of a corner of the triangle that is looked at: the point is inside, not on an edge.
LEAST_WEIGHT = 1e-3
#: What `look` says where the point is seen, and where it is turned away or looked at along its plane.
SEEN, TURNED = -1, -2
#: Steps of the recurrence in six dimensions: powers of 1 / g with g^7 = g + 1.
STEPS = tuple(1.1127756842787055**-k for k in range(1, 7))


class Ray(NamedTuple):
    """A ray, and what it is followed in."""

    o: np.ndarray  # (3,) float64 where it starts, grid units
    d: np.ndarray  # (3,) float64 where it leads from there
    over: np.ndarray  # (3,) float64 scratch
    stack: np.ndarray  # (STACK,) int32 scratch


@allocating_kernel(inline="always")
def make_ray() -> Ray:
    """A ray to be filled in."""
    return Ray(np.empty(3), np.empty(3), np.empty(3), np.empty(STACK, np.int32))


@kernel(inline="always")
def spread(number: int, dimension: int) -> float:
    """A coordinate from 0 to 1 of a point of the recurrence."""
    place = 0.5 + (number + 1) * STEPS[dimension]
    return float(place - np.floor(place))


@kernel()
def look(scene: Scene, t: int, drawable: int, wa: float, wb: float, ray: Ray, last: int) -> int:
    """Whether a point of a triangle is surely seen from where a ray starts.

    Args:
        scene: of what may stand in the way.
        t: a triangle of `drawable`; wa, wb: the weights of its first corners, the third has the rest.
        ray: receives where it leads.
        last: a triangle that stands in the way perhaps, tried first; negative: none.

    Returns:
        SEEN, TURNED, or a triangle that may be in the way.
    """
    o, d, reach = ray.o, ray.d, 0.0
    for k in range(3):
        a = scene.vertices[scene.triangles[t, 0], k] - o[k]
        b = scene.vertices[scene.triangles[t, 1], k] - o[k]
        c = scene.vertices[scene.triangles[t, 2], k] - o[k]
        d[k] = wa * a + wb * b + (1.0 - wa - wb) * c
        reach = max(reach, abs(a), abs(b), abs(c))
    ahead, slack = facing(scene, t, o, reach)
    if abs(ahead) <= slack or (ahead > 0 and scene.one_sided[drawable]):
        return TURNED
    if last >= 0:
        backs_pass = scene.one_sided[scene.triangle_drawable[last]]
        if may_block(scene.vertices, scene.triangles, last, backs_pass, o, d, reach):
            return last
    return find_blocker(scene, drawable, o, d, reach, ray.over, ray.stack)


@kernel()
def facing(scene: Scene, t: int, o: np.ndarray, reach: float) -> tuple[float, float]:
    """How far o lies before a triangle's plane (negative: before its front), and what of that may be rounding.

    reach: the largest coordinate of the triangle's corners as seen from o.
    """
    x, y, z, nx, ny, nz = plane_of(scene.vertices, scene.triangles, t)
    ahead = nx * (x - o[0]) + ny * (y - o[1]) + nz * (z - o[2])
    return ahead, 3.0 * MARGIN * max(abs(nx), abs(ny), abs(nz)) * reach


@allocating_kernel()
def confirm(
    scene: Scene, chosen: np.ndarray, eyes: np.ndarray, half: np.ndarray, triangle: np.ndarray,
    pixel: np.ndarray, resolution: int, proven: np.ndarray,
) -> None:  # fmt: skip
    """Prove of drawables what item buffers show: a ray through a pixel of theirs.

    Args:
        scene: of what may stand in the way.
        chosen: (c,) int64 drawables to prove.
        eyes: (e, 3) float64 where the item buffers were drawn from, grid units; half: (3,) the cell's half extents.
        triangle: (e, drawables) int32 a triangle that is seen of each drawable, -1: none; pixel: (e, drawables) int32
            the pixel, (face * resolution + j) * resolution + i.
        proven: (drawables,) bool, set to True where a drawable is proven visible.
    """
    ray, towards = make_ray(), np.empty(3)
    for drawable in chosen:
        for e in range(len(eyes)):
            t = triangle[e, drawable]
            if t < 0:
                continue
            i = pixel[e, drawable] % resolution
            j = pixel[e, drawable] // resolution % resolution
            face = pixel[e, drawable] // (resolution * resolution)
            axis = face >> 1
            towards[axis] = -half[axis] if face & 1 else half[axis]
            towards[(axis + 1) % 3] = ((2 * i + 1) / resolution - 1.0) * half[(axis + 1) % 3]
            towards[(axis + 2) % 3] = ((2 * j + 1) / resolution - 1.0) * half[(axis + 2) % 3]
            ray.o[:] = eyes[e]
            wa, wb = where_met(scene, t, ray.o, towards)
            if look(scene, t, drawable, wa, wb, ray, -1) == SEEN:
                proven[drawable] = True
                break


@kernel()
def where_met(scene: Scene, t: int, o: np.ndarray, d: np.ndarray) -> tuple[float, float]:
    """Weights of a triangle's first two corners where a ray meets its plane, moved inside the triangle."""
    i0, i1, i2 = scene.triangles[t, 0], scene.triangles[t, 1], scene.triangles[t, 2]
    ax, ay, az = scene.vertices[i0, 0] - o[0], scene.vertices[i0, 1] - o[1], scene.vertices[i0, 2] - o[2]
    bx, by, bz = scene.vertices[i1, 0] - o[0], scene.vertices[i1, 1] - o[1], scene.vertices[i1, 2] - o[2]
    cx, cy, cz = scene.vertices[i2, 0] - o[0], scene.vertices[i2, 1] - o[1], scene.vertices[i2, 2] - o[2]
    va, vb, vc = edge_volumes(ax, ay, az, bx, by, bz, cx, cy, cz, d)
    if va + vb + vc < 0:
        va, vb, vc = -va, -vb, -vc
    whole = max(va, 0.0) + max(vb, 0.0) + max(vc, 0.0)
    if whole == 0:
        return 1.0 / 3.0, 1.0 / 3.0
    kept = 1.0 - 3.0 * LEAST_WEIGHT
    return LEAST_WEIGHT + kept * max(va, 0.0) / whole, LEAST_WEIGHT + kept * max(vb, 0.0) / whole


@kernel(inline="always")
def start_of(number: int, lo: np.ndarray, hi: np.ndarray, o: np.ndarray) -> None:
    """The start (3,) of a ray: the eight corners of the cell in turn, every other time any point of its surface."""
    for k in range(3):
        part = spread(number, 3 + k) * (1.0 - INSET) + 0.5 * INSET
        if number % 2 == 0:
            part = 1.0 - 0.5 * INSET if (number >> 1) >> k & 1 else 0.5 * INSET
        elif (number >> 1) % 3 == k:
            part = 1.0 - 0.5 * INSET if part > 0.5 else 0.5 * INSET
        o[k] = lo[k] + (hi[k] - lo[k]) * part


@allocating_kernel()
def aim(
    scene: Scene, chosen: np.ndarray, first: np.ndarray, lo: np.ndarray, hi: np.ndarray,
    begin: int, end: int, proven: np.ndarray,
) -> None:  # fmt: skip
    """Rays from all over the cell's surface at all parts of some drawables.

    Args:
        scene: of what may stand in the way.
        chosen: (c,) int64 drawables to prove.
        first: (drawables + 1,) int32 offsets of the drawables' triangles.
        lo, hi: (3,) float64 the cell in grid units.
        begin, end: the numbers of the rays at each drawable, end - begin at most: others are other rays.
        proven: (drawables,) bool, set to True where a drawable is proven visible.
    """
    _aim(scene, chosen, first, lo, hi, begin, end, make_ray(), proven)


@kernel()
def _aim(
    scene: Scene, chosen: np.ndarray, first: np.ndarray, lo: np.ndarray, hi: np.ndarray, begin: int, end: int,
    ray: Ray, proven: np.ndarray,
) -> None:  # fmt: skip
    """See `aim`; ray: scratch."""
    for drawable in chosen:
        count = first[drawable + 1] - first[drawable]
        if count == 0:
            continue
        last = -1
        for number in range(begin, end):
            t = first[drawable] + int(spread(number, 0) * count)
            root = np.sqrt(spread(number, 1))
            kept = 1.0 - 3.0 * LEAST_WEIGHT
            wa = LEAST_WEIGHT + kept * (1.0 - root)
            wb = LEAST_WEIGHT + kept * root * spread(number, 2)
            start_of(number, lo, hi, ray.o)
            found = look(scene, t, drawable, wa, wb, ray, last)
            if found == SEEN:
                proven[drawable] = True
                break
            if found != TURNED:
                last = found


@allocating_kernel()
def scatter(
    scene: Scene, panes: Scene, lo: np.ndarray, hi: np.ndarray, rays: int, seen: np.ndarray,
    proven: np.ndarray,
) -> None:  # fmt: skip
    """Rays from all over the cell's surface in all directions, through what can be seen through.

    Args:
        scene: of all that hides what is behind it; panes: of all that can be seen through.
        lo, hi: (3,) float64 the cell in grid units.
        rays: how many.
        seen: (drawables,) bool, set to True where a ray meets a drawable first, or on its way to what it meets first.
        proven: (drawables,) bool, set to True where that is proven.
    """
    ray, towards, over, stack = make_ray(), np.empty(3), np.empty(3), np.empty(STACK, np.int32)
    for number in range(rays):
        start_of(number, lo, hi, ray.o)
        for k in range(3):
            towards[k] = 2.0 * spread(number, k) - 1.0
        t, until = find_first(scene, ray.o, towards, ray.over, ray.stack)
        if t >= 0:
            _note(scene, t, towards, ray, seen, proven)
        inverse(towards, over)
        stack[0] = 0
        c, count = next_bundle(panes, ray.o, over, until, stack, min(len(panes.child), 1))
        while c >= 0:
            for t in range(panes.bundle_start[c], panes.bundle_start[c + 1]):
                one_sided = panes.one_sided[panes.triangle_drawable[t]]
                if 0 < met_at(panes, t, one_sided, ray.o, towards) < until:
                    _note(scene, t, towards, ray, seen, proven)
            c, count = next_bundle(panes, ray.o, over, until, stack, count)


@kernel()
def _note(scene: Scene, t: int, towards: np.ndarray, ray: Ray, seen: np.ndarray, proven: np.ndarray) -> None:
    """Triangle t is seen where it is met on the way towards (3,) from ray.o; see `scatter`."""
    drawable = scene.triangle_drawable[t]
    seen[drawable] = True
    if not proven[drawable]:
        wa, wb = where_met(scene, t, ray.o, towards)
        if look(scene, t, drawable, wa, wb, ray, -1) == SEEN:
            proven[drawable] = True


@allocating_kernel()
def count_misses(
    scene: Scene,
    drawn: Scene,
    panes: Scene,
    drawable_drawn: np.ndarray,
    starts: np.ndarray,
    directions: np.ndarray,
) -> int:
    """How many rays meet first what is not drawn, or on the way to what they meet first.

    Args:
        scene: of all that hides what is behind it; drawn: of what is drawn of it; drawable_drawn: (drawables,) bool the
            same.
        panes: of what can be seen through and is not drawn.
        starts: (n, 3) float64 grid units; directions: (n, 3) float64.
    """
    over = np.empty(3)
    stack = np.empty(STACK, np.int32)
    missed = 0
    for number in range(len(starts)):
        o, d = starts[number], directions[number]
        t, at = find_first(scene, o, d, over, stack)
        if t >= 0 and not drawable_drawn[scene.triangle_drawable[t]]:
            # what lies in the very same place is drawn in its stead
            other, also = find_first(drawn, o, d, over, stack)
            if other < 0 or also > at * (1.0 + SAME):
                missed += 1
                continue
        pane, before = find_first(panes, o, d, over, stack)
        if pane >= 0 and before < at * (1.0 - SAME):
            missed += 1
    return missed
