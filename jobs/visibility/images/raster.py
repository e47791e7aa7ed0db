"""Triangles drawn into the image on a face: how deep each pixel's set of triangles reaches, and what a core covers.

Based on: J. Pineda: A Parallel Algorithm for Polygon Rasterization, SIGGRAPH 1988 (edge functions, walked pixel by
pixel); T. Akenine-Möller, T. Aila: Conservative and Tiled Rasterization Using a Modified Triangle Setup, Journal of
Graphics Tools 10(3), 2005 (the same with bounds moved by half a pixel).

A row's pixels are worked out LANES at a time in float32, without branches: one vector instruction each on wide
machines. Images are wider than a face by LANES pixels, which are written and never read.

**Touched.** A triangle touches a pixel if and only if their boxes meet and the pixel's corner that is farthest inwards
lies on the inner side of each edge's line. With the gradient (a, b) of an edge function scaled to |a| + |b| = 1 that
corner has 1/2 more than the centre. All is rounded so that too many pixels are touched, never too few.

**Covered.** The centre lies within ROUNDING of the inner side of each edge, and in the triangle's box. So a point of
the triangle's image lies well inside the pixel, which is all that `occluders` asks for.

**Rounding.** With r the resolution, positions in the window and edge functions there are at most 2 r, or so large that
their sign is beyond doubt; float32 and four roundings move an edge by at most r ROUNDING. In float64 a corner is
uncertain by less than 2^-50 of its coordinates, and so the direction of an edge by that over its length, which moves
its line in the window by that times the distance once more. An edge so short and far away that this could be a part of
r ROUNDING that counts bounds nothing; the box still does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.images.cube_faces import CLIP, SLACK, Face, Pixels, clip_triangle, inverse_depth_plane, to_face
from storage.base.kernels import kernel

#: Pixels that are worked out at once.
LANES = 16
#: Edges are moved outward by this much of the image's width.
ROUNDING = 2.0**-20
#: An edge function that is nowhere negative.
EVERYWHERE = (np.float32(0.0), np.float32(0.0), np.float32(1.0))


class Depths(NamedTuple):
    """The plane of a triangle: one over the depth at a pixel (u, v) is u wu + v wv + w, and `least` or more."""

    wu: float
    wv: float
    w: float
    least: np.float32


@kernel()
def draw_triangles(
    q: np.ndarray,
    triangles: np.ndarray,
    chosen: np.ndarray,
    face: Face,
    pixels: Pixels,
    polygon: np.ndarray,
    covers: bool,
    inverse: np.ndarray,
    limit: np.ndarray,
) -> None:
    """Lower `inverse` to one over the largest depth, in each of some pixels, of each triangle that touches it.

    Args:
        q: (n, 3) float64 cell coordinates; triangles: (m, 3) int32; chosen: (k,) int32, those that are drawn.
        pixels: to their right up to LANES pixels may be changed too.
        polygon: (4, 2) float64 scratch.
        covers: also change limits of 0 to `face.farthest` where a triangle covers the pixel.
        inverse, limit: (r, r + LANES) float32.
    """
    for i in range(chosen.shape[0]):
        _draw(q, triangles, chosen[i], face, pixels, polygon, covers, inverse, limit)


@kernel(inline="always")
def _draw(
    q: np.ndarray, triangles: np.ndarray, t: int, face: Face, pixels: Pixels, polygon: np.ndarray, covers: bool,
    inverse: np.ndarray, limit: np.ndarray,
) -> None:  # fmt: skip
    """Draw triangle t."""
    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    resolution = face.resolution
    ua, va, za = to_face(q, a, face.number)
    ub, vb, zb = to_face(q, b, face.number)
    uc, vc, zc = to_face(q, c, face.number)
    corners = 3
    far = max(za, zb, zc)
    if min(za, zb, zc) >= CLIP:
        half = 0.5 * resolution
        ra, rb, rc = half / za, half / zb, half / zc
        ua, va, ub, vb, uc, vc = ua * ra, va * ra, ub * rb, vb * rb, uc * rc, vc * rc
        ua, va, ub, vb, uc, vc = ua + half, va + half, ub + half, vb + half, uc + half, vc + half
    else:
        corners, _, far = clip_triangle(q, a, b, c, face.number, resolution, polygon)
        if corners == 0:
            return
        ua, va, ub, vb, uc, vc = (
            polygon[0, 0], polygon[0, 1], polygon[1, 0], polygon[1, 1], polygon[2, 0], polygon[2, 1]
        )  # fmt: skip
    _, wu, wv, w = inverse_depth_plane(q, a, b, c, face.number, resolution)
    depths = Depths(wu, wv, w, np.float32(1.0 / far * (1.0 - 1e-6)))
    farthest = np.float32(face.farthest)
    for k in range(2, corners):
        if k == 3:
            ub, vb, uc, vc = uc, vc, polygon[3, 0], polygon[3, 1]
        _fill((ua, va), (ub, vb), (uc, vc), depths, pixels, covers, farthest, inverse, limit)


@kernel(inline="always")
def _fill(
    a: tuple[float, float], b: tuple[float, float], c: tuple[float, float], depths: Depths, pixels: Pixels,
    covers: bool, farthest: np.float32, inverse: np.ndarray, limit: np.ndarray,
) -> None:  # fmt: skip
    """Draw a triangle of the image, corners in pixel coordinates."""
    ua, va = a
    ub, vb = b
    uc, vc = c
    i0, i1, j0, j1 = pixels
    u0, u1 = min(ua, ub, uc), max(ua, ub, uc)
    v0, v1 = min(va, vb, vc), max(va, vb, vc)
    if u0 - SLACK > i1 + 1 or v0 - SLACK > j1 + 1 or u1 + SLACK < i0 or v1 + SLACK < j0:
        return
    first, last = int(max(u0 - SLACK, float(i0))), int(min(u1 + SLACK, float(i1)))
    row0, row1 = int(max(v0 - SLACK, float(j0))), int(min(v1 + SLACK, float(j1)))
    rounding = inverse.shape[0] * ROUNDING
    u, v = first + 0.5, row0 + 0.5
    turn = 1.0 if (ub - ua) * (vc - va) - (vb - va) * (uc - ua) >= 0.0 else -1.0
    far = u1 - u0 + v1 - v0 + 1.0
    shortest = far * (far / inverse.shape[0] + 2.0) * (2.0**-46 / ROUNDING)
    a0, b0, c0 = _edge(ua, va, ub, vb, u, v, turn, shortest)
    a1, b1, c1 = _edge(ub, vb, uc, vc, u, v, turn, shortest)
    a2, b2, c2 = _edge(uc, vc, ua, va, u, v, turn, shortest)
    wu, wv, w, least = depths
    here = wu * u + wv * v + w
    reach = abs(here) + abs(wu) * (last - first + 1) + abs(wv) * (row1 - row0 + 1)
    wx, wy, wc = np.float32(wu), np.float32(wv), np.float32(here - 0.5 * (abs(wu) + abs(wv)) - 2.0**-21 * reach)
    touching, covering, not_yet = np.float32(-0.5 - rounding), np.float32(-rounding), np.float32(0.0)
    low, high = np.float32(v0 - v), np.float32(v1 - v)
    for start in range(first, last + 1, LANES):
        x = np.float32(start - first)
        d0, d1, d2, dw = c0 + a0 * x, c1 + a1 * x, c2 + a2 * x, wc + wx * x
        width = np.float32(last - start)
        left, right = np.float32(u0 - 0.5 - start), np.float32(min(u1 - 0.5, float(last)) - start)
        for j in range(row0, row1 + 1):
            y = np.float32(j - row0)
            e0, e1, e2, ew = d0 + b0 * y, d1 + b1 * y, d2 + b2 * y, dw + wy * y
            row = inverse[j, start : start + LANES]
            for k in range(LANES):
                at = np.float32(k)
                f0, f1, f2, z = a0 * at + e0, a1 * at + e1, a2 * at + e2, wx * at + ew
                f0 = f0 if f0 < f1 else f1
                f0 = f0 if f0 < f2 else f2
                before = row[k]
                z = z if z > least else least
                z = z if z < before else before
                row[k] = z if (f0 >= touching) & (at <= width) else before
            if covers and low <= y <= high:
                limits = limit[j, start : start + LANES]
                for k in range(LANES):
                    at = np.float32(k)
                    f0, f1, f2 = a0 * at + e0, a1 * at + e1, a2 * at + e2
                    f0 = f0 if f0 < f1 else f1
                    f0 = f0 if f0 < f2 else f2
                    before = limits[k]
                    inside = (f0 >= covering) & (at >= left) & (at <= right)
                    limits[k] = farthest if inside & (before == not_yet) else before


@kernel(inline="always")
def _edge(
    ua: float, va: float, ub: float, vb: float, u: float, v: float, turn: float, shortest: float
) -> tuple[np.float32, np.float32, np.float32]:
    """The function of an edge (a, b, c): its gradient, |a| + |b| = 1, and its value at (u, v).

    turn: 1 where the triangle's inner side is to the left of the edge, -1 where it is to the right.
    shortest: what is not longer bounds nothing.
    """
    a, b = va - vb, ub - ua
    length = abs(a) + abs(b)
    if length <= shortest:
        return EVERYWHERE
    scale = turn / length
    a, b = a * scale, b * scale
    return np.float32(a), np.float32(b), np.float32(a * (u - ua) + b * (v - va))
