"""Inner nodes: one surface in place of those that the children offer, with a certified error against the model.

The children's surfaces are put together and welded where they touch, locks between them fall, and what results is
simplified to half of its triangles. Where there are many disjoint things, pairs of near vertices are collapsed as edges
are, in the same order: topology changes, and things grow together. Nothing ever vanishes without becoming part of
something else, and the error, measured afterwards, covers it.

Based on: C. Erikson, D. Manocha, GAPS: General and Automatic Polygonal Simplification, I3D 1999 (pairs as well as
edges); C. Erikson, D. Manocha, W. V. Baxter, HLODs for Faster Display of Large Static and Dynamic Environments, I3D
2001; W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, section 4.3 (one node and its children in memory at a time).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jobs.detail.bounds.closest import make_surface
from jobs.detail.bounds.coverage import make_things, shown_error
from jobs.detail.bounds.hausdorff import hausdorff_bound
from jobs.detail.collapsing.borders import border_kept, same_places
from jobs.detail.collapsing.collapse import NO_PAIRS, begin
from jobs.detail.collapsing.face_normals import face_normals
from jobs.detail.collapsing.near_pairs import near_pairs
from jobs.detail.levels import FLOOR_STEPS, ROUNDING, ROUNDING_STEPS, SLACK, CoarseLevel, Mesh, Simplified, simplified
from jobs.detail.node import Finest, Level, Locks, Node, Offer, dressed, has_gradients
from jobs.objects.components import components, outward_closed
from jobs.objects.weld import OPEN, twins, weld
from storage.base.kernels import allocating_kernel

#: Triangles asked for, as a part of what the children offer.
SHARE = 0.5
#: A further level must have at most this part of the triangles of the one before.
ENOUGH = 0.65
#: Things are joined where so many times their number is more than the triangles that are asked for.
FEW_THINGS = 16
#: What a node adds to its children's error is not measured more closely than this part of it.
NEGLIGIBLE = 0.1
#: An inner node has at most this many levels, and no more once one's error is this many times the first one's: above
#: that its parent is as good.
MOST_LEVELS = 3
LARGEST_STEP = 8.0
#: Nodes with fewer triangles than this are not simplified further: they keep what the children offer.
FEWEST = 8


class Inner(NamedTuple):
    """An inner node and its offers, finest first."""

    node: Node
    offers: list[Offer]


def make_inner(
    children: Sequence[Sequence[Offer]], first: int, last: int, scale: float, crease: float, top: bool
) -> Inner:
    """The node above some children, whose leaves are first ... last, from what each of them offers, finest first.

    Of each child the coarsest offer is taken that is no worse than the best one of the child that needs it most.
    scale: of the model's grid; crease: cosine of the sharpest angle that is smoothed; top: there is nothing above.
    """
    most = max(_shown(offers[0]) for offers in children)
    taken = [[offer for offer in offers if _shown(offer) <= most][-1] for offers in children]
    worst, lost = max(offer.error for offer in taken), max(offer.lost for offer in taken)
    points, triangles, colours = _together(taken)
    locks = Locks(*(np.concatenate([getattr(offer.locks, name) for offer in taken]) for name in Locks._fields))
    locks = locks.outside(first, last)
    mesh = Mesh(points, triangles, twins(triangles))
    locked = np.flatnonzero(same_places(mesh.points, locks.points)).astype(np.int32)
    outward = all(offer.outward for offer in taken) and _closed(mesh, locked)
    given = surface = make_surface(points.astype(np.float64), triangles, mesh.twin)
    error, shown = worst, 0.0
    levels: list[Level] = []
    offers: list[Offer] = []
    while top or not levels or (len(levels) < MOST_LEVELS and error <= LARGEST_STEP * offers[0].error):
        fewer = _simplified(mesh, colours, locked, outward)
        if levels and (fewer is None or len(fewer.mesh.triangles) > ENOUGH * len(mesh.triangles)):
            break
        every = np.arange(len(mesh.triangles), dtype=np.int32)
        coarser, source, outward, width = fewer or Simplified(mesh, every, outward, 0.0)
        coarse = make_surface(coarser.points.astype(np.float64), coarser.triangles, coarser.twin)
        if fewer is not None:
            bound, _ = hausdorff_bound(coarse, given, 0.0, max(NEGLIGIBLE * error, FLOOR_STEPS), SLACK)
            error = max(error, worst + bound)
        error = error * (1.0 + ROUNDING) + ROUNDING_STEPS
        lost = max(lost, width)
        shown = max(shown_error(error, lost), shown * (1.0 + ROUNDING) + ROUNDING_STEPS)
        held = np.flatnonzero(same_places(coarser.points, mesh.points[locked])).astype(np.int32)
        shading = np.empty((0, 3), np.float32)
        if len(held):
            shading = np.repeat(face_normals(mesh.points, mesh.triangles)[0], 3, axis=0).astype(np.float32)
        before = Finest(surface, mesh.points, mesh.triangles, shading, colours, has_gradients(colours))
        made = CoarseLevel(coarser, source, coarse, held, error, lost, shown, outward)
        level, colours = dressed(made, before, crease, scale)
        levels.append(level)
        offers.append(Offer(coarser.points, coarser.triangles, colours, error, lost, outward, locks))
        mesh, surface, locked = coarser, coarse, held
        if fewer is None:
            break
    return Inner(Node(scale, tuple(levels)), offers)


def _shown(offer: Offer) -> float:
    """From which error on an offer may be shown."""
    return shown_error(offer.error, offer.lost)


def _together(children: Sequence[Offer]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The children's points (n, 3) int32, welded, triangles (m, 3) int32 and corners' colours (3 m, 4)."""
    starts = np.cumsum([0, *(len(child.points) for child in children)])
    points = np.concatenate([child.points for child in children])
    ids, first = weld(points, np.zeros(len(points), np.int32))
    triangles = np.concatenate(
        [child.triangles + np.int32(start) for child, start in zip(children, starts[:-1], strict=True)]
    )
    return points[first], np.ascontiguousarray(ids[triangles]), np.concatenate([child.colours for child in children])


def _simplified(mesh: Mesh, colours: np.ndarray, locked: np.ndarray, outward: bool) -> Simplified | None:
    """About half of the triangles, or as few as locked vertices allow; None where that is all of them."""
    m = len(mesh.triangles)
    if m < FEWEST:
        return None
    target = int(SHARE * m)
    stays = _mask(len(mesh.points), locked)
    label, things = components(mesh.triangles, len(mesh.points))
    joins = things > 1 and things * FEW_THINGS >= target
    pairs = near_pairs(mesh.points, mesh.triangles, label) if joins else NO_PAIRS
    found = _reduced(mesh, stays, colours, pairs, target, len(locked), outward and not joins, label, things)
    if found.outward and len(locked) and not border_kept(*mesh, locked, found.mesh.points, found.mesh.triangles):
        found = found._replace(outward=False)
    return found if len(found.mesh.triangles) < m else None


@allocating_kernel()
def _reduced(
    mesh: Mesh, stays: np.ndarray, colours: np.ndarray, pairs: np.ndarray, target: int, locked: int, outward: bool,
    label: np.ndarray, count: int,
) -> Simplified:  # fmt: skip
    """See `begin`, `make_things` and `simplified`."""
    state = begin(mesh.points, mesh.triangles, mesh.twin, stays, colours, pairs)
    things = make_things(mesh.points, mesh.triangles, mesh.twin, label, count)
    return simplified(state, target, mesh.twin, locked, outward, things)


def _closed(mesh: Mesh, locked: np.ndarray) -> bool:
    """Whether surfaces that were wound outward are closed together, with what lies beyond the locked vertices."""
    if len(locked) == 0:
        return bool(outward_closed(*mesh, np.array([0, len(mesh.triangles)]))[0])
    stays = _mask(len(mesh.points), locked)
    border = np.flatnonzero(mesh.twin == OPEN)
    begin, end = mesh.triangles[border // 3, border % 3], mesh.triangles[border // 3, (border % 3 + 1) % 3]
    return bool((mesh.twin >= OPEN).all() and (stays[begin] & stays[end]).all())


def _mask(count: int, chosen: np.ndarray) -> np.ndarray:
    mask = np.zeros(count, np.bool_)
    mask[chosen] = True
    return mask
