"""The chain of coarser levels of one leaf, each with its certified error against the finest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.detail.bounds.closest import Surface, make_surface
from jobs.detail.bounds.coverage import Things, lost_width, make_things, shown_error, widen
from jobs.detail.bounds.hausdorff import hausdorff_bound
from jobs.detail.collapsing.borders import border_kept, same_places
from jobs.detail.collapsing.clean import cleaned
from jobs.detail.collapsing.collapse import NO_PAIRS, State, begin, collapse, snapshot
from jobs.objects.components import components, outward_closed
from jobs.objects.weld import NON_MANIFOLD, twins
from storage.base.kernels import allocating_kernel

#: Triangles of each level, as a part of those of the one before.
SHARE = 0.5
#: A level must have at most this part of the triangles of the one before.
SHRINK = 0.75
#: Nodes and levels with fewer triangles than this are not simplified further.
FEWEST = 8
#: Bounds are refined until they are at most this times the distance that is known to be reached.
SLACK = 1.25
#: Bounds below this many grid steps are good enough.
FLOOR_STEPS = 4.0
#: What rounding may have done to a bound: absolute, in grid steps, and relative.
ROUNDING_STEPS = 1e-4
ROUNDING = 1e-9
#: A level whose error is above this part of the piece's diagonal stands for nothing any more.
LARGEST_ERROR = 0.5


class Mesh(NamedTuple):
    """A mesh on the grid with welded vertices."""

    points: np.ndarray  # (n, 3) int32
    triangles: np.ndarray  # (m, 3) int32
    twin: np.ndarray  # (3 m,) int32


class Simplified(NamedTuple):
    """A mesh with fewer triangles."""

    mesh: Mesh
    source: np.ndarray  # (m,) int32: what each triangle was before
    outward: bool  # still closed (with what lies beyond locked borders) and wound outward
    lost: float  # largest width of a thing that is lost, in grid steps: see `bounds.coverage`


class CoarseLevel(NamedTuple):
    """A level below the finest, before normals and colours."""

    mesh: Mesh
    source: np.ndarray  # (m,) int32: triangle that each one was in what it was made from
    surface: Surface
    held: np.ndarray  # int32: the level's vertices that lie where the finest one has locked vertices
    error: float  # to the leaf's original surface, in grid steps
    lost: float  # largest width of a thing of it that is lost, in grid steps
    shown: float  # from which error on it may be shown, in grid steps
    outward: bool  # closed (with what lies beyond locked borders) and wound outward


class Chain(NamedTuple):
    """A leaf's levels below the finest, and the finest one's surface."""

    finest: Surface
    levels: list[CoarseLevel]


def coarser_levels(
    finest: Mesh, colours: np.ndarray, error: float, locked: np.ndarray, outward: bool, most: int
) -> Chain:
    """Simplify again and again, at most `most` times; errors increase strictly from `error`, the finest level's own.

    So do those from which on levels may be shown.

    error: in grid steps; colours (3 m, 4) uint8 of the corners: where they change, edges are kept as borders are;
    locked: vertices that stay, with the border edges between them; outward: closed (with what lies beyond these) and
    wound outward.
    """
    extent = finest.points.max(axis=0).astype(np.float64) - finest.points.min(axis=0)
    largest = LARGEST_ERROR * float(np.sqrt((extent * extent).sum()))
    original = make_surface(finest.points.astype(np.float64), finest.triangles, finest.twin)
    things = things_of(finest)
    reached = shown = error
    lost = 0.0
    levels: list[CoarseLevel] = []
    places = finest.points[locked]
    stays = np.zeros(len(finest.points), np.bool_)
    stays[locked] = True
    state = begin(finest.points, finest.triangles, finest.twin, stays, colours, NO_PAIRS)
    before = len(finest.triangles)
    while before >= FEWEST and len(levels) < most:
        mesh, source, closed, width = simplified(state, int(SHARE * before), finest.twin, len(locked), outward, things)
        if not 0 < len(mesh.triangles) <= SHRINK * before:
            break
        if len(locked) and not border_kept(*finest, locked, mesh.points, mesh.triangles):
            break
        before = len(mesh.triangles)
        surface = make_surface(mesh.points.astype(np.float64), mesh.triangles, mesh.twin)
        bound, _ = hausdorff_bound(surface, original, 0.0, max(reached - error, FLOOR_STEPS), SLACK)
        total = (bound + error) * (1.0 + ROUNDING) + ROUNDING_STEPS
        reached = max(total, reached * (1.0 + 1e-6) + ROUNDING_STEPS)
        if reached > largest:
            break
        lost = max(lost, width)
        shown = max(shown_error(reached, lost), shown * (1.0 + 1e-6) + ROUNDING_STEPS)
        held = np.flatnonzero(same_places(mesh.points, places)).astype(np.int32)
        levels.append(CoarseLevel(mesh, source, surface, held, reached, lost, shown, closed))
    return Chain(original, levels)


@allocating_kernel()
def things_of(mesh: Mesh) -> Things:
    """The connected things of a mesh."""
    label, count = components(mesh.triangles, len(mesh.points))
    return make_things(mesh.points, mesh.triangles, mesh.twin, label, count)


@allocating_kernel()
def simplified(state: State, target: int, twin: np.ndarray, locked: int, outward: bool, things: Things) -> Simplified:
    """Collapse edges until at most `target` triangles are left, or none may be collapsed any more; and tidy up.

    What has no area or is there twice is left out. twin: of what the state was begun with, `locked` vertices of which
    stay; outward: whether that was closed (with what lies beyond the locked vertices) and wound outward; things: the
    connected things of it, from `things_of`. Where the
    result is not, its triangles are seen from both sides, and one of two that are back to back suffices.
    """
    collapse(state, target, np.inf)
    points, triangles, source, reach = snapshot(state)
    widen(things, points, triangles, source, reach)
    lost = lost_width(things, points, triangles, source)
    if outward:
        kept_points, kept, which = cleaned(points, triangles, True)
        paired = twins(kept)
        if locked:  # given that the border's edges are all there, there must be no other unpaired ones
            same = (paired < 0).sum() == (twin < 0).sum() and not (paired == NON_MANIFOLD).any()
        else:
            same = outward_closed(kept_points, kept, paired, np.array([0, len(kept)]))[0]
        if same:
            return Simplified(Mesh(kept_points, kept, paired), source[which], True, lost)
    kept_points, kept, which = cleaned(points, triangles, False)
    return Simplified(Mesh(kept_points, kept, twins(kept)), source[which], False, lost)
