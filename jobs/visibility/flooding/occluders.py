"""Flooded occluder sets, drawn into the depth buffers around a view cell.

Based on: J. Chhugani, B. Purnomo, S. Krishnan, J. Cohen, S. Venkatasubramanian, D. Johnson, S. Kumar: vLOD:
High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005, section 5.2 (occluder fusion seen from
one projection point inside the cell), with another way of shrinking: only past edges that can be silhouettes.

**What hides.** Only what cannot be seen through. Below, all triangles of a set S are opaque, and x is seen from p where
the segment between them crosses no opaque triangle; x may be a point of anything. What can be seen through has no side
(`seen_mesh.CLEAR`), so it is in no core and no set, and an edge that an opaque triangle shares with it alone is not
safe. Nothing else changes: S may be any set of opaque triangles, however many panes lie between them, and what lies in
front of x or behind it is no matter. As x, what can be seen through is looked at as all else.

**Safe edges.** For a triangle t and the cell V, its side (see `seen_mesh`) is +1 or -1 where V lies strictly on one
side of t's plane, else 0. orient3d(p, a, b, c) for an edge a-b of t and its third corner c is, up to the direction of
the edge, this side.
So an edge is safe for V and a set S of triangles that do not meet V if two of its triangles in S have opposite
side times direction: they lie strictly on opposite sides of the edge as seen from every p in V.

**Theorem.** Let x not lie on S, p0 in V, and the segment p0-x cross a triangle of S. If no point of an unsafe edge of S
lies in any triangle (p0, p, x) with p in V, then S hides x from all of V. *Proof.* Slide p away from p0 and count the
triangles of S that the segment p-x crosses. The count changes only where the segment passes over an edge: p never
touches S, and x is not on S. Past a safe edge the segment meets one of its two opposite triangles, so the count is at
least one; unsafe edges are never met; the count began at one or more. (Passing through a vertex is avoided by moving
p a little: an open segment that is free of S stays free nearby.)

So for one set S and one pixel: if a point of the pixel (its centre, but for rounding) lies in the image of a triangle
of S and no inflated unsafe edge touches the pixel (see `cube_faces`), then every x whose image lies in the pixel and
which is deeper than all triangles of S that touch the pixel is hidden. The whole pixel is covered, since coverage can
only end at an unsafe edge, whose image lies inside its inflated image. Results of any number of sets are united: the
nearest depth wins.

Each S is *flooded* from a small core, for the pixels whose centres the core covers: a safe edge is crossed only if its
inflated image touches these pixels' rectangle. Edges that do not cannot spoil a pixel in it, safe or not.

**Limits.** Inflation is less for occludees that are not far behind, so each pixel hides what is deeper than the set but
not deeper than a limit: the least depth at which an unsafe edge spoils the pixel (see `silhouettes`); see `layers` for
how the pixels of all sets are kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.flooding.flood import Flood, Flooded, Goal, Images, core_pixels, flood_from, grow_core
from jobs.visibility.flooding.front_to_back import Queue, begin_queue, make_queue, next_cluster
from jobs.visibility.flooding.seals import ROWS, Sealing, Seals, core_strips, flood_sealed
from jobs.visibility.images.cube_faces import Face, Pixels, window_of
from jobs.visibility.images.layers import add_layer, pixel_hides
from jobs.visibility.images.raster import LANES, draw_triangles
from jobs.visibility.images.silhouettes import lower_limits
from jobs.visibility.surfaces.clusters import Clusters
from jobs.visibility.surfaces.gaps import MOST
from jobs.visibility.surfaces.seen_mesh import Mesh, may_occlude
from storage.base.kernels import allocating_kernel, kernel

#: Marks are cleared once so many floods have been counted: they fit int32, whatever a cell adds.
MOST_EPOCHS = 1 << 30


class Canvas(NamedTuple):
    """The images on a face that a set is drawn in, and scratch."""

    limit: np.ndarray  # (r, r + LANES) float32 up to which depth a pixel hides
    inverse: np.ndarray  # (r, r + LANES) float32 one over the depth of the set in each pixel
    strips: np.ndarray  # as `inverse`, of the strips in gaps; none of these two where no gaps count as closed
    beyond: np.ndarray  # the same of the triangles that count only behind strips
    rows: np.ndarray  # (r, 2) int32 the first and the last pixel of each row whose limit is above 0
    polygon: np.ndarray  # (4, 2) float64


class Work(NamedTuple):
    """What occluders are drawn in, cell by cell. Epochs count floods and faces; they only grow."""

    epoch: np.ndarray  # (1,) int64 the last one
    cored: np.ndarray  # (m,) int32 the epoch of the last face on which a triangle belonged to a core
    core: np.ndarray  # (largest cluster,) int32
    flood: Flood  # those of its images that are known have the epoch of the face
    sealing: Sealing  # empty where no gaps count as closed
    in_order: np.ndarray  # (ROWS,) int32 0, 1, 2 ...; empty as well
    canvas: Canvas
    queue: Queue


def make_work(vertices: int, cluster_start: np.ndarray, largest_set: int, resolution: int, sealed: bool) -> Work:
    """What occluders are drawn in, for any number of cells.

    Args:
        vertices: how many; cluster_start: (k + 1,) int32.
        largest_set: most triangles in a flooded set.
        resolution: pixels along the edge of a face.
        sealed: whether gaps may count as closed.
    """
    m, r = int(cluster_start[-1]), resolution
    n, most, rows, side = (vertices, 3 * largest_set, ROWS, r) if sealed else (0, 0, 0, 0)
    flood = Flood(
        Images(np.zeros(vertices, np.int32), np.empty((vertices, 6), np.float64), np.empty(vertices, np.bool_)),
        np.zeros(m, np.int32), np.empty(largest_set, np.int32), np.empty(largest_set, np.int32),
        np.empty((3 * largest_set, 2), np.int32), np.empty((4, 4)),
    )  # fmt: skip
    sealing = Sealing(
        np.empty((most, 2), np.int32), np.zeros((n, 4), np.int32), np.empty((MOST, 2)), np.empty(MOST, np.int64),
        np.empty(rows, np.int64), np.empty((rows, 3), np.int32), np.empty(3),
    )  # fmt: skip
    canvas = Canvas(_image(r), _image(r), _image(side), _image(side), np.empty((r, 2), np.int32), np.empty((4, 2)))
    return Work(
        np.zeros(1, np.int64), np.zeros(m, np.int32), np.empty(int(np.diff(cluster_start).max(initial=0)), np.int32),
        flood, sealing, np.arange(rows, dtype=np.int32), canvas, make_queue(len(cluster_start) - 1),
    )  # fmt: skip


def _image(resolution: int) -> np.ndarray:
    return np.empty((resolution, resolution + LANES), np.float32)


@allocating_kernel()
def forget_marks(work: Work) -> None:
    """Clear the marks where so many floods have been counted that they would not fit soon."""
    if work.epoch[0] > MOST_EPOCHS:
        work.epoch[0] = 0
        work.cored[:] = 0
        work.flood.images.known[:] = 0
        work.flood.seen[:] = 0
        work.sealing.ends[:] = 0


@kernel()
def farthest_of(mesh: Mesh, lo: np.ndarray, hi: np.ndarray, places: np.ndarray) -> float:
    """How deep anything of the cut is on any face, in cell coordinates.

    Args:
        mesh: the triangles, as the cell sees them.
        lo, hi: (drawables, 3) float64 their boxes in grid units, lo > hi where a drawable has no triangles.
        places: (c,) int64 the drawables of the cut.
    """
    far = 0.0
    for d in places:
        if lo[d, 0] <= hi[d, 0]:
            for k in range(3):
                far = max(far, (mesh.centre[k] - lo[d, k]) / mesh.half[k], (hi[d, k] - mesh.centre[k]) / mesh.half[k])
    return far


@kernel()
def cover(
    mesh: Mesh,
    clusters: Clusters,
    work: Work,
    farthest: float,
    smallest_window: int,
    layers: np.ndarray,
    seals: Seals,
) -> tuple[int, int, int]:
    """Draw the occlusion of all triangles of the cut, nearest clusters first, into layers.

    Args:
        mesh: the triangles, as the cell sees them.
        clusters: of the triangles: the cores of the floods.
        work: see `make_work`.
        farthest: nothing is deeper, on any face; a value of float32.
        smallest_window: cores whose image has fewer pixels on a face are not tried there.
        layers: (6, r, r, k, 2) float32, cleared before; receives what is hidden, see `layers`.
        seals: gaps at which floods go on; where there are none, nothing is approximate. Else only sets that close some
            are drawn, and `mesh.q` has seals.ROWS rows more than there are vertices.

    Returns:
        (cores drawn, triangles flooded, pixels covered): counts for profiling.
    """
    core, cored, epoch, queue = work.core, work.cored, work.epoch, work.queue
    cores, flooded, covered = 0, 0, 0
    for number in range(6):
        face = Face(number, layers.shape[2], farthest)
        epoch[0] += 1
        mark = epoch[0]
        waiting = begin_queue(clusters, mesh, number, face.resolution, queue)
        while True:
            c, waiting = next_cluster(clusters, mesh, number, layers, queue, waiting)
            if c < 0:
                break
            first, last = clusters.start[c], clusters.start[c + 1]
            for seed in range(first, last):
                if cored[seed] >= mark or not may_occlude(mesh, seed):
                    continue
                n_core = grow_core(mesh, seed, first, last, mark, cored, core)
                n_core = min(n_core, work.flood.triangles.shape[0])
                strips, pixels, near = _draw_core(mesh, work, seals, core[:n_core], face, smallest_window, layers)
                if pixels.i0 > pixels.i1:
                    continue
                epoch[0] += 1
                goal = Goal(face, mark, epoch[0], window_of(pixels), max(near, 1.5))
                if seals.near.shape[0] > 0:
                    found = flood_sealed(mesh, work.flood, goal, core[:n_core], seals, work.sealing, strips)
                else:
                    found = flood_from(mesh, work.flood, goal, core[:n_core])
                flooded += found.size
                cores += 1
                if found.unsafe >= 0:
                    covered += _draw_set(mesh, work, found, face, pixels, layers)
    return cores, flooded, covered


@kernel(inline="always")
def _draw_core(
    mesh: Mesh,
    work: Work,
    seals: Seals,
    core: np.ndarray,
    face: Face,
    smallest_window: int,
    layers: np.ndarray,
) -> tuple[int, Pixels, float]:
    """Draw a core, (c,) int32 triangles, and the strips beside it where not all behind them is hidden yet.

    Returns:
        (triangles of the strips; around the pixels that they cover, none where it is not worth while; their nearest
        depth)
    """
    q, canvas, sealing = mesh.q, work.canvas, work.sealing
    found, pixels, near = core_pixels(q, mesh.triangles, core, face, canvas.polygon)
    n_strips = 0
    if seals.near.shape[0] > 0:
        n_strips = core_strips(mesh, seals, sealing, core, work.flood.seen)
    strips = work.in_order[:n_strips]
    beside, other, near_beside = core_pixels(q, sealing.strips, strips, face, canvas.polygon)
    if found and beside:
        pixels = Pixels(
            min(pixels.i0, other.i0), max(pixels.i1, other.i1), min(pixels.j0, other.j0), max(pixels.j1, other.j1)
        )
        near = min(near, near_beside)
    i0, i1, j0, j1 = pixels
    if (
        not found
        or (i1 - i0 + 1) * (j1 - j0 + 1) < smallest_window
        or not _open_pixels(layers, face, pixels, near, canvas)
    ):
        return n_strips, Pixels(0, -1, 0, -1), near
    draw_triangles(q, mesh.triangles, core, face, pixels, canvas.polygon, True, canvas.inverse, canvas.limit)
    draw_triangles(q, sealing.strips, strips, face, pixels, canvas.polygon, True, canvas.inverse, canvas.limit)
    return n_strips, _covered_pixels(pixels, canvas.limit), near


@kernel(inline="always")
def _draw_set(mesh: Mesh, work: Work, found: Flooded, face: Face, pixels: Pixels, layers: np.ndarray) -> int:
    """Draw what was flooded from a core, which is drawn, and add what it hides to the layers; in how many pixels."""
    q, triangles, drawn, canvas = mesh.q, mesh.triangles, work.flood.drawn, work.canvas
    limit, inverse, strips, beyond, rows = canvas.limit, canvas.inverse, canvas.strips, canvas.beyond, canvas.rows
    i0, i1, j0, j1 = pixels
    draw_triangles(q, triangles, drawn[: found.sure], face, pixels, canvas.polygon, False, inverse, limit)
    if found.strips > 0:
        _clear(strips, pixels)
        _clear(beyond, pixels)
        closing, unsure = work.in_order[: found.strips], drawn[found.sure : found.drawn]
        draw_triangles(q, work.sealing.strips, closing, face, pixels, canvas.polygon, False, strips, limit)
        draw_triangles(q, triangles, unsure, face, pixels, canvas.polygon, False, beyond, limit)
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                if strips[j, i] < np.inf:
                    inverse[j, i] = min(inverse[j, i], strips[j, i], beyond[j, i])
    if not lower_limits(q, work.flood.unsafe[: found.unsafe], face, pixels, work.flood.sweep, rows, inverse, limit):
        return 0
    count = 0
    for j in range(j0, j1 + 1):
        for i in range(rows[j, 0], rows[j, 1] + 1):
            if limit[j, i] > 0.0:
                count += 1
                all_depths = limit[j, i] >= face.farthest
                add_layer(layers, face.number, j, i, 1.0 / inverse[j, i], np.inf if all_depths else limit[j, i])
    return count


@kernel()
def _open_pixels(layers: np.ndarray, face: Face, pixels: Pixels, near: float, canvas: Canvas) -> bool:
    """Whether there are pixels where not all that is deeper than `near` is hidden yet.

    canvas: `inverse` receives infinity in the pixels; `limit` receives 0 in those that are open, -1 in the others.
    """
    found = False
    for j in range(pixels.j0, pixels.j1 + 1):
        for i in range(pixels.i0, pixels.i1 + 1):
            hidden = pixel_hides(layers, face.number, j, i, near, np.inf)
            canvas.limit[j, i] = -1.0 if hidden else 0.0
            canvas.inverse[j, i] = np.inf
            found |= not hidden
    return found


@kernel()
def _clear(inverse: np.ndarray, pixels: Pixels) -> None:
    """Nothing is drawn in some pixels of an image."""
    for j in range(pixels.j0, pixels.j1 + 1):
        for i in range(pixels.i0, pixels.i1 + 1):
            inverse[j, i] = np.inf


@kernel(inline="always")
def _covered_pixels(pixels: Pixels, limit: np.ndarray) -> Pixels:
    """The part of some pixels around those where `limit` is positive; none where there are none."""
    least_i, most_i, least_j, most_j = pixels.i1 + 1, pixels.i0 - 1, pixels.j1 + 1, pixels.j0 - 1
    for j in range(pixels.j0, pixels.j1 + 1):
        for i in range(pixels.i0, pixels.i1 + 1):
            if limit[j, i] > 0.0:
                least_i, most_i = min(least_i, i), max(most_i, i)
                least_j, most_j = min(least_j, j), max(most_j, j)
    return Pixels(least_i, most_i, least_j, most_j)
