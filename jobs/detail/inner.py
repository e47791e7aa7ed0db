"""Inner nodes: one surface in place of those that the children offer, with a certified error against the model.

The children's surfaces are put together and welded where they touch, locks between them fall, and what results is
simplified to half of its triangles. Where collapsing edges of disjoint things cannot do that, vertices are first joined
on a grid that grows until it can: topology changes, and things melt together. What vanishes then is smaller than a cell
of the grid, and something is left in its cell: the error covers its whole extent.

Based on: C. Erikson, D. Manocha, GAPS: General and Automatic Polygonal Simplification, I3D 1999; C. Erikson,
D. Manocha, W. V. Baxter, HLODs for Faster Display of Large Static and Dynamic Environments, I3D 2001; J. Rossignac,
P. Borrel, Multi-resolution 3D Approximations for Rendering Complex Scenes, 1993 (vertices joined on a grid);
W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, section 4.3 (one node and its children in memory at a time).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jobs.detail.borders import same_places
from jobs.detail.closest import make_surface
from jobs.detail.collapse import begin, collapse, snapshot
from jobs.detail.hausdorff import hausdorff_bound
from jobs.detail.levels import FLOOR_STEPS, ROUNDING, ROUNDING_STEPS, SLACK, CoarseLevel, Mesh, tidy
from jobs.detail.node import Finest, Level, Locks, Node, Offer, dressed
from jobs.detail.normal_cone import face_normals
from jobs.objects.components import components, outward_closed
from jobs.objects.weld import is_degenerate, twins, weld
from storage.kernels import allocating_kernel

#: Triangles asked for, as a part of what the children offer.
SHARE = 0.5
#: A result with at most this part of the triangles is taken.
ENOUGH = 0.65
#: Where fewer things than this part of the triangles are asked for, joining them saves little: 1 over that part.
FEW_THINGS = 16
#: Where collapses alone cannot do it, the error that is sought begins at this part of the mean edge ...
FIRST_GRID = 0.5
#: ... and is varied by this factor.
STEP = 1.6
#: Cells of the grid on which things melt together, in parts of the allowed error.
CELL = 0.7
#: What a node adds to its children's error is not measured more closely than this part of it.
NEGLIGIBLE = 0.1
#: An inner node has at most this many levels, and no more once one's error is this many times the first one's: above
#: that its parent is as good.
MOST_LEVELS = 3
LARGEST_STEP = 8.0
#: Nodes with fewer triangles than this are not simplified further: they keep what the children offer.
FEWEST = 8


class Simplified(NamedTuple):
    """A mesh with fewer triangles."""

    mesh: Mesh
    source: np.ndarray  # (m,) int32: what each triangle was before
    outward: bool  # still closed and wound outward


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
    worst = max(offers[0].error for offers in children)
    taken = [[offer for offer in offers if offer.error <= worst][-1] for offers in children]
    points, triangles, colours = _together(taken)
    locks = Locks(*(np.concatenate([getattr(offer.locks, name) for offer in taken]) for name in Locks._fields))
    locks = locks.outside(first, last)
    mesh = Mesh(points, triangles, twins(triangles))
    outward = (
        all(offer.outward for offer in taken)
        and len(locks.points) == 0
        and bool(outward_closed(*mesh, np.array([0, len(triangles)]))[0])
    )
    surface = make_surface(points.astype(np.float64), triangles)
    error = worst
    levels: list[Level] = []
    offers: list[Offer] = []
    while top or not levels or (len(levels) < MOST_LEVELS and error <= LARGEST_STEP * offers[0].error):
        locked = np.flatnonzero(same_places(mesh.points, locks.points)).astype(np.int32)
        simplified = _simplified(mesh, colours, locked, outward)
        if simplified is None and levels:
            break
        every = np.arange(len(mesh.triangles), dtype=np.int32)
        coarser, source, outward = simplified or Simplified(mesh, every, outward)
        coarse = make_surface(coarser.points.astype(np.float64), coarser.triangles)
        if simplified is not None:
            bound, _ = hausdorff_bound(coarse, surface, 0.0, max(NEGLIGIBLE * error, FLOOR_STEPS), SLACK)
            error += bound
        error = error * (1.0 + ROUNDING) + ROUNDING_STEPS
        held = np.flatnonzero(same_places(coarser.points, locks.points)).astype(np.int32)
        normals, _ = face_normals(mesh.points, mesh.triangles)
        shading = np.repeat(normals, 3, axis=0).astype(np.float32)
        before = Finest(surface, mesh.points, mesh.triangles, shading, colours)
        level, colours = dressed(CoarseLevel(coarser, source, coarse, held, error, outward), before, crease, scale)
        levels.append(level)
        offers.append(Offer(coarser.points, coarser.triangles, colours, error, outward, locks))
        mesh, surface = coarser, coarse
        if simplified is None:
            break
    return Inner(Node(scale, tuple(levels)), offers)


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
    """About half of the triangles; None where that cannot be."""
    m = len(mesh.triangles)
    if m < FEWEST:
        return None
    target, enough = int(SHARE * m), ENOUGH * m
    stays = _mask(len(mesh.points), locked)
    state = begin(*mesh, stays, colours)
    collapse(state, target, np.inf)
    found: Simplified | None = Simplified(*tidy(*snapshot(state), mesh, locked, outward))
    error = float(state.error[0])
    if found is not None and len(found.mesh.triangles) > enough:
        found = None
    _, things = components(mesh.triangles, len(mesh.points))
    if found is not None and things * FEW_THINGS < target:
        return found
    # Nothing connected vanishes by collapses, and they never join things: that melting does. The smallest error is
    # sought at which both together get there.
    extent = float((mesh.points.max(axis=0).astype(np.float64) - mesh.points.min(axis=0)).max())
    if found is None:
        corners = mesh.points[mesh.triangles].astype(np.float64)
        error = FIRST_GRID * float(np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2)).mean())
        while found is None and error <= extent:
            found = _melted(mesh, colours, locked, stays, error, target, enough)
            error *= STEP
        error /= STEP
    while found is not None and error > 1.0:
        error /= STEP
        better = _melted(mesh, colours, locked, stays, error, target, enough)
        if better is None:
            break
        found = better
    return found


def _melted(
    mesh: Mesh, colours: np.ndarray, locked: np.ndarray, stays: np.ndarray, error: float, target: int, enough: float
) -> Simplified | None:
    """The mesh with things melted together and edges collapsed, both within `error`; None where that is not enough."""
    melted, kept = melt(mesh.points, mesh.triangles, stays, CELL * error)
    own = np.ascontiguousarray(colours.reshape(-1, 3, 4)[kept].reshape(-1, 4))
    state = begin(mesh.points, melted, twins(melted), stays, own)
    collapse(state, target, error)
    points, triangles, source = snapshot(state)
    found = Simplified(*tidy(points, triangles, kept[source].astype(np.int32), mesh, locked, False))
    if len(found.mesh.triangles) <= enough and same_places(mesh.points[locked], found.mesh.points).all():
        return found
    return None


@allocating_kernel()
def melt(points: np.ndarray, triangles: np.ndarray, locked: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Join vertices on a grid: things that lie in common cells hang together, and what is smaller than a cell goes.

    points (n, 3) int32, triangles (m, 3) int32, locked (n,) bool. Of the things that lie in one cell with all of their
    triangles, one triangle stays if nothing else uses the cell: so nothing moves by more than a cell's diagonal.
    Returns triangles (k, 3) int32 over the same points, and which of the triangles they were (k,) int64.
    """
    m = len(triangles)
    into = joined_on_grid(points, locked, size)
    used = np.zeros(len(points), np.bool_)
    out = np.empty((m, 3), np.int32)
    kept = np.empty(m, np.int64)
    count = 0
    for t in range(m):
        a, b, c = into[triangles[t, 0]], into[triangles[t, 1]], into[triangles[t, 2]]
        if b not in (a, c) and a != c and not is_degenerate(points, a, b, c):
            out[count, 0], out[count, 1], out[count, 2] = a, b, c
            used[a] = used[b] = used[c] = True
            kept[count] = t
            count += 1
    for t in range(m):
        a, b, c = into[triangles[t, 0]], into[triangles[t, 1]], into[triangles[t, 2]]
        if used[a] or used[b] or used[c]:
            continue
        for e in range(3):
            out[count, e] = triangles[t, e]
        used[a] = used[b] = used[c] = True
        kept[count] = t
        count += 1
    return out[:count].copy(), kept[:count].copy()


def _mask(count: int, chosen: np.ndarray) -> np.ndarray:
    mask = np.zeros(count, np.bool_)
    mask[chosen] = True
    return mask


@allocating_kernel()
def joined_on_grid(points: np.ndarray, locked: np.ndarray, size: float) -> np.ndarray:
    """For each of points (n, 3) int32 the one that stands for it: that of its cell which is nearest to their mean.

    Locked ones (n,) bool stand for themselves, and for the others in their cell.
    """
    n = len(points)
    cells = np.empty((n, 3), np.int32)
    for i in range(n):
        for c in range(3):
            cells[i, c] = np.int32(np.floor(points[i, c] / size))
    ids, first = weld(cells, np.zeros(n, np.int32))
    mean = np.zeros((len(first), 3))
    count = np.zeros(len(first))
    for i in range(n):
        count[ids[i]] += 1
        for c in range(3):
            mean[ids[i], c] += points[i, c]
    best = np.full(len(first), np.inf)
    chosen = np.zeros(len(first), np.int32)
    for i in range(n):
        g = ids[i]
        d2 = 0.0
        for c in range(3):
            off = points[i, c] - mean[g, c] / count[g]
            d2 += off * off
        if locked[i]:
            d2 -= 1e30
        if d2 < best[g]:
            best[g] = d2
            chosen[g] = i
    into = np.empty(n, np.int32)
    for i in range(n):
        into[i] = i if locked[i] else chosen[ids[i]]
    return into
