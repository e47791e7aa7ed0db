"""Which boxes and triangles are hidden behind the layers that `occluders` has drawn.

An occludee is hidden if each pixel of each cube face that its image touches (rounded outward) has a layer in front of
the occludee's nearest depth there whose limit is not below its farthest depth there. Rounding is always towards
"visible": depths must be strictly less, by more than float32's rounding, so that nothing hides itself. What is rounded
is monotone, so a box is hidden wherever one around it is: whoever finds a node of a tree hidden need not look below it.
"""

from __future__ import annotations

import numpy as np

from jobs.visibility.images.cube_faces import (
    PLANE,
    box_on_face,
    clip_triangle,
    inverse_depth_plane,
    strip_extent,
)
from jobs.visibility.images.layers import pixel_hides
from jobs.visibility.surfaces.clusters import Clusters, place_node
from jobs.visibility.surfaces.ray_tree import STACK
from jobs.visibility.surfaces.seen_mesh import TURNED, Mesh, look
from storage.base.kernels import allocating_kernel, kernel

#: An occludee's nearest depth is rounded down by this factor before it is compared.
DEPTH_DOWN = 1.0 - 5e-7


@kernel()
def box_hidden(lo: np.ndarray, hi: np.ndarray, layers: np.ndarray, at_all_depths: bool) -> bool:
    """Whether a box is hidden from the whole cell.

    Args:
        lo, hi: (3,) float64 the box in cell coordinates.
        layers: (6, r, r, k, 2) float32, see `layers`.
        at_all_depths: whether everything behind the box, however deep, is hidden too.

    Returns:
        False where the box touches the cell.
    """
    if (
        lo[0] <= 1.0 and lo[1] <= 1.0 and lo[2] <= 1.0
        and hi[0] >= -1.0 and hi[1] >= -1.0 and hi[2] >= -1.0
    ):  # fmt: skip
        return False
    for face in range(6):
        if not box_hidden_on(face, lo, hi, layers, at_all_depths):
            return False
    return True


@kernel()
def box_hidden_on(face: int, lo: np.ndarray, hi: np.ndarray, layers: np.ndarray, at_all_depths: bool) -> bool:
    """Whether the part of a box inside one face's pyramid and outside the cell is hidden; see `box_hidden`."""
    meets, i0, i1, j0, j1, near, far = box_on_face(lo, hi, face, layers.shape[2])
    if not meets:
        return True
    far = np.inf if at_all_depths else far * (1.0 + 1e-9)
    nearest = near * DEPTH_DOWN
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            if not pixel_hides(layers, face, j, i, nearest, far):
                return False
    return True


@kernel()
def triangle_hidden(q: np.ndarray, a: int, b: int, c: int, layers: np.ndarray, polygon: np.ndarray) -> bool:
    """Whether a triangle that does not touch the cell is hidden from the whole cell.

    Args:
        q: (n, 3) float64 vertices in cell coordinates; a, b, c the corners.
        polygon: (4, 2) float64 scratch.
    """
    resolution = layers.shape[2]
    slack = 1e-6
    top = resolution - 1
    for face in range(6):
        n, near, far = clip_triangle(q, a, b, c, face, resolution, polygon)
        if n == 0:
            continue
        u0, u1, v0, v1 = np.inf, -np.inf, np.inf, -np.inf
        for i in range(n):
            u0 = min(u0, polygon[i, 0])
            u1 = max(u1, polygon[i, 0])
            v0 = min(v0, polygon[i, 1])
            v1 = max(v1, polygon[i, 1])
        if u0 - slack > resolution or v0 - slack > resolution or u1 + slack < 0 or v1 + slack < 0:
            continue
        near = max(near, 1.0)
        plane, pa, pb, pc = inverse_depth_plane(q, a, b, c, face, resolution)
        spread = 0.5 * (abs(pa) + abs(pb)) + slack * (abs(pa) + abs(pb))
        row0 = max(int(np.floor(v0 - slack)), 0) if v0 > 0 else 0
        row1 = min(int(np.floor(v1 + slack)), top) if v1 < resolution else top
        for j in range(row0, row1 + 1):
            left, right = strip_extent(polygon, n, j - slack, j + 1.0 + slack)
            if left > right or left - slack > resolution or right + slack < 0:
                continue
            first = max(int(np.floor(left - slack)), 0) if left > 0 else 0
            last = min(int(np.floor(right + slack)), top) if right < resolution else top
            for i in range(first, last + 1):
                z0, z1 = near, far
                if plane:
                    w = pa * (i + 0.5) + pb * (j + 0.5) + pc
                    if (w + spread) * near < 1.0 and w + spread > 0.0:
                        z0 = max(z0, 1.0 / (w + spread) * (1.0 - PLANE))
                    if (w - spread) * far > 1.0:
                        z1 = min(z1, 1.0 / (w - spread) * (1.0 + PLANE))
                if not pixel_hides(layers, face, j, i, z0 * DEPTH_DOWN, z1 * (1.0 + 1e-9)):
                    return False
    return True


@allocating_kernel()
def find_visible(
    mesh: Mesh, clusters: Clusters, layers: np.ndarray, counts: np.ndarray, most_triangles: int
) -> np.ndarray:
    """Which drawables of the cut may be seen from the cell: by boxes of a tree, then clusters' boxes, then triangles.

    Args:
        mesh: the triangles, as the cell sees them; clusters: of these.
        layers: (6, r, r, k, 2) float32, see `layers`.
        counts: (drawables,) int64 triangles of the drawables; most_triangles: stop once more than this are visible, the
            rest of the answer is then not to be used; -1: never stop.

    Returns:
        (drawables,) bool. A triangle of a one-sided drawable counts only where its front can be seen.
    """
    visible = np.zeros(mesh.active.shape[0], np.bool_)
    _mark_visible(
        mesh, clusters, layers, counts, most_triangles, np.empty((4, 2)), np.empty((2, 3)), np.empty(STACK, np.int32),
        visible,
    )  # fmt: skip
    return visible


@kernel()
def _mark_visible(
    mesh: Mesh, clusters: Clusters, layers: np.ndarray, counts: np.ndarray, most_triangles: int, polygon: np.ndarray,
    placed: np.ndarray, stack: np.ndarray, visible: np.ndarray,
) -> None:  # fmt: skip
    """Mark the drawables that may be seen: see `find_visible`; polygon, placed and stack are scratch."""
    q, triangles = mesh.q, mesh.triangles
    stack[0] = 0
    waiting = min(clusters.right.shape[0], 1)
    total = 0
    while waiting and not 0 <= most_triangles < total:
        waiting -= 1
        node = stack[waiting]
        c = clusters.cluster[node]
        if c >= 0 and (visible[clusters.drawable[c]] or not mesh.active[clusters.drawable[c]]):
            continue
        place_node(clusters, node, mesh.centre, mesh.half, placed)
        if box_hidden(placed[0], placed[1], layers, False):
            continue
        if c < 0:
            stack[waiting], stack[waiting + 1] = clusters.right[node], node + 1
            waiting += 2
            continue
        for t in range(clusters.start[c], clusters.start[c + 1]):
            side = look(mesh, t)
            if side == TURNED:
                continue
            if (
                (side == 0 and may_touch(q, triangles[t, 0], triangles[t, 1], triangles[t, 2]))
                or not triangle_hidden(q, triangles[t, 0], triangles[t, 1], triangles[t, 2], layers, polygon)
            ):  # fmt: skip
                visible[clusters.drawable[c]] = True
                total += counts[clusters.drawable[c]]
                break


@kernel()
def may_touch(q: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether the triangle's box meets the cell, [-1, 1]^3."""
    grow = 1.0 + 1e-9
    apart = False
    for k in range(3):
        apart |= min(q[a, k], q[b, k], q[c, k]) > grow or max(q[a, k], q[b, k], q[c, k]) < -grow
    return not apart
