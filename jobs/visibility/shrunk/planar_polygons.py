"""Joins triangles of one plane into convex polygons: the occluders of the method of shrunk occluders.

Based on: J. Chhugani et al.: vLOD, IEEE TVCG 11(1), 2005, section 5.2: adjacent polygons are combined to form larger
occluders, since small ones shrink to nothing. Here only triangles of one plane and one drawable are, and only where
they form a convex polygon: then no side of it is shrunk that need not be.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel, kernel

#: Polygons have at most this many corners.
MOST_CORNERS = 8


@allocating_kernel()
def convex_polygons(
    vertices: np.ndarray, triangles: np.ndarray, triangle_drawable: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Join triangles two by two, then polygons two by two, as long as any pair makes a convex polygon.

    First triangles across sides that are the longest of both, which makes rectangles of the triangles of a grid; then
    polygons across sides along one axis after the other, which makes strips of these, and one polygon of the strips.

    Args:
        vertices: (n, 3) int32 grid coordinates below 2^24; triangles: (m, 3) int32, none without area;
        triangle_drawable: (m,) int32.

    Returns:
        corners: (k, MOST_CORNERS) int32 vertices, wound as the triangles; counts: (k,) int32 corners of each;
        first: (k,) int32 one triangle of each. Corners at which a side goes straight on are left out.

    Two normals are parallel where float64 cannot tell them apart, so a polygon may be bent by 10^-8 of a grid step.
    """
    m = triangles.shape[0]
    corners = np.empty((m, MOST_CORNERS), np.int32)
    counts = np.full(m, 3, np.int32)
    normal = np.empty((m, 3), np.float64)
    for t in range(m):
        for i in range(3):
            corners[t, i] = triangles[t, i]
        _normal(vertices, triangles[t, 0], triangles[t, 1], triangles[t, 2], normal, t)
    alive = np.ones(m, np.bool_)
    joined = np.zeros(m, np.int32)  # the last round in which the polygon was joined to another
    joint = np.empty(2 * MOST_CORNERS, np.int32)
    n = np.int64(vertices.shape[0])
    rounds, phase, idle = 0, 3, 0  # phase: the axis of the sides to join across; 3: the longest
    while idle < 3:
        rounds += 1
        found = False
        total = 0
        for p in range(m):
            total += counts[p] if alive[p] else 0
        keys = np.empty(total, np.int64)
        owners = np.empty(total, np.int32)
        k = 0
        for p in range(m):
            if alive[p]:
                for i in range(counts[p]):
                    keys[k] = corners[p, i] * n + corners[p, (i + 1) % counts[p]]
                    owners[k] = p
                    k += 1
        order = np.argsort(keys, kind="mergesort")
        keys = keys[order]
        for p in range(m):
            if not alive[p] or joined[p] == rounds:
                continue
            for i in range(counts[p]):
                if not _is_turn(vertices, corners, counts, p, i, phase):
                    continue
                back = corners[p, (i + 1) % counts[p]] * n + corners[p, i]
                k = np.searchsorted(keys, back)
                other = -1
                while k < total and keys[k] == back:
                    q = owners[order[k]]
                    if (
                        q != p and alive[q] and joined[q] != rounds
                        and triangle_drawable[q] == triangle_drawable[p] and _parallel(normal, p, q)
                    ):  # fmt: skip
                        other = q
                        break
                    k += 1
                if other < 0 or (
                    phase == 3
                    and not _is_longest(
                        vertices, corners, counts, other, corners[p, i], corners[p, (i + 1) % counts[p]]
                    )
                ):
                    continue
                size = _join(vertices, corners, counts, p, i, other, normal, joint)
                if size == 0:
                    continue
                for c in range(size):
                    corners[p, c] = joint[c]
                counts[p] = size
                alive[other] = False
                joined[p] = rounds
                found = True
                break
        if found:
            idle = 0
        else:
            idle += phase < 3
            phase = (phase + 1) % 3
    kept = np.flatnonzero(alive)
    return corners[kept], counts[kept], kept.astype(np.int32)


@kernel(inline="always")
def _squared_length(vertices: np.ndarray, a: int, b: int) -> float:
    x, y, z = (
        float(vertices[b, 0]) - vertices[a, 0], float(vertices[b, 1]) - vertices[a, 1],
        float(vertices[b, 2]) - vertices[a, 2],
    )  # fmt: skip
    return x * x + y * y + z * z


@kernel()
def _is_longest(vertices: np.ndarray, corners: np.ndarray, counts: np.ndarray, p: int, a: int, b: int) -> bool:
    """Whether a polygon is a triangle and no side of it is longer than a-b."""
    if counts[p] != 3:
        return False
    length = _squared_length(vertices, a, b)
    for i in range(counts[p]):
        if _squared_length(vertices, corners[p, i], corners[p, (i + 1) % counts[p]]) > length:
            return False
    return True


@kernel()
def _is_turn(vertices: np.ndarray, corners: np.ndarray, counts: np.ndarray, p: int, side: int, phase: int) -> bool:
    """Whether a side of a polygon may be joined across in a phase, see `convex_polygons`."""
    a, b = corners[p, side], corners[p, (side + 1) % counts[p]]
    if phase == 3:
        return _is_longest(vertices, corners, counts, p, a, b)
    x, y, z = (
        abs(float(vertices[b, 0]) - vertices[a, 0]), abs(float(vertices[b, 1]) - vertices[a, 1]),
        abs(float(vertices[b, 2]) - vertices[a, 2]),
    )  # fmt: skip
    return phase == (0 if x >= y and x >= z else (1 if y >= z else 2))


@kernel()
def _normal(vertices: np.ndarray, a: int, b: int, c: int, normal: np.ndarray, row: int) -> None:
    """Row `row` of normal: the triangle's, exact as all products stay below 2^53."""
    ux, uy, uz = (
        float(vertices[b, 0]) - vertices[a, 0], float(vertices[b, 1]) - vertices[a, 1],
        float(vertices[b, 2]) - vertices[a, 2],
    )  # fmt: skip
    vx, vy, vz = (
        float(vertices[c, 0]) - vertices[a, 0], float(vertices[c, 1]) - vertices[a, 1],
        float(vertices[c, 2]) - vertices[a, 2],
    )  # fmt: skip
    normal[row, 0] = uy * vz - uz * vy
    normal[row, 1] = uz * vx - ux * vz
    normal[row, 2] = ux * vy - uy * vx


@kernel(inline="always")
def _parallel(normal: np.ndarray, p: int, q: int) -> bool:
    """Whether two normals point the same way."""
    px, py, pz = normal[p, 0], normal[p, 1], normal[p, 2]
    qx, qy, qz = normal[q, 0], normal[q, 1], normal[q, 2]
    return py * qz == pz * qy and pz * qx == px * qz and px * qy == py * qx and px * qx + py * qy + pz * qz > 0.0


@kernel()
def _turn(vertices: np.ndarray, a: int, b: int, c: int, x: int, y: int) -> float:
    """Twice the signed area of a triangle in the coordinates x and y, exact."""
    ux, uy = float(vertices[b, x]) - vertices[a, x], float(vertices[b, y]) - vertices[a, y]
    vx, vy = float(vertices[c, x]) - vertices[b, x], float(vertices[c, y]) - vertices[b, y]
    return ux * vy - uy * vx


@kernel()
def _join(
    vertices: np.ndarray,
    corners: np.ndarray,
    counts: np.ndarray,
    p: int,
    side: int,
    other: int,
    normal: np.ndarray,
    joint: np.ndarray,
) -> int:
    """Join polygon p across its side to the other polygon, which has the same side reversed.

    joint: (2 MOST_CORNERS,) int32, receives the corners. Returns their number, 0 where the result is not convex or has
    too many. Both lie on opposite sides of their common side, so they do not overlap, and it is enough that the two
    corners at its ends are convex.
    """
    np_, no = counts[p], counts[other]
    start = corners[p, side]
    place = 0
    while not (corners[other, (place + 1) % no] == start and corners[other, place] == corners[p, (side + 1) % np_]):
        place += 1
        if place == no:
            return 0
    size = 0
    for k in range(np_):  # from the end of the common side around p to its start
        joint[size] = corners[p, (side + 1 + k) % np_]
        size += 1
    for k in range(no - 2):  # around the other
        joint[size] = corners[other, (place + 2 + k) % no]
        size += 1
    nx, ny, nz = abs(normal[p, 0]), abs(normal[p, 1]), abs(normal[p, 2])
    flat = 0 if nx >= ny and nx >= nz else (1 if ny >= nz else 2)
    x, y = (flat + 1) % 3, (flat + 2) % 3
    sign = 1.0 if normal[p, flat] > 0 else -1.0
    first = _turn(vertices, joint[size - 1], joint[0], joint[1], x, y) * sign
    last = _turn(vertices, joint[np_ - 2], joint[np_ - 1], joint[np_ % size], x, y) * sign
    if first < 0.0 or last < 0.0:
        return 0
    if last == 0.0:
        for k in range(np_ - 1, size - 1):
            joint[k] = joint[k + 1]
        size -= 1
    if first == 0.0:
        for k in range(size - 1):
            joint[k] = joint[k + 1]
        size -= 1
    return size if 3 <= size <= MOST_CORNERS else 0
