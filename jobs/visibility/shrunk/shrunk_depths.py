"""Depth images of shrunk occluders from a projection point, and what they hide.

Based on: J. Chhugani et al.: vLOD, IEEE TVCG 11(1), 2005, section 5.2. The paper draws with graphics hardware, lets
pixels that are not covered in full fail by their alpha, and asks for each object whether any pixel of it was written.

Coordinates are cell coordinates (see `cube_faces`) moved by the projection point and scaled by SCALE, so that what
`cube_faces` takes for the inside of the cell is next to the projection point and next to nothing; occludees that reach
into it are not hidden.
"""

from __future__ import annotations

import numpy as np

from jobs.visibility.flooding.occludees import DEPTH_DOWN, box_hidden, triangle_hidden
from jobs.visibility.images.cube_faces import SLACK, to_face
from jobs.visibility.images.layers import add_layer, pixel_hides
from jobs.visibility.shrunk.projection_point import greatest_height, supporting_plane
from storage.base.kernels import allocating_kernel, kernel

#: Cell coordinates are multiplied by this much.
SCALE = 1e6


@allocating_kernel()
def find_occluders(
    q: np.ndarray, corners: np.ndarray, counts: np.ndarray, chosen: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The polygons that do not shrink to nothing, with their planes.

    Args:
        q: (n, 3) float64 vertices in cell coordinates.
        corners, counts: from `planar_polygons`; chosen: (c,) int64 polygons whose planes do not meet the cell.

    Returns:
        occluders: (k,) int64 those of the chosen ones that hide something however far away.
        faces (k, 4), heights (k,), sides (k, s, 4) as `projection_point` takes them.
    """
    most = corners.shape[1]
    occluders = np.empty(chosen.shape[0], np.int64)
    faces = np.empty((chosen.shape[0], 4), np.float64)
    heights = np.empty(chosen.shape[0], np.float64)
    sides = np.zeros((chosen.shape[0], most, 4), np.float64)
    k = 0
    for p in chosen:
        n = counts[p]
        x, y, z, nx, ny, nz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        o = corners[p, 0]
        for i in range(n):
            a, b = corners[p, i], corners[p, (i + 1) % n]
            x, y, z = x + q[a, 0] / n, y + q[a, 1] / n, z + q[a, 2] / n
            ux, uy, uz = q[a, 0] - q[o, 0], q[a, 1] - q[o, 1], q[a, 2] - q[o, 2]
            vx, vy, vz = q[b, 0] - q[o, 0], q[b, 1] - q[o, 1], q[b, 2] - q[o, 2]
            nx, ny, nz = nx + uy * vz - uz * vy, ny + uz * vx - ux * vz, nz + ux * vy - uy * vx
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if length == 0.0:
            continue
        if nx * x + ny * y + nz * z > 0.0:  # the cell's middle lies before the plane
            length = -length
        nx, ny, nz = nx / length, ny / length, nz / length
        low = np.inf  # the plane, moved behind all corners
        for i in range(n):
            a = corners[p, i]
            low = min(low, nx * q[a, 0] + ny * q[a, 1] + nz * q[a, 2])
        found = True
        for i in range(n):
            a, b = corners[p, i], corners[p, (i + 1) % n]
            found, mx, my, mz, d = supporting_plane((q[a, 0], q[a, 1], q[a, 2]), (q[b, 0], q[b, 1], q[b, 2]), (x, y, z))
            if not found:
                break
            sides[k, i, 0], sides[k, i, 1], sides[k, i, 2], sides[k, i, 3] = mx, my, mz, d
        if not found:
            continue
        height = greatest_height(sides[k], n, nx, ny, nz)
        if height == np.inf or not low < -abs(nx) - abs(ny) - abs(nz):
            continue
        for i in range(n, most):
            sides[k, i, 0], sides[k, i, 1], sides[k, i, 2], sides[k, i, 3] = 0.0, 0.0, 0.0, 1.0
        faces[k, 0], faces[k, 1], faces[k, 2], faces[k, 3] = nx, ny, nz, low
        heights[k] = height
        occluders[k] = p
        k += 1
    return occluders[:k].copy(), faces[:k].copy(), heights[:k].copy(), sides[:k].copy()


@allocating_kernel()
def draw_shrunk(
    faces: np.ndarray, sides: np.ndarray, chosen: np.ndarray, v: np.ndarray, layers: np.ndarray
) -> np.ndarray:
    """Draw occluders, shrunk for the projection point v (3,), into layers of one pair each, cleared before.

    Args:
        faces, sides, chosen: as for `projection_point`, inside of which v must lie.
        layers: (6, r, r, 1, 2) float32. A pixel hides only where its whole square lies inside the shrunk frustum, and
            from the largest depth of the occluder's plane over the square on.

    Returns:
        (6,) bool the faces that are drawn on.
    """
    resolution = layers.shape[2]
    half = 0.5 * resolution
    drawn = np.zeros(6, np.bool_)
    lines = np.empty((sides.shape[1], 3), np.float64)
    for j in chosen:
        height = faces[j, 0] * v[0] + faces[j, 1] * v[1] + faces[j, 2] * v[2] - faces[j, 3]
        for face in range(6):
            # 1 / depth of the plane, at pixel coordinates (i, j): pa i + pb j + pc
            pa, pb, pc = _in_image(faces[j], face, half)
            pa, pb, pc = -pa / height, -pb / height, -pc / height
            spread = 0.5 * (abs(pa) + abs(pb))
            outside = pc + max(pa * resolution, 0.0) + max(pb * resolution, 0.0) <= 0.0
            n = 0
            for s in range(sides.shape[1]):
                a, b, c = _in_image(sides[j, s], face, half)
                # the side's plane at the middle of pixel (i, j): a i + b j + c; not above 0 if its square is inside
                c += 0.5 * (a + b) + (0.5 + SLACK) * (abs(a) + abs(b)) + 1e-12
                if sides[j, s, 0] != 0.0 or sides[j, s, 1] != 0.0 or sides[j, s, 2] != 0.0:
                    lines[n, 0], lines[n, 1], lines[n, 2] = a, b, c
                    n += 1
                    outside |= c + min(a * resolution, 0.0) + min(b * resolution, 0.0) > 0.0
            if outside:
                continue
            for row in range(resolution):
                left, right = 0.0, resolution - 1.0
                for s in range(n):
                    a, rest = lines[s, 0], lines[s, 1] * row + lines[s, 2]
                    if a > 0.0:
                        right = min(right, -rest / a)
                    elif a < 0.0:
                        left = max(left, -rest / a)
                    elif rest > 0.0:
                        right = -1.0
                    if left > right:
                        break
                if left > right:
                    continue
                for i in range(int(np.ceil(left)), int(np.floor(right)) + 1):
                    w = pa * (i + 0.5) + pb * (row + 0.5) + pc - spread
                    if w > 1e-9 * (abs(pa) + abs(pb) + abs(pc)):
                        drawn[face] = True
                        add_layer(layers, face, row, i, SCALE / w * (1.0 + 1e-9), np.inf)
    return drawn


@kernel(inline="always")
def _in_image(plane: np.ndarray, face: int, half: float) -> tuple[float, float, float]:
    """A normal's product with the direction of a pixel at depth 1, as a i + b j + c of its pixel coordinates."""
    axis = face >> 1
    a, b = plane[(axis + 1) % 3] / half, plane[(axis + 2) % 3] / half
    c = -plane[axis] if face & 1 else plane[axis]
    return a, b, c - (a + b) * half


@kernel()
def move_to(q: np.ndarray, v: np.ndarray, moved: np.ndarray) -> None:
    """Moved (n, 3) float64 = (q (n, 3) - v (3,)) * SCALE."""
    for i in range(q.shape[0]):
        for k in range(3):
            moved[i, k] = (q[i, k] - v[k]) * SCALE


@allocating_kernel()
def hide(
    q: np.ndarray,
    moved: np.ndarray,
    v: np.ndarray,
    triangles: np.ndarray,
    clusters: np.ndarray,
    cluster_start: np.ndarray,
    cluster_lo: np.ndarray,
    cluster_hi: np.ndarray,
    layers: np.ndarray,
    hidden: np.ndarray,
) -> np.ndarray:
    """Mark the triangles that the occluders in the layers hide from the cell.

    Args:
        q: (n, 3) float64 vertices in cell coordinates; moved: the same by `move_to` for the projection point v (3,).
        triangles: (m, 3) int32.
        clusters: (c,) int64 those with triangles that are not hidden yet; cluster_start: (k + 1,) int32 their
            triangles; cluster_lo, cluster_hi: (k, 3) float64 boxes in cell coordinates.
        layers: from `draw_shrunk`.
        hidden: (m,) bool, set to True where a triangle is hidden, else left alone.

    Returns:
        (c,) bool: the clusters that still have triangles that are not hidden.
    """
    polygon = np.empty((4, 2), np.float64)
    lo, hi = np.empty(3, np.float64), np.empty(3, np.float64)
    left = np.ones(clusters.shape[0], np.bool_)
    for number in range(clusters.shape[0]):
        c = clusters[number]
        apart = False
        for k in range(3):
            apart |= cluster_lo[c, k] > 1.0 or cluster_hi[c, k] < -1.0
            lo[k], hi[k] = (cluster_lo[c, k] - v[k]) * SCALE, (cluster_hi[c, k] - v[k]) * SCALE
        if apart and box_hidden(lo, hi, layers, False):
            hidden[cluster_start[c] : cluster_start[c + 1]] = True
            left[number] = False
            continue
        any_left = False
        for t in range(cluster_start[c], cluster_start[c + 1]):
            if hidden[t]:
                continue
            x, y, z = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            if (
                _vertex_hidden(moved, x, layers)
                and not _touches(q, x, y, z) and not _touches(moved, x, y, z)
                and triangle_hidden(moved, x, y, z, layers, polygon)
            ):  # fmt: skip
                hidden[t] = True
            else:
                any_left = True
        left[number] = any_left
    return left


@kernel()
def _vertex_hidden(moved: np.ndarray, i: int, layers: np.ndarray) -> bool:
    """Whether a pixel that a vertex lies in hides it: quickly says where a triangle need not be looked at."""
    x, y, z = abs(moved[i, 0]), abs(moved[i, 1]), abs(moved[i, 2])
    axis = 0 if x >= y and x >= z else (1 if y >= z else 2)
    face = 2 * axis + (1 if moved[i, axis] < 0 else 0)
    u, v, depth = to_face(moved, i, face)
    if not depth > 1.0:
        return False
    resolution = layers.shape[2]
    column = min(int((u / depth + 1.0) * 0.5 * resolution), resolution - 1)
    row = min(int((v / depth + 1.0) * 0.5 * resolution), resolution - 1)
    return pixel_hides(layers, face, row, column, depth * DEPTH_DOWN, depth)


@kernel()
def _touches(q: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether the triangle's box meets [-1, 1]^3."""
    grow = 1.0 + 1e-9
    apart = False
    for k in range(3):
        apart |= min(q[a, k], q[b, k], q[c, k]) > grow or max(q[a, k], q[b, k], q[c, k]) < -grow
    return not apart
