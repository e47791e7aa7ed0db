"""Item buffers from points of a cell: what they show can be seen, but for rounding.

A pixel's centre is a ray; the nearest triangle that it meets is seen. `aimed_rays` makes a proof of it.
"""

from __future__ import annotations

import numpy as np

from jobs.visibility.cube_faces import clip_triangle, inverse_depth_plane, strip_extent
from jobs.visibility.mesh import TURNED, Mesh, look
from storage.kernels import allocating_kernel, kernel


@allocating_kernel()
def see(
    mesh: Mesh,
    chosen: np.ndarray,
    begins: np.ndarray,
    eye: np.ndarray,
    resolution: int,
    triangle: np.ndarray,
    pixel: np.ndarray,
) -> None:
    """Find the drawables that are seen from a point through the pixels' centres of six cube faces.

    Args:
        mesh: the triangles, as the cell sees them; back faces of one-sided drawables are not drawn.
        chosen: (c,) int64 the drawables to draw, of the cut; begins: (drawables + 1,) int32 offsets into the triangles.
        eye: (3,) float64 inside the cell, in cell coordinates.
        triangle: (drawables,) int32, receives a triangle that is seen of each drawable, -1 where none is.
        pixel: (drawables,) int32, receives where, (face * resolution + j) * resolution + i: the one of the drawable's
            pixels that has as many before it as after it, not at its border as a rule.
    """
    moved = np.empty((3, 3), np.float64)
    polygon = np.empty((4, 2), np.float64)
    nearest = np.zeros((6, resolution, resolution), np.float64)
    item = np.full((6, resolution, resolution), -1, np.int32)
    q, triangles, triangle_drawable, one_sided = mesh.q, mesh.triangles, mesh.triangle_drawable, mesh.one_sided
    for d in chosen:
        for t in range(begins[d], begins[d + 1]):
            if look(mesh, t) == TURNED:
                continue
            for i in range(3):
                for k in range(3):
                    moved[i, k] = (q[triangles[t, i], k] - eye[k]) * 1e6
            if one_sided[d]:
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
                        if w > nearest[face, j, i]:
                            nearest[face, j, i] = w
                            item[face, j, i] = t
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
