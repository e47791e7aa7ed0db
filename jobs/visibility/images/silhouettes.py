"""The pixels that silhouettes spoil: up to which depth each pixel of a core stays hidden behind its set.

**One edge and one pixel.** A point y of an unsafe edge, at depth z, spoils a pixel for occludees at depth D where the
box y + [-alpha, alpha]^3 touches the pixel's pyramid, alpha = (D - z) / (D - 1); see `cube_faces` for the proof. With
[U0, U1] x [V0, V1] the pixel in the image and (u, v) the place of y, a point of the box lies on the near side of the
plane u' = U1 z' if and only if u - U1 z <= alpha (1 + |U1|), and so on for the other three planes. So the box can touch
the pyramid only if alpha is at least

    a(y) = max(0, (u - U1 z) / (1 + |U1|), (U0 z - u) / (1 + |U0|), and the same for v),

which D must exceed (z - a) / (1 - a) for if a < 1, and which no D does if a > 1. That is a maximum of functions that
are linear along the edge, so on each piece between the places where another of them is the largest D is a quotient of
linear functions, and least at one of the piece's ends. The least of these over the edge is the pixel's limit.

Based on: X. Décoret, G. Debunne, F. Sillion: Erosion Based Visibility Preprocessing, Eurographics Symposium on
Rendering 2003, for the erosion; see `occluders` for what the limits are used for.
"""

from __future__ import annotations

import numpy as np

from jobs.visibility.images.cube_faces import SLACK, Face, Pixels, at_depth, far_part, inflate_edge, sweep_extent
from jobs.visibility.surfaces.ranges import below
from storage.base.kernels import kernel

#: What a pixel hides is of no use where its limit is not at least this many times its depth.
USEFUL = 1.02
#: Limits are rounded down by this factor; rounding in the image is covered by cube_faces.SLACK.
DOWN = 1.0 - 1e-9


@kernel()
def lower_limits(
    q: np.ndarray,
    unsafe: np.ndarray,
    face: Face,
    pixels: Pixels,
    sweep: np.ndarray,
    rows: np.ndarray,
    inverse: np.ndarray,
    limit: np.ndarray,
) -> bool:
    """Lower `limit` in some pixels to the depth from which on an unsafe edge spoils each; 0 where that is useless.

    Args:
        q: (n, 3) float64 cell coordinates; unsafe: (u, 2) int32 vertices of edges.
        sweep: (4, 4) float64, rows: (r, 2) int32 scratch.
        inverse: (r, r or more) float32 one over the depth of the set in each pixel.
        limit: (r, r or more) float32: where it is 0 pixels are of no interest.

    Returns:
        False where nothing is left.
    """
    alive = find_rows(limit, pixels, rows)
    for k in range(unsafe.shape[0]):
        if alive == 0:
            return False
        alive -= _lower(q, unsafe[k, 0], unsafe[k, 1], face, pixels.j0, pixels.j1, sweep, rows, inverse, limit)
    return alive > 0


@kernel()
def find_rows(limit: np.ndarray, pixels: Pixels, rows: np.ndarray) -> int:
    """Fill `rows` with the first and the last pixel of each row whose limit is above 0; returns how many are."""
    count = 0
    for j in range(pixels.j0, pixels.j1 + 1):
        first, last = pixels.i1 + 1, pixels.i0 - 1
        for i in range(pixels.i0, pixels.i1 + 1):
            if limit[j, i] > 0.0:
                first = min(first, i)
                last = i
                count += 1
        rows[j, 0], rows[j, 1] = first, last
    return count


@kernel()
def _lower(
    q: np.ndarray,
    a: int,
    b: int,
    face: Face,
    j0: int,
    j1: int,
    sweep: np.ndarray,
    rows: np.ndarray,
    inverse: np.ndarray,
    limit: np.ndarray,
) -> int:
    """Lower the limits of the pixels in `rows` for one edge; returns how many pixels became useless."""
    resolution, farthest = face.resolution, face.farthest
    n = inflate_edge(q, a, b, face.number, resolution, farthest, sweep)
    useless = 0
    if n == 0:
        return 0
    far, ua, va, za, ub, vb, zb = far_part(q, a, b, face.number)
    half = 0.5 * resolution
    nearest = za
    if zb > farthest:  # as the sweep
        ub, vb, zb = at_depth(ua, va, za, ub, vb, zb, farthest)
    for k in range(n):
        all_depths = k == 0 and (n == 2 or not far)
        row0 = max(int(np.floor(max(min(sweep[2 * k, 2], sweep[2 * k + 1, 2]), 0.0))), j0)
        row1 = min(int(np.floor(min(max(sweep[2 * k, 3], sweep[2 * k + 1, 3]), resolution - 1.0))), j1)
        for j in range(row0, row1 + 1):
            least, most = rows[j, 0], rows[j, 1]
            if least > most:
                continue
            left, right = sweep_extent(sweep, 2 * k, 2 * k + 1, j)
            if left > right or left >= most + 1 or right < least:
                continue
            first = int(np.floor(left)) if left > least else least
            last = int(np.floor(right)) if right < most else most
            if all_depths:
                for i in range(first, last + 1):
                    if limit[j, i] > 0.0:
                        limit[j, i] = 0.0
                        useless += 1
                continue
            v_low, v_high = (j - SLACK) / half - 1.0, (j + 1.0 + SLACK) / half - 1.0
            low, high = 1.0 / (1.0 + abs(v_low)), 1.0 / (1.0 + abs(v_high))
            above_a, above_b = (va - v_high * za) * high, (vb - v_high * zb) * high
            under_a, under_b = (v_low * za - va) * low, (v_low * zb - vb) * low
            for i in range(first, last + 1):
                if not limit[j, i] > nearest:
                    continue  # no edge spoils what is nearer than it is
                u_low, u_high = (i - SLACK) / half - 1.0, (i + 1.0 + SLACK) / half - 1.0
                low, high = 1.0 / (1.0 + abs(u_low)), 1.0 / (1.0 + abs(u_high))
                depth = least_depth(
                    above_a, above_b, under_a, under_b,
                    (ua - u_high * za) * high, (ub - u_high * zb) * high,
                    (u_low * za - ua) * low, (u_low * zb - ub) * low,
                    za, zb, limit[j, i],
                )  # fmt: skip
                if depth < limit[j, i]:
                    if depth * inverse[j, i] <= USEFUL:
                        limit[j, i] = 0.0
                        useless += 1
                    else:
                        limit[j, i] = depth
    return useless


@kernel(inline="always")
def _depth_at(
    t: float,
    a0: float, a1: float, b0: float, b1: float, c0: float, c1: float, d0: float, d1: float, z0: float, z1: float,
) -> float:  # fmt: skip
    """The depth from which on the point at t spoils the pixel."""
    alpha = max(a0 + t * (a1 - a0), b0 + t * (b1 - b0), c0 + t * (c1 - c0), d0 + t * (d1 - d0), 0.0)
    z = z0 + t * (z1 - z0)
    return (z - alpha) / (1.0 - alpha) * DOWN if alpha < 1.0 else np.inf


@kernel()
def least_depth(
    a0: float, a1: float, b0: float, b1: float, c0: float, c1: float, d0: float, d1: float,
    z0: float, z1: float, enough: float,
) -> float:  # fmt: skip
    """The least depth from which on any point of an edge spoils a pixel; infinite where none does.

    a, b, c, d: the four functions of the module's docstring at both ends (a and b for v, c and d for u); z: the depths.
    Where the result is `enough` or more, anything so large may be returned.
    """
    t0, t1 = below(0.0, 1.0, a0, a1, 1.0)
    t0, t1 = below(t0, t1, b0, b1, 1.0)
    t0, t1 = below(t0, t1, c0, c1, 1.0)
    t0, t1 = below(t0, t1, d0, d1, 1.0)
    if t0 > t1:
        return np.inf
    # no point has less than the least of each function: is that enough already?
    da, db, dc, dd, dz = a1 - a0, b1 - b0, c1 - c0, d1 - d0, z1 - z0
    alpha = 0.0
    alpha = max(alpha, min(a0 + t0 * da, a0 + t1 * da))
    alpha = max(alpha, min(b0 + t0 * db, b0 + t1 * db))
    alpha = max(alpha, min(c0 + t0 * dc, c0 + t1 * dc))
    alpha = max(alpha, min(d0 + t0 * dd, d0 + t1 * dd))
    near = min(z0 + t0 * dz, z0 + t1 * dz)
    if alpha >= 1.0 or (near - alpha) >= enough * (1.0 - alpha):
        return np.inf
    least = min(
        _depth_at(t0, a0, a1, b0, b1, c0, c1, d0, d1, z0, z1), _depth_at(t1, a0, a1, b0, b1, c0, c1, d0, d1, z0, z1)
    )
    for k in range(8):
        if k == 0:
            over, under = da, -a0
        elif k == 1:
            over, under = db, -b0
        elif k == 2:
            over, under = dc, -c0
        elif k == 3:
            over, under = dd, -d0
        elif k == 4:
            over, under = da - dc, c0 - a0
        elif k == 5:
            over, under = da - dd, d0 - a0
        elif k == 6:
            over, under = db - dc, c0 - b0
        else:
            over, under = db - dd, d0 - b0
        if over != 0.0:
            t = under / over
            if t0 < t < t1:
                least = min(least, _depth_at(t, a0, a1, b0, b1, c0, c1, d0, d1, z0, z1))
    return least
