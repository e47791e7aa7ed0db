"""A bound by covering: how far a triangle T lies from a surface that extends above all of it.

Seen along T's normal, take any set C of triangles of the surface. An edge of C's rim is one that not exactly two of C's
triangles share. Where no edge of the rim is seen in front of a convex region, each two points of the region (of those
that no edge is seen in front of) lie behind the same number of C's triangles, modulo two: on the way from one to the
other the number only changes where an edge is crossed, and at an edge inside C by 0 or 2. If that number is odd for one
point, it is so for all, so that each point of the region has a point of C straight above or below it, no farther than
the largest height of C above the region. C is found by a flood that crosses every edge seen in front of the region.

The region is T made slightly smaller, for the surface often ends or turns away right at its edges; how far its points
may be from the region's is added to the bound. Rounding moves what is seen by about 1e-15 of the meshes' extent: edges
that come nearer to the region than TOLERANCE are taken to be in front of it.

Based on: the degree modulo two of a piecewise linear map, e.g. J. Milnor, Topology from the Differentiable Viewpoint,
1965, section 4; compare J. Cohen, D. Manocha, M. Olano, Simplifying Polygonal Models Using Successive Mappings,
IEEE Visualization 1997 (bounds by projection onto a plane).
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import kernel

#: T shrinks by at most this part of the error that is allowed ...
MARGIN = 0.02
#: ... and at least so much that its edges move by this (in the meshes' units, grid steps); else there is no bound.
THINNEST = 1e-4
#: Edges that come nearer than this to the region count as in front of it.
TOLERANCE = 1e-6
#: Where it is looked whether the number is odd: weights of T's corners, such that no edge is there by chance.
PROBES = ((0.4371, 0.3418, 0.2211), (0.2809, 0.2623, 0.4568))


@kernel()
def covered(
    points: np.ndarray,
    corner: np.ndarray,
    other: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    limit: float,
    seen: np.ndarray,
    stamp: int,
    queue: np.ndarray,
    count: int,
    polygon: np.ndarray,
) -> float:
    """How far the triangle `corner` (3,) of `points` (n, 3) lies from a surface, at most; infinite if above `limit`.

    The surface: `other` (k, 3), triangles (m, 3) int32 and twin (3 m,) int32. queue (m,) int32: where the flood begins,
    `count` triangles, each marked with `stamp` in seen (m,) int32. polygon (2, 16, 3): scratch.
    """
    ax, ay, az = points[corner[0], 0], points[corner[0], 1], points[corner[0], 2]
    ux, uy, uz = points[corner[1], 0] - ax, points[corner[1], 1] - ay, points[corner[1], 2] - az
    vx, vy, vz = points[corner[2], 0] - ax, points[corner[2], 1] - ay, points[corner[2], 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area = np.sqrt(nx * nx + ny * ny + nz * nz)
    base = np.sqrt(ux * ux + uy * uy + uz * uz)
    if not (area > 0.0 and base > 0.0):
        return np.inf
    nx, ny, nz = nx / area, ny / area, nz / area
    ux, uy, uz = ux / base, uy / base, uz / base
    wx, wy, wz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    # T in its plane: (0, 0), (base, 0), (cx, cy)
    cx, cy = vx * ux + vy * uy + vz * uz, vx * wx + vy * wy + vz * wz
    opposite_a = np.sqrt((cx - base) * (cx - base) + cy * cy)
    opposite_b = np.sqrt(cx * cx + cy * cy)
    around = base + opposite_a + opposite_b
    inner = area / around  # radius of the inscribed circle
    mx, my = (opposite_b * base + base * cx) / around, base * cy / around  # and its centre
    far2 = max(mx * mx + my * my, (mx - base) ** 2 + my * my, (mx - cx) ** 2 + (my - cy) ** 2)
    share = min(MARGIN * limit / np.sqrt(far2), 0.5)
    if share * inner < THINNEST:
        return np.inf
    margin = share * np.sqrt(far2)
    allowed = limit - margin
    keep = 1.0 - share
    px, py = mx + keep * (0.0 - mx), my + keep * (0.0 - my)
    qx, qy = mx + keep * (base - mx), my + keep * (0.0 - my)
    rx, ry = mx + keep * (cx - mx), my + keep * (cy - my)
    # inward normals of the region's edges p q, q r, r p; the region is where all three are at least 0
    e0x, e0y = 0.0, 1.0
    e1x, e1y = -cy / opposite_a, (cx - base) / opposite_a
    e2x, e2y = cy / opposite_b, -cx / opposite_b
    o0 = e0x * px + e0y * py
    o1 = e1x * qx + e1y * qy
    o2 = e2x * rx + e2y * ry
    s0x = PROBES[0][1] * base + PROBES[0][2] * cx
    s0y = PROBES[0][2] * cy
    s1x = PROBES[1][1] * base + PROBES[1][2] * cx
    s1y = PROBES[1][2] * cy
    sure0, sure1, odd0, odd1 = True, True, False, False
    height = 0.0
    at = 0
    while at < count:
        k = queue[at]
        at += 1
        # the triangle's corners in T's plane, and their heights above it
        x = other[triangles[k, 0], 0] - ax
        y = other[triangles[k, 0], 1] - ay
        z = other[triangles[k, 0], 2] - az
        x0, y0, z0 = x * ux + y * uy + z * uz, x * wx + y * wy + z * wz, x * nx + y * ny + z * nz
        x = other[triangles[k, 1], 0] - ax
        y = other[triangles[k, 1], 1] - ay
        z = other[triangles[k, 1], 2] - az
        x1, y1, z1 = x * ux + y * uy + z * uz, x * wx + y * wy + z * wz, x * nx + y * ny + z * nz
        x = other[triangles[k, 2], 0] - ax
        y = other[triangles[k, 2], 1] - ay
        z = other[triangles[k, 2], 2] - az
        x2, y2, z2 = x * ux + y * uy + z * uz, x * wx + y * wy + z * wz, x * nx + y * ny + z * nz
        highest = max(abs(z0), abs(z1), abs(z2))
        if highest > allowed:
            polygon[0, 0, 0], polygon[0, 0, 1], polygon[0, 0, 2] = x0, y0, z0
            polygon[0, 1, 0], polygon[0, 1, 1], polygon[0, 1, 2] = x1, y1, z1
            polygon[0, 2, 0], polygon[0, 2, 1], polygon[0, 2, 2] = x2, y2, z2
            n = _clipped(polygon, 3, 0, e0x, e0y, o0)
            n = _clipped(polygon, n, 1, e1x, e1y, o1)
            n = _clipped(polygon, n, 0, e2x, e2y, o2)
            highest = 0.0
            for i in range(n):
                highest = max(highest, abs(polygon[1, i, 2]))
            if highest > allowed:
                return np.inf
        height = max(height, highest)
        # twice the areas with the probes, by the edges' lengths: distances from the edges' lines
        l0 = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
        l1 = np.sqrt((x2 - x1) ** 2 + (y2 - y1) ** 2)
        l2 = np.sqrt((x0 - x2) ** 2 + (y0 - y2) ** 2)
        if sure0:
            where = _inside(x0, y0, x1, y1, x2, y2, l0, l1, l2, s0x, s0y)
            odd0 = odd0 != (where == 1)
            sure0 = where != 0
        if sure1:
            where = _inside(x0, y0, x1, y1, x2, y2, l0, l1, l2, s1x, s1y)
            odd1 = odd1 != (where == 1)
            sure1 = where != 0
        d00, d01, d02 = e0x * x0 + e0y * y0 - o0, e1x * x0 + e1y * y0 - o1, e2x * x0 + e2y * y0 - o2
        d10, d11, d12 = e0x * x1 + e0y * y1 - o0, e1x * x1 + e1y * y1 - o1, e2x * x1 + e2y * y1 - o2
        d20, d21, d22 = e0x * x2 + e0y * y2 - o0, e1x * x2 + e1y * y2 - o1, e2x * x2 + e2y * y2 - o2
        for e in range(3):
            if e == 0:
                out = max(d00, d10) < -TOLERANCE or max(d01, d11) < -TOLERANCE or max(d02, d12) < -TOLERANCE
                fx, fy, tx, ty, length = x0, y0, x1, y1, l0
            elif e == 1:
                out = max(d10, d20) < -TOLERANCE or max(d11, d21) < -TOLERANCE or max(d12, d22) < -TOLERANCE
                fx, fy, tx, ty, length = x1, y1, x2, y2, l1
            else:
                out = max(d20, d00) < -TOLERANCE or max(d21, d01) < -TOLERANCE or max(d22, d02) < -TOLERANCE
                fx, fy, tx, ty, length = x2, y2, x0, y0, l2
            if out:
                continue
            tx, ty = tx - fx, ty - fy
            a = tx * (py - fy) - ty * (px - fx)
            b = tx * (qy - fy) - ty * (qx - fx)
            c = tx * (ry - fy) - ty * (rx - fx)
            near = TOLERANCE * length
            if min(a, b, c) > near or max(a, b, c) < -near:
                continue
            beyond = twin[3 * k + e]
            if beyond < 0:
                return np.inf
            beyond = beyond // 3
            if seen[beyond] != stamp:
                seen[beyond] = stamp
                queue[count] = beyond
                count += 1
    if (sure0 and odd0) or (not sure0 and sure1 and odd1):
        return height + margin + TOLERANCE
    return np.inf


@kernel()
def _inside(
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    x2: float,
    y2: float,
    l0: float,
    l1: float,
    l2: float,
    x: float,
    y: float,
) -> int:
    """1 where a point lies inside a triangle in the plane, with edges of lengths l0, l1, l2; -1 outside; 0 unclear."""
    a = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
    b = (x2 - x1) * (y - y1) - (y2 - y1) * (x - x1)
    c = (x0 - x2) * (y - y2) - (y0 - y2) * (x - x2)
    above = int(a > TOLERANCE * l0) + int(b > TOLERANCE * l1) + int(c > TOLERANCE * l2)
    below = int(a < -TOLERANCE * l0) + int(b < -TOLERANCE * l1) + int(c < -TOLERANCE * l2)
    if above == 3 or below == 3:
        return 1
    if above > 0 and below > 0:
        return -1
    return 0


@kernel()
def _clipped(polygon: np.ndarray, n: int, side: int, ex: float, ey: float, offset: float) -> int:
    """Clip the n corners polygon[side] to ex x + ey y >= offset, into polygon[1 - side]; how many corners are left."""
    count = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        f = ex * polygon[side, i, 0] + ey * polygon[side, i, 1] - offset
        g = ex * polygon[side, j, 0] + ey * polygon[side, j, 1] - offset
        if f >= 0.0:
            for c in range(3):
                polygon[1 - side, count, c] = polygon[side, i, c]
            count += 1
        if (f < 0.0 < g) or (g < 0.0 < f):
            s = f / (f - g)
            for c in range(3):
                polygon[1 - side, count, c] = polygon[side, i, c] + s * (polygon[side, j, c] - polygon[side, i, c])
            count += 1
    return count
