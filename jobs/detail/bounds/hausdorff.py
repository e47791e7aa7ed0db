"""A certified upper bound of the two-sided Hausdorff distance between two triangle meshes.

The distance to one triangle K is convex, so over a convex polygon P it is largest in a corner of P: the largest corner
distance to any single K bounds how far P lies from the whole mesh. Triangles for which the best K near their corners
gives a bound above `slack` times the running lower bound (the largest distance found for any point) are bounded by what
covers them (`cover`), and those that nothing does are parted and tried again (`parting`).

Any partition gives a valid bound; choosing it well only makes it tight. Rounding enters only through the coordinates
of the cut points and of the closest points, less than 1e-13 of the meshes' size; callers add a margin for it.

Based on: N. Aspert, D. Santa-Cruz, T. Ebrahimi, MESH: Measuring errors between surfaces using the Hausdorff distance,
ICME 2002 (sampling, without bounds); M. Tang, M. Lee, Y. J. Kim, Interactive Hausdorff distance computation for general
polygonal models, SIGGRAPH 2009 (branch and bound).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.detail.bounds.closest import Surface, closest, distance2
from jobs.detail.bounds.cover import Cover, covered
from jobs.detail.bounds.parting import NEAR2, Parts, Wanted, bound_by_parts, enough2, make_parts, reached
from storage.base.kernels import allocating_kernel, kernel

#: Of the finer surface's points, one in so many is looked up to begin with.
SAMPLED = 8
#: Pieces tried per triangle, on average, before the bound need not be as close as was asked for.
EFFORT = 10


class Near(NamedTuple):
    """What is near a surface's points and triangles, as far as it was looked up."""

    nearest: np.ndarray  # (n,) int32: a triangle of the other surface near each point (see `point_distances`) or -1 ...
    squared: np.ndarray  # (n,) float64: ... and its squared distance
    below: np.ndarray  # (m,) int32: one near each triangle's centre, or -1


class Scratch(NamedTuple):
    """What a bound is worked out in."""

    parts: Parts
    cover: Cover  # of the other surface's triangles


@allocating_kernel()
def _nothing_near(a: Surface) -> Near:
    """Before anything was looked up."""
    n, m = len(a.points), len(a.triangles)
    return Near(np.full(n, -1, np.int32), np.empty(n), np.full(m, -1, np.int32))


@allocating_kernel()
def _make_scratch(b: Surface, parts: Parts) -> Scratch:
    """For bounds of distances from surface `b`."""
    m = len(b.triangles)
    return Scratch(parts, Cover(np.full(m, -1, np.int32), np.empty(m, np.int32), np.empty((2, 16, 3))))


@allocating_kernel()
def point_distances(points: np.ndarray, surface: Surface, lower2: float) -> tuple[np.ndarray, np.ndarray]:
    """The closest triangle (n,) int32 of `surface` to each of points (n, 3), and the squared distance (n,).

    Or some triangle that is nearer than the largest distance found so far, lower2 (squared) to begin with: the largest
    of all is exact in any case.
    """
    nearest, squared = np.empty(len(points), np.int32), np.empty(len(points))
    query = np.empty(128, np.int32)
    hint = 0
    for i in range(len(points)):
        hint, squared[i] = closest(surface.tree, query, points[i, 0], points[i, 1], points[i, 2], hint, NEAR2 * lower2)
        lower2 = max(lower2, squared[i])
        nearest[i] = hint
    return nearest, squared


@kernel()
def _corners2(points: np.ndarray, triangles: np.ndarray, t: int, frames: np.ndarray, k: int, most2: float) -> float:
    """The largest squared distance of triangle t's corners from triangle k of frames; or one that is above most2."""
    worst2 = 0.0
    for e in range(3):
        i = triangles[t, e]
        worst2 = max(worst2, distance2(frames, k, points[i, 0], points[i, 1], points[i, 2]))
        if worst2 > most2:
            break
    return worst2


@kernel()
def _reach2(points: np.ndarray, triangles: np.ndarray, squared: np.ndarray, t: int) -> float:
    """The largest squared distance of triangle t's points, by those of its corners: squared (n,)."""
    best = np.inf
    for e in range(3):
        i, j, k = triangles[t, e], triangles[t, (e + 1) % 3], triangles[t, (e + 2) % 3]
        far2 = 0.0
        for o in (j, k):
            x, y, z = points[o, 0] - points[i, 0], points[o, 1] - points[i, 1], points[o, 2] - points[i, 2]
            far2 = max(far2, x * x + y * y + z * z)
        best = min(best, np.sqrt(squared[i]) + np.sqrt(far2))
    return best * best


@kernel()
def _bound_whole(
    a: Surface, t: int, b: Surface, last: int, wanted: Wanted, near: Near, scratch: Scratch
) -> tuple[float, int, Wanted]:
    """Bound the squared distance of triangle t of `a` from surface `b`, without parting it.

    last: a triangle of `b` to try. Returns the squared bound, no good if it is above what is wanted; a triangle of `b`
    near t; what is wanted from now on.
    """
    tree, frames = b.tree, b.tree.frames
    points, triangles = a.points, a.triangles
    nearest, squared, below = near.nearest, near.squared, near.below
    query, seen, flood = scratch.parts.query, scratch.cover.seen, scratch.cover.queue
    limit2 = enough2(wanted)
    # most triangles lie above a single one, and often above the one that the last triangle lay above
    best2 = _corners2(points, triangles, t, frames, last, limit2)
    if best2 <= limit2:
        return best2, last, wanted
    for e in range(3):
        i = triangles[t, e]
        if nearest[i] < 0:
            last, squared[i] = closest(
                tree, query, points[i, 0], points[i, 1], points[i, 2], last, NEAR2 * wanted.lower2
            )
            nearest[i] = last
            wanted = reached(wanted, squared[i])
    limit2 = enough2(wanted)
    # where the error is large compared with the triangle, its size settles it: no point is farther from `b` than a
    # corner and the way from there
    best2 = _reach2(points, triangles, squared, t)
    start = last
    for attempt in range(3):
        if best2 <= limit2:
            return best2, start, wanted
        k = nearest[triangles[t, attempt]]
        worst2 = _corners2(points, triangles, t, frames, k, best2)
        if worst2 < best2:
            best2 = worst2
            start = k
    if best2 <= limit2:
        return best2, start, wanted
    if below[t] >= 0:
        start = below[t]
    else:
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        x, y, z = (
            (points[i, 0] + points[j, 0] + points[k, 0]) / 3.0,
            (points[i, 1] + points[j, 1] + points[k, 1]) / 3.0,
            (points[i, 2] + points[j, 2] + points[k, 2]) / 3.0,
        )
        start, d2 = closest(tree, query, x, y, z, start, NEAR2 * wanted.lower2)
        wanted = reached(wanted, d2)
    seen[start] = t
    flood[0] = start
    count = 1
    for e in range(3):
        k = nearest[triangles[t, e]]
        if seen[k] != t:
            seen[k] = t
            flood[count] = k
            count += 1
    limit = np.sqrt(enough2(wanted))
    best = covered(points, triangles[t], b, limit, scratch.cover, t, count)
    return best * best, start, wanted


@kernel()
def _bound(a: Surface, b: Surface, wanted: Wanted, near: Near, scratch: Scratch) -> tuple[float, Wanted]:
    """Bound the largest squared distance of any point of `a` to `b`; and what is wanted of further bounds."""
    bound2 = 0.0
    whole_effort = wanted.effort
    last = 0
    for t in range(len(a.triangles)):
        best2, last, wanted = _bound_whole(a, t, b, last, wanted, near, scratch)
        if best2 > enough2(wanted):
            best2, wanted = bound_by_parts(a.points, a.triangles, t, b, last, wanted, whole_effort, scratch.parts)
        bound2 = max(bound2, best2)
    return bound2, wanted


@allocating_kernel()
def _centres(surface: Surface) -> np.ndarray:
    """The centre (m, 3) of each triangle."""
    centres = np.zeros((len(surface.triangles), 3))
    for t in range(len(centres)):
        for e in range(3):
            for c in range(3):
                centres[t, c] += surface.points[surface.triangles[t, e], c] / 3.0
    return centres


@allocating_kernel()
def hausdorff_bound(a: Surface, b: Surface, lower: float, floor: float, slack: float) -> tuple[float, float]:
    """An upper bound of the two-sided Hausdorff distance between two surfaces, and the lower bound that was found.

    The result is at most `slack` (> 1) times the true distance or `floor`, whichever is larger, unless the meshes are
    so hard that the effort ran out. `lower` is a distance known to be reached, 0 if none is.
    """
    # where the coarser surface's triangles' centres and some of the finer one's points lie tells how far it is to go
    coarse, fine = (a, b) if len(a.triangles) < len(b.triangles) else (b, a)
    near_fine, near_coarse = _nothing_near(fine), _nothing_near(coarse)
    near_coarse.below[:], apart = point_distances(_centres(coarse), fine, lower * lower)
    lower2 = max(lower * lower, apart.max())
    near_fine.nearest[::SAMPLED], apart = point_distances(fine.points[::SAMPLED], coarse, lower2)
    near_fine.squared[::SAMPLED] = apart
    lower2 = max(lower2, apart.max())
    effort = EFFORT * (len(a.triangles) + len(b.triangles)) + 1000
    wanted = Wanted(lower2, slack * slack, floor * floor, 1.0, effort)
    parts = make_parts()
    there2, wanted = _bound(fine, coarse, wanted, near_fine, _make_scratch(coarse, parts))
    wanted = Wanted(wanted.lower2, slack * slack, floor * floor, 1.0, effort)
    back2, wanted = _bound(coarse, fine, wanted, near_coarse, _make_scratch(fine, parts))
    return np.sqrt(max(there2, back2)), np.sqrt(wanted.lower2)


@allocating_kernel()
def one_sided_bound(a: Surface, b: Surface, floor: float, slack: float) -> float:
    """An upper bound of the largest distance of any point of `a` to `b`: see `hausdorff_bound`."""
    effort = EFFORT * (len(a.triangles) + len(b.triangles)) + 1000
    wanted = Wanted(0.0, slack * slack, floor * floor, 1.0, effort)
    bound2, _ = _bound(a, b, wanted, _nothing_near(a), _make_scratch(b, make_parts()))
    return np.sqrt(bound2)
