"""Images on the six faces of a cube around a view cell: projecting boxes, triangles and inflated edges.

Everything happens in *cell coordinates*: q = (x - centre) / half extents, so that the view cell is [-1, 1]^3 whatever
its shape. (Lines, planes, sides and depth order along an axis survive an affine map, so hidden means hidden.)
Face f looks along axis f // 2, towards minus where f is odd. On a face a point is (u, v, z): z its depth along the
face's axis, u and v the two other coordinates in cyclic order; its image is (u / z, v / z) in [-1, 1]^2, its pixel
coordinates (u / z + 1) * resolution / 2. Inside the pyramid |u|, |v| <= z everything outside the cell has z > 1.

Based on: the inflation of silhouette edges by a mirrored cell is that of occluder erosion, X. Décoret, G. Debunne,
F. Sillion: Erosion Based Visibility Preprocessing, Eurographics Symposium on Rendering 2003; here per edge and with
the depth of what is to be hidden taken into account.

**Inflated edges, and why they are right.** Let y be a point on an unsafe edge, p in the cell and x a point of depth at
most D, such that y lies in the triangle (0, p, x): y = a p + b x with a, b >= 0 and a + b <= 1. Then x has the
direction of y - a p, a point of the box y + [-a, a]^3. For y_z > 1, x_z = (y_z - a p_z) / b <= D with b <= 1 - a gives
a (D - p_z) <= D - y_z, so a <= (D - y_z) / (D - 1) =: alpha. Hence all directions in which x may lie are directions of
the box y + [-alpha, alpha]^3. Along the part of an edge with y_z >= NEAR, alpha is linear in y_z, so the convex hull of
the boxes at its two ends holds all boxes between them, and its image (all depths are positive there: NEAR - 1 > 0) is
the convex hull of the two boxes' images. Where y_z < NEAR, alpha = 1 is used, and the bounding box of that whole part;
where y_z >= D no a > 0 is possible, so the edge is cut at depth D.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.surfaces.ranges import below
from storage.base.kernels import kernel

#: Edges nearer than this depth (cell coordinates) are inflated by the whole cell, as one box.
NEAR = 1.25
#: Triangles are clipped at this depth; inside the face's pyramid all that is nearer lies inside the cell.
CLIP = 0.5
#: Image coordinates are rounded outward by this many pixels: far above float64's error, far below a pixel.
SLACK = 1e-6
#: Depths that are worked out with a triangle's plane are rounded outward by this part of them.
PLANE = 5e-7
#: Stands for "beyond the image" in pixels.
BEYOND = 1e12


class Face(NamedTuple):
    """A face of the cube, and the image on it."""

    number: int  # 0 to 5, see above
    resolution: int  # pixels along the edge of the image
    farthest: float  # nothing is deeper, in cell coordinates


class Pixels(NamedTuple):
    """A rectangle of whole pixels, all four bounds included; there are none where a first is above its last."""

    i0: int
    i1: int
    j0: int
    j1: int


class Window(NamedTuple):
    """A rectangle of an image, in pixel coordinates."""

    u0: float
    u1: float
    v0: float
    v1: float


@kernel(inline="always")
def window_of(pixels: Pixels) -> Window:
    """The window of whole pixels."""
    return Window(float(pixels.i0), pixels.i1 + 1.0, float(pixels.j0), pixels.j1 + 1.0)


@kernel(inline="always")
def to_face(q: np.ndarray, i: int, face: int) -> tuple[float, float, float]:
    """(u, v, z) of vertex i of q (n, 3) float64 on a face."""
    axis = face >> 1
    z = q[i, axis]
    if face & 1:
        z = -z
    return q[i, (axis + 1) % 3], q[i, (axis + 2) % 3], z


@kernel()
def box_on_face(
    lo: np.ndarray, hi: np.ndarray, face: int, resolution: int
) -> tuple[bool, int, int, int, int, float, float]:
    """Pixels that a box's part inside a face's pyramid and outside the cell touches, and that part's depths.

    Args:
        lo, hi: (3,) float64 the box in cell coordinates.

    Returns:
        (any, i0, i1, j0, j1, nearest depth, farthest depth); pixel ranges include both ends and are rounded outward.
    """
    axis = face >> 1
    a, b = (axis + 1) % 3, (axis + 2) % 3
    if face & 1:
        z0, z1 = -hi[axis], -lo[axis]
    else:
        z0, z1 = lo[axis], hi[axis]
    nearest_u = max(lo[a], -hi[a], 0.0)
    nearest_v = max(lo[b], -hi[b], 0.0)
    z0 = max(z0, 1.0, nearest_u, nearest_v)
    if z1 < z0:
        return False, 0, 0, 0, 0, 0.0, 0.0
    half = 0.5 * resolution
    u0 = (lo[a] / z0 if lo[a] < 0 else lo[a] / z1) * half + half - SLACK
    u1 = (hi[a] / z0 if hi[a] > 0 else hi[a] / z1) * half + half + SLACK
    v0 = (lo[b] / z0 if lo[b] < 0 else lo[b] / z1) * half + half - SLACK
    v1 = (hi[b] / z0 if hi[b] > 0 else hi[b] / z1) * half + half + SLACK
    if u0 > resolution or v0 > resolution or u1 < 0 or v1 < 0:
        return False, 0, 0, 0, 0, 0.0, 0.0
    top = resolution - 1
    i0 = min(max(int(np.floor(u0)), 0), top)
    i1 = min(max(int(np.floor(u1)), 0), top)
    j0 = min(max(int(np.floor(v0)), 0), top)
    j1 = min(max(int(np.floor(v1)), 0), top)
    return True, i0, i1, j0, j1, z0, z1


@kernel()
def clip_triangle(
    q: np.ndarray, i0: int, i1: int, i2: int, face: int, resolution: int, polygon: np.ndarray
) -> tuple[int, float, float]:
    """A triangle's image on a face, clipped at depth CLIP and thrown away where it misses the face's square.

    Args:
        q: (n, 3) float64 cell coordinates; i0, i1, i2 the corners.
        polygon: (4, 2) float64, receives the corners in pixel coordinates.

    Returns:
        (corners: 0, 3 or 4; nearest depth; farthest depth) of the clipped polygon.
    """
    u0, v0, z0 = to_face(q, i0, face)
    u1, v1, z1 = to_face(q, i1, face)
    u2, v2, z2 = to_face(q, i2, face)
    far = max(z0, z1, z2)
    if far <= CLIP:
        return 0, 0.0, 0.0
    # beside the pyramid altogether: the planes |u| = z, |v| = z hold for every depth sign
    grow = 1.0 + 1e-9
    if (
        (u0 > z0 * grow + 1e-9 and u1 > z1 * grow + 1e-9 and u2 > z2 * grow + 1e-9)
        or (-u0 > z0 * grow + 1e-9 and -u1 > z1 * grow + 1e-9 and -u2 > z2 * grow + 1e-9)
        or (v0 > z0 * grow + 1e-9 and v1 > z1 * grow + 1e-9 and v2 > z2 * grow + 1e-9)
        or (-v0 > z0 * grow + 1e-9 and -v1 > z1 * grow + 1e-9 and -v2 > z2 * grow + 1e-9)
    ):
        return 0, 0.0, 0.0
    half = 0.5 * resolution
    near = min(z0, z1, z2)
    if near >= CLIP:
        polygon[0, 0] = u0 / z0 * half + half
        polygon[0, 1] = v0 / z0 * half + half
        polygon[1, 0] = u1 / z1 * half + half
        polygon[1, 1] = v1 / z1 * half + half
        polygon[2, 0] = u2 / z2 * half + half
        polygon[2, 1] = v2 / z2 * half + half
        return 3, near, far
    n = 0
    ua, va, za = u2, v2, z2
    for corner in range(3):
        if corner == 0:
            ub, vb, zb = u0, v0, z0
        elif corner == 1:
            ub, vb, zb = u1, v1, z1
        else:
            ub, vb, zb = u2, v2, z2
        if (za < CLIP) != (zb < CLIP):
            t = (CLIP - za) / (zb - za)
            polygon[n, 0] = (ua + t * (ub - ua)) / CLIP * half + half
            polygon[n, 1] = (va + t * (vb - va)) / CLIP * half + half
            n += 1
        if zb >= CLIP:
            polygon[n, 0] = ub / zb * half + half
            polygon[n, 1] = vb / zb * half + half
            n += 1
        ua, va, za = ub, vb, zb
    return n, CLIP, far


@kernel()
def strip_extent(polygon: np.ndarray, n: int, v0: float, v1: float) -> tuple[float, float]:
    """Smallest and largest u of a convex polygon (n corners, pixel coordinates) where v0 <= v <= v1.

    The first is above the second where the polygon misses the strip.
    """
    least, most = BEYOND, -BEYOND
    ua, va = polygon[n - 1, 0], polygon[n - 1, 1]
    for i in range(n):
        ub, vb = polygon[i, 0], polygon[i, 1]
        if va <= vb:
            ul, vl, uh, vh = ua, va, ub, vb
        else:
            ul, vl, uh, vh = ub, vb, ua, va
        if vh >= v0 and vl <= v1:
            if vl < v0:
                ul = ul + (uh - ul) * ((v0 - vl) / (vh - vl))
                vl_cut = v0
            else:
                vl_cut = vl
            if vh > v1 and vh > vl_cut:
                uh = ul + (uh - ul) * ((v1 - vl_cut) / (vh - vl_cut))
            least = min(least, ul, uh)
            most = max(most, ul, uh)
        ua, va = ub, vb
    return least, most


@kernel(inline="always")
def inverse_depth_plane(
    q: np.ndarray, i0: int, i1: int, i2: int, face: int, resolution: int
) -> tuple[bool, float, float, float]:
    """1 / z of a triangle's plane as A * u + B * v + C in pixel coordinates.

    Returns (False, 0, 0, 0) where the plane passes too near the projection point, or the triangle is too thin or too
    small for its normal to be known well. Else the result is wrong by less than PLANE / 4 of itself and as much of one
    over the triangle's largest coordinate: with m the largest coordinate and s the sum of those of two edges, rounding
    of the corners moves a coordinate of the normal by less than 2^-48 m s.
    """
    u0, v0, z0 = to_face(q, i0, face)
    u1, v1, z1 = to_face(q, i1, face)
    u2, v2, z2 = to_face(q, i2, face)
    au, av, az = u1 - u0, v1 - v0, z1 - z0
    bu, bv, bz = u2 - u0, v2 - v0, z2 - z0
    nu = av * bz - az * bv
    nv = az * bu - au * bz
    nz = au * bv - av * bu
    d = nu * u0 + nv * v0 + nz * z0
    edges = abs(au) + abs(av) + abs(az) + abs(bu) + abs(bv) + abs(bz)
    largest = abs(u0) + abs(v0) + abs(z0) + edges  # or less
    if abs(d) <= 1e-7 * largest * largest * edges:
        return False, 0.0, 0.0, 0.0
    scale = 1.0 / d
    a_pixel = scale / (0.5 * resolution)
    return True, nu * a_pixel, nv * a_pixel, (nz - nu - nv) * scale


@kernel(inline="always")
def box_image(u: float, v: float, z: float, alpha: float, half: float) -> tuple[float, float, float, float]:
    """Bounding rectangle (u0, u1, v0, v1) in pixels of the box (u, v, z) + [-alpha, alpha]^3 at depths > 0."""
    z0, z1 = z - alpha, z + alpha
    lo, hi = u - alpha, u + alpha
    u0 = lo / z0 if lo < 0 else lo / z1
    u1 = hi / z0 if hi > 0 else hi / z1
    lo, hi = v - alpha, v + alpha
    v0 = lo / z0 if lo < 0 else lo / z1
    v1 = hi / z0 if hi > 0 else hi / z1
    return u0 * half + half - SLACK, u1 * half + half + SLACK, v0 * half + half - SLACK, v1 * half + half + SLACK


@kernel(inline="always")
def nearer_first(q: np.ndarray, i0: int, i1: int, face: int) -> tuple[float, float, float, float, float, float]:
    """(u, v, z) of the two ends of an edge on a face, the nearer one first."""
    ua, va, za = to_face(q, i0, face)
    ub, vb, zb = to_face(q, i1, face)
    if za > zb:
        ua, va, za, ub, vb, zb = ub, vb, zb, ua, va, za
    return ua, va, za, ub, vb, zb


@kernel(inline="always")
def at_depth(
    ua: float, va: float, za: float, ub: float, vb: float, zb: float, depth: float
) -> tuple[float, float, float]:
    """The point (u, v, depth) of an edge that reaches from below this depth to above it."""
    t = (depth - za) / (zb - za)
    return ua + t * (ub - ua), va + t * (vb - va), depth


@kernel()
def inflate_edge(q: np.ndarray, i0: int, i1: int, face: int, resolution: int, depth: float, sweep: np.ndarray) -> int:
    """Where occludees of at most `depth` may be seen past an edge, as two swept rectangles in pixel coordinates.

    Args:
        q: (n, 3) float64 cell coordinates; i0, i1 the ends of the edge.
        depth: of the occludees along the face's axis, at least 1.5 and possibly infinite.
        sweep: (4, 4) float64, receives up to two sweeps: rows 2 k and 2 k + 1 are the rectangles (u0, u1, v0, v1) at
            the two ends of sweep k. The region is the convex hull of both.

    Returns:
        The number of sweeps written: 0, 1 or 2. See the module's docstring for the proof.
    """
    ua, va, za, ub, vb, zb = nearer_first(q, i0, i1, face)
    if zb <= -1.0 or za >= depth:
        return 0
    half = 0.5 * resolution
    if zb > depth:
        ub, vb, zb = at_depth(ua, va, za, ub, vb, zb, depth)
    n = 0
    if za < NEAR:
        # the near part: one box, inflated by the whole cell
        if zb > NEAR:
            um, vm, zm = at_depth(ua, va, za, ub, vb, zb, NEAR)
        else:
            um, vm, zm = ub, vb, zb
        us, vs, zs = ua, va, za
        if zs < -1.0:
            us, vs, zs = at_depth(us, vs, zs, um, vm, zm, -1.0)
        z0, z1 = zs - 1.0, zm + 1.0
        lo, hi = min(us, um) - 1.0, max(us, um) + 1.0
        u0 = lo / z1 if lo >= 0 else (lo / z0 if z0 > 0 else -BEYOND)
        u1 = hi / z1 if hi <= 0 else (hi / z0 if z0 > 0 else BEYOND)
        lo, hi = min(vs, vm) - 1.0, max(vs, vm) + 1.0
        v0 = lo / z1 if lo >= 0 else (lo / z0 if z0 > 0 else -BEYOND)
        v1 = hi / z1 if hi <= 0 else (hi / z0 if z0 > 0 else BEYOND)
        sweep[0, 0] = u0 * half + half - SLACK
        sweep[0, 1] = u1 * half + half + SLACK
        sweep[0, 2] = v0 * half + half - SLACK
        sweep[0, 3] = v1 * half + half + SLACK
        for k in range(4):
            sweep[1, k] = sweep[0, k]
        n = 1
        if zb <= NEAR:
            return n
        ua, va, za = um, vm, zm
    if np.isinf(depth):
        alpha_a, alpha_b = 1.0, 1.0
    else:
        alpha_a = min((depth - za) / (depth - 1.0), 1.0)
        alpha_b = min((depth - zb) / (depth - 1.0), 1.0)
    k = 2 * n
    sweep[k, 0], sweep[k, 1], sweep[k, 2], sweep[k, 3] = box_image(ua, va, za, alpha_a, half)
    k += 1
    sweep[k, 0], sweep[k, 1], sweep[k, 2], sweep[k, 3] = box_image(ub, vb, zb, alpha_b, half)
    return n + 1


@kernel()
def far_part(q: np.ndarray, i0: int, i1: int, face: int) -> tuple[bool, float, float, float, float, float, float]:
    """The part of an edge beyond NEAR: whether there is any, and (u, v, z) of its two ends, the nearer one first."""
    ua, va, za, ub, vb, zb = nearer_first(q, i0, i1, face)
    if za < NEAR < zb:
        ua, va, za = at_depth(ua, va, za, ub, vb, zb, NEAR)
    return zb > NEAR or za >= NEAR, ua, va, za, ub, vb, zb


@kernel(inline="always")
def _strip_range(rows: np.ndarray, a: int, b: int, v0: float, v1: float) -> tuple[float, float]:
    """The range of t in [0, 1] in which the rectangle swept from rows[a] to rows[b] meets v0 <= v <= v1."""
    t0, t1 = below(0.0, 1.0, rows[a, 2] - v1, rows[b, 2] - v1, 0.0)
    return below(t0, t1, v0 - rows[a, 3], v0 - rows[b, 3], 0.0)


@kernel()
def sweep_range(rows: np.ndarray, a: int, b: int, window: Window) -> tuple[float, float]:
    """The range of t in [0, 1] in which the rectangle swept from rows[a] to rows[b] meets a window.

    rows: (n, 4 or more) float64, a rectangle (u0, u1, v0, v1) each. The union of the rectangles over t is the convex
    hull of the two: a point of the hull is (1 - t) p + t q with p in the one, q in the other, and lies in the rectangle
    at t. Empty where the first result is above the second.
    """
    t0, t1 = _strip_range(rows, a, b, window.v0, window.v1)
    t0, t1 = below(t0, t1, rows[a, 0] - window.u1, rows[b, 0] - window.u1, 0.0)
    return below(t0, t1, window.u0 - rows[a, 1], window.u0 - rows[b, 1], 0.0)


@kernel()
def hull_touches(rows: np.ndarray, a: int, b: int, window: Window) -> bool:
    """Whether the convex hull of the rectangles rows[a] and rows[b] touches a window; see `sweep_range`."""
    u0, u1, v0, v1 = window
    if (
        min(rows[a, 0], rows[b, 0]) > u1 or max(rows[a, 1], rows[b, 1]) < u0
        or min(rows[a, 2], rows[b, 2]) > v1 or max(rows[a, 3], rows[b, 3]) < v0
    ):  # fmt: skip
        return False
    if rows[a, 0] <= u1 and rows[a, 1] >= u0 and rows[a, 2] <= v1 and rows[a, 3] >= v0:
        return True
    if rows[b, 0] <= u1 and rows[b, 1] >= u0 and rows[b, 2] <= v1 and rows[b, 3] >= v0:
        return True
    t0, t1 = sweep_range(rows, a, b, window)
    return t0 <= t1


@kernel()
def sweep_extent(rows: np.ndarray, a: int, b: int, j: int) -> tuple[float, float]:
    """The extent in u, where j <= v <= j + 1, of the rectangle swept from rows[a] to rows[b]; see `sweep_range`.

    The first is above the second where the strip is missed. The rectangles that meet the strip are those of a range of
    positions, as both ends of a rectangle in v change linearly; rounded outward.
    """
    if max(rows[a, 3], rows[b, 3]) < j or min(rows[a, 2], rows[b, 2]) > j + 1.0:
        return 1.0, 0.0
    t0, t1 = _strip_range(rows, a, b, j, j + 1.0)
    if t0 > t1:
        return 1.0, 0.0
    du0, du1 = rows[b, 0] - rows[a, 0], rows[b, 1] - rows[a, 1]
    return rows[a, 0] + min(t0 * du0, t1 * du0), rows[a, 1] + max(t0 * du1, t1 * du1)
