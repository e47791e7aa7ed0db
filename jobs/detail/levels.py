"""The chain of coarser levels of one piece, each with its certified error against the finest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.detail.borders import border_kept, indices_of
from jobs.detail.closest import Surface, make_surface
from jobs.detail.hausdorff import hausdorff_bound, probe
from jobs.detail.simplify import coarser
from jobs.objects.components import outward_closed
from jobs.objects.weld import NON_MANIFOLD, twins

#: A level must have at most this part of the triangles of the one before.
SHRINK = 0.75
#: Parts of the triangles to ask for: the later ones where the first leaves a closed object open.
SHARES = (0.5, 0.6, 0.7)
#: A level this many times larger than asked for is the last: nothing more can be collapsed.
STUCK = 1.1
#: Pieces and levels with fewer triangles than this are not simplified further.
FEWEST = 16
#: Bounds are refined until they are at most this times the distance that is known to be reached.
SLACK = 1.25
#: Bounds below this many grid steps are good enough.
FLOOR_STEPS = 4.0
#: A level is measured against a coarser one than the finest if that one's error is below this part of the distance ...
REFERENCE_SHARE = 0.25
#: ... or below this many grid steps, which is next to nothing.
REFERENCE_STEPS = 4.0
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


class CoarseLevel(NamedTuple):
    """A level below the finest, before normals and colours."""

    mesh: Mesh
    surface: Surface
    held: np.ndarray  # int32: the level's vertices that are the finest one's locked vertices, in their order
    error: float  # to the piece's original surface, in grid steps


class Chain(NamedTuple):
    """A piece's levels below the finest, and the finest one's surface."""

    finest: Surface
    levels: list[CoarseLevel]


def coarser_levels(finest: Mesh, error: float, locked: np.ndarray, split: bool, outward: bool) -> Chain:
    """Simplify again and again; errors increase strictly from `error`, the finest level's own, in grid steps.

    locked: vertices that the piece shares with others of its component. Where it is one of several (`split`), border
    edges stay in every level. Where its component is closed and wound outward, so is every level (with its neighbours).
    """
    extent = finest.points.max(axis=0).astype(np.float64) - finest.points.min(axis=0)
    largest = LARGEST_ERROR * float(np.sqrt((extent * extent).sum()))
    surfaces = [make_surface(finest.points.astype(np.float64), finest.triangles)]
    errors = [error]
    levels: list[CoarseLevel] = []
    mesh, held = finest, locked
    stuck = False
    while len(mesh.triangles) >= FEWEST and not stuck:
        found = None
        for share in SHARES if outward else SHARES[:1]:
            target = int(share * len(mesh.triangles))
            points, triangles = coarser(mesh.points, mesh.triangles, mesh.twin, held, target, outward)
            stuck = len(triangles) > STUCK * target
            if not 0 < len(triangles) <= SHRINK * len(mesh.triangles):
                break
            candidate = Mesh(points, triangles, twins(triangles))
            if _keeps_promises(finest, candidate, locked, split, outward):
                found = candidate
                break
        if found is None:
            break
        mesh = found
        surface = make_surface(mesh.points.astype(np.float64), mesh.triangles)
        reached = probe(surface, surfaces[0])
        allowed = max(REFERENCE_SHARE * reached, REFERENCE_STEPS)
        base = max(i for i in range(len(errors)) if i == 0 or errors[i] <= allowed)
        bound, _ = hausdorff_bound(surface, surfaces[base], 0.0, max(errors[-1] - errors[base], FLOOR_STEPS), SLACK)
        total = (bound + errors[base]) * (1.0 + ROUNDING) + ROUNDING_STEPS
        total = max(total, errors[-1] * (1.0 + 1e-6) + ROUNDING_STEPS)
        if total > largest:
            break
        errors.append(total)
        surfaces.append(surface)
        held = indices_of(mesh.points, finest.points[locked]) if split else locked
        levels.append(CoarseLevel(mesh, surface, held, total))
    return Chain(surfaces[0], levels)


def _keeps_promises(finest: Mesh, level: Mesh, locked: np.ndarray, split: bool, outward: bool) -> bool:
    """Whether a level keeps the border to the other pieces and, if the object is closed, leaves it closed."""
    points, triangles, twin = level
    if split and not border_kept(finest.points, finest.triangles, finest.twin, locked, points, triangles):
        return False
    if not outward:
        return True
    if split:  # given that the border's edges are all there, there must be no other unpaired ones
        return not (twin == NON_MANIFOLD).any() and int((twin < 0).sum()) == int((finest.twin < 0).sum())
    return bool(outward_closed(points, triangles, twin, np.array([0, len(triangles)]))[0])
