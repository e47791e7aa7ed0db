"""Item buffers from points of a cell: what they show can be seen, but for rounding.

A pixel's centre is a ray; the nearest triangle that it meets is seen. `aimed_rays` makes a proof of it. A tree is gone
down from near to far, and what lies behind all that its box touches is not drawn. What can be seen through is for rays
alone to find: it would hide here what is behind it.

Based on: N. Greene, M. Kass, G. Miller: Hierarchical Z-Buffer Visibility, SIGGRAPH 1993.
"""

from __future__ import annotations

import numpy as np

from jobs.visibility.images.cube_faces import box_on_face, clip_triangle, inverse_depth_plane, strip_extent
from jobs.visibility.surfaces.clusters import Clusters, place_node
from jobs.visibility.surfaces.ray_tree import STACK
from jobs.visibility.surfaces.seen_mesh import TURNED, Mesh, look
from storage.base.kernels import allocating_kernel, kernel

#: Seen from the eye, cell coordinates are made this many times as large: what is nearer than a whole cell counts, too.
SCALE = 1e6


@allocating_kernel()
def see(
    mesh: Mesh,
    clusters: Clusters,
    drawn: np.ndarray,
    eye: np.ndarray,
    resolution: int,
    triangle: np.ndarray,
    pixel: np.ndarray,
) -> None:
    """Find the drawables that are seen from a point through the pixels' centres of six cube faces.

    Args:
        mesh: the triangles, as the cell sees them; back faces of one-sided drawables are not drawn.
        clusters: of these; drawn: (drawables,) bool what is drawn, of the cut.
        eye: (3,) float64 inside the cell, in cell coordinates.
        triangle: (drawables,) int32, receives a triangle that is seen of each drawable, -1 where none is.
        pixel: (drawables,) int32, receives where, (face * resolution + j) * resolution + i: the one of the drawable's
            pixels that has as many before it as after it, not at its border as a rule.
    """
    nearest = np.zeros((6, resolution, resolution), np.float64)
    item = np.full((6, resolution, resolution), -1, np.int32)
    _draw(
        mesh, clusters, drawn, eye, resolution, np.empty((3, 3)), np.empty((4, 2)), np.empty((2, 3)),
        np.empty(STACK, np.int32), nearest, item,
    )  # fmt: skip
    triangle_drawable = mesh.triangle_drawable
    pixels = item.ravel()
    count = np.zeros(len(triangle), np.int32)
    for at in range(len(pixels)):
        if pixels[at] >= 0:
            count[triangle_drawable[pixels[at]]] += 1
    passed = np.zeros(len(triangle), np.int32)
    triangle[:] = -1
    for at in range(len(pixels)):
        if pixels[at] >= 0:
            d = triangle_drawable[pixels[at]]
            if passed[d] == count[d] // 2:
                triangle[d], pixel[d] = pixels[at], at
            passed[d] += 1


@kernel()
def _draw(
    mesh: Mesh, clusters: Clusters, drawn: np.ndarray, eye: np.ndarray, resolution: int, moved: np.ndarray,
    polygon: np.ndarray, placed: np.ndarray, stack: np.ndarray, nearest: np.ndarray, item: np.ndarray,
) -> None:  # fmt: skip
    """Draw what is seen from a point: see `see`.

    Args:
        moved: (3, 3), polygon: (4, 2), placed: (2, 3) float64 and stack: (STACK,) int32 are scratch.
        nearest: (6, r, r) float64 0s, receive one over the depths; item: (6, r, r) int32 -1s, receive the triangles.
    """
    q, triangles = mesh.q, mesh.triangles
    stack[0] = 0
    waiting = min(clusters.right.shape[0], 1)
    while waiting:
        waiting -= 1
        node = stack[waiting]
        c = clusters.cluster[node]
        if (c >= 0 and not drawn[clusters.drawable[c]]) or _behind(clusters, node, mesh, eye, nearest, placed):
            continue
        if c < 0:
            one, other = node + 1, clusters.right[node]
            if _distance(clusters, one, mesh, eye, placed) > _distance(clusters, other, mesh, eye, placed):
                one, other = other, one
            stack[waiting], stack[waiting + 1] = other, one
            waiting += 2
            continue
        one_sided = mesh.one_sided[clusters.drawable[c]]
        for t in range(clusters.start[c], clusters.start[c + 1]):
            if look(mesh, t) == TURNED:
                continue
            for i in range(3):
                for k in range(3):
                    moved[i, k] = (q[triangles[t, i], k] - eye[k]) * SCALE
            if one_sided:
                ux, uy, uz = moved[1, 0] - moved[0, 0], moved[1, 1] - moved[0, 1], moved[1, 2] - moved[0, 2]
                vx, vy, vz = moved[2, 0] - moved[0, 0], moved[2, 1] - moved[0, 1], moved[2, 2] - moved[0, 2]
                facing = (
                    moved[0, 0] * (uy * vz - uz * vy)
                    + moved[0, 1] * (uz * vx - ux * vz)
                    + moved[0, 2] * (ux * vy - uy * vx)
                )
                if facing >= 0:
                    continue
            only = _face_of(moved)
            for face in range(6):
                if only >= 0 and face != only:
                    continue
                n, _, _ = clip_triangle(moved, 0, 1, 2, face, resolution, polygon)
                if n == 0:
                    continue
                plane, pa, pb, pc = inverse_depth_plane(moved, 0, 1, 2, face, resolution)
                if not plane:
                    continue
                v0, v1 = np.inf, -np.inf
                for i in range(n):
                    v0 = min(v0, polygon[i, 1])
                    v1 = max(v1, polygon[i, 1])
                row0 = max(int(np.ceil(v0 - 0.5)), 0) if v0 > 0 else 0
                row1 = min(int(np.floor(v1 - 0.5)), resolution - 1) if v1 < resolution else resolution - 1
                for j in range(row0, row1 + 1):
                    left, right = strip_extent(polygon, n, j + 0.5, j + 0.5)
                    if left > right or left > resolution or right < 0:
                        continue
                    first = max(int(np.ceil(left - 0.5)), 0) if left > 0 else 0
                    last = min(int(np.floor(right - 0.5)), resolution - 1) if right < resolution else resolution - 1
                    for i in range(first, last + 1):
                        w = pa * (i + 0.5) + pb * (j + 0.5) + pc
                        if w > nearest[face, j, i] or (w == nearest[face, j, i] and t < item[face, j, i]):
                            nearest[face, j, i] = w
                            item[face, j, i] = t


@kernel()
def _behind(
    clusters: Clusters, node: int, mesh: Mesh, eye: np.ndarray, nearest: np.ndarray, placed: np.ndarray
) -> bool:
    """Whether all pixels that a node's box touches show something nearer. placed: (2, 3) float64 scratch."""
    place_node(clusters, node, mesh.centre, mesh.half, placed)
    for k in range(3):
        placed[0, k] = (placed[0, k] - eye[k]) * SCALE
        placed[1, k] = (placed[1, k] - eye[k]) * SCALE
    for face in range(6):
        meets, i0, i1, j0, j1, near, _ = box_on_face(placed[0], placed[1], face, nearest.shape[2])
        if meets:
            for j in range(j0, j1 + 1):
                for i in range(i0, i1 + 1):
                    if not nearest[face, j, i] * near > 1.0 + 1e-6:
                        return False
    return True


@kernel()
def _distance(clusters: Clusters, node: int, mesh: Mesh, eye: np.ndarray, placed: np.ndarray) -> float:
    """How far a node's box is from the eye, along the axis where that is the most. placed: (2, 3) float64 scratch."""
    place_node(clusters, node, mesh.centre, mesh.half, placed)
    far = 0.0
    for k in range(3):
        far = max(far, placed[0, k] - eye[k], eye[k] - placed[1, k])
    return far


@kernel()
def _face_of(corners: np.ndarray) -> int:
    """The one face whose pyramid holds all three corners (3, 3), or -1."""
    face = -1
    for i in range(3):
        x, y, z = abs(corners[i, 0]), abs(corners[i, 1]), abs(corners[i, 2])
        axis = 0 if x >= y and x >= z else (1 if y >= z else 2)
        mine = 2 * axis + (1 if corners[i, axis] < 0 else 0)
        if i and mine != face:
            return -1
        face = mine
    return face
