"""What goes into edge collapses, and what comes out: rims and locks added, collapses replayed, the result cleaned.

Based on: M. Garland, P. S. Heckbert, Surface Simplification Using Quadric Error Metrics, SIGGRAPH 1997 (planes at right
angles to the surface along its borders).
"""

from __future__ import annotations

import numpy as np

from jobs.detail.normal_cone import face_normals
from jobs.objects.weld import OPEN, is_degenerate, mix, table_size, weld
from storage.kernels import allocating_kernel

#: Two triangles whose normals have a cosine below this turn back on themselves: their edge is a rim.
FOLD = -0.9
#: fast-simplification does not move a vertex where a triangle's corner has a cosine beyond this, either way.
STIFF = 0.999


@allocating_kernel()
def scaled_with_rims(
    grid_points: np.ndarray, triangles: np.ndarray, twin: np.ndarray, locked: np.ndarray, rims: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, int]:
    """What is handed to fast-simplification: the mesh, scaled and centred, behind the triangles added to hold it.

    grid_points (n, 3) int32, triangles (m, 3) int32, twin (3 m,) int32, locked: indices of vertices that must stay.
    Returns points (n + ..., 3) float64, triangles (... + m, 3) int32 (added ones first), the centre (3,) and the scale:
    points = (grid_points - centre) * scale; and how many of the added triangles the library will not take out itself.
    Most it does, at no cost: it pulls their tips to an end of the edge. It never touches a vertex at a very sharp or
    blunt corner of a triangle.
    """
    n, m = len(grid_points), len(triangles)
    centre = np.zeros(3)
    for i in range(3):
        low, high = np.int64(grid_points[0, i]), np.int64(grid_points[0, i])
        for p in range(n):
            low = min(low, np.int64(grid_points[p, i]))
            high = max(high, np.int64(grid_points[p, i]))
        centre[i] = (low + high) // 2
    points = np.empty((n, 3))
    for p in range(n):
        for i in range(3):
            points[p, i] = grid_points[p, i] - centre[i]
    total = 0.0
    for t in range(m):
        for e in range(3):
            a, b = triangles[t, e], triangles[t, (e + 1) % 3]
            x, y, z = points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], points[a, 2] - points[b, 2]
            total += np.sqrt(x * x + y * y + z * z)
    scale = 3 * m / total
    normals, _ = face_normals(points, triangles)

    held = np.zeros(3 * m, np.bool_)
    added = 0
    if rims:
        for h in range(3 * m):
            t, other = h // 3, twin[h]
            if other == OPEN:
                held[h] = True
            elif other > h:
                o = other // 3
                cosine = normals[t, 0] * normals[o, 0] + normals[t, 1] * normals[o, 1] + normals[t, 2] * normals[o, 2]
                held[h] = cosine < FOLD
            added += held[h]
    extra = added + 2 * len(locked)
    all_points = np.empty((n + extra, 3))
    all_triangles = np.empty((added + len(locked) + m, 3), np.int32)
    for p in range(n):
        for i in range(3):
            all_points[p, i] = points[p, i] * scale
    stiff = np.zeros(n, np.bool_)
    for h in range(3 * m):
        a, b, c = triangles[h // 3, h % 3], triangles[h // 3, (h + 1) % 3], triangles[h // 3, (h + 2) % 3]
        dot, uu, vv = 0.0, 0.0, 0.0
        for i in range(3):
            u, v = points[b, i] - points[a, i], points[c, i] - points[a, i]
            dot, uu, vv = dot + u * v, uu + u * u, vv + v * v
        if dot * dot > STIFF * STIFF * uu * vv:
            stiff[a] = True
    staying = len(locked)
    p, s = n, 0
    for h in range(3 * m):
        if not held[h]:
            continue
        t, e = h // 3, h % 3
        a, b = triangles[t, e], triangles[t, (e + 1) % 3]
        x, y, z = points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], points[a, 2] - points[b, 2]
        half = 0.5 * np.sqrt(x * x + y * y + z * z)
        for i in range(3):
            all_points[p, i] = (0.5 * (points[a, i] + points[b, i]) + half * normals[t, i]) * scale
        all_triangles[s, 0], all_triangles[s, 1], all_triangles[s, 2] = a, p, b
        staying += stiff[a] and stiff[b]
        p += 1
        s += 1
    for q in range(len(locked)):
        v = locked[q]
        for i in range(3):
            all_points[p, i] = all_points[v, i] + (0.5 if i == 0 else 0.0)
            all_points[p + 1, i] = all_points[v, i] + (0.5 if i == 1 else 0.0)
        all_triangles[s, 0], all_triangles[s, 1], all_triangles[s, 2] = v, p, p + 1
        p += 2
        s += 1
    all_triangles[s:] = triangles
    return all_points, all_triangles, centre, scale, staying


@allocating_kernel()
def survivors(triangles: np.ndarray, collapses: np.ndarray, vertices: int) -> np.ndarray:
    """Replay the collapses (k, 2): the indices, in order, of the triangles (m, 3) that are left."""
    into = np.arange(vertices).astype(np.int32)
    for c in range(len(collapses)):
        into[collapses[c, 1]] = collapses[c, 0]
    for v in range(vertices):
        root = v
        while into[root] != root:
            root = into[root]
        step = v
        while into[step] != root:
            following = into[step]
            into[step] = root
            step = following
    left = np.empty(len(triangles), np.int32)
    count = 0
    for t in range(len(triangles)):
        a, b, c = into[triangles[t, 0]], into[triangles[t, 1]], into[triangles[t, 2]]
        if b not in (a, c) and a != c:
            left[count] = t
            count += 1
    return left[:count].copy()


@allocating_kernel()
def cleaned(points: np.ndarray, triangles: np.ndarray, cancel: bool) -> tuple[np.ndarray, np.ndarray]:
    """Weld grid points (n, 3) int32; drop triangles without area and all but one of those that are equal.

    Equal means the same corners in the same winding: the two sides of a sheet both stay, unless `cancel` is set, for
    closed surfaces, where such pairs are what is left of a part that was pressed flat. Returns points (n', 3) int32
    in order of use and triangles (m', 3) int32.
    """
    ids, first = weld(points, np.zeros(len(points), np.int32))
    m = len(triangles)
    kept = np.empty((m, 3), np.int32)
    count = 0
    for t in range(m):
        a, b, c = ids[triangles[t, 0]], ids[triangles[t, 1]], ids[triangles[t, 2]]
        if not is_degenerate(points, first[a], first[b], first[c]):
            kept[count, 0], kept[count, 1], kept[count, 2] = a, b, c
            count += 1
    size = table_size(count)
    table = np.full(size, -1, np.int32)
    fate = np.ones(count, np.bool_)
    for t in range(count):
        a, b, c = np.int64(kept[t, 0]), np.int64(kept[t, 1]), np.int64(kept[t, 2])
        low, high = min(a, b, c), max(a, b, c)
        middle = a + b + c - low - high
        slot = mix((low << 31) ^ (middle << 15) ^ high) & (size - 1)
        while True:
            o = table[slot]
            if o < 0:
                table[slot] = t
                break
            same = True
            for e in range(3):
                v = kept[o, e]
                same = same and (v in (a, b, c))
            if same:
                even = (kept[o, 0] == a and kept[o, 1] == b) or (kept[o, 0] == b and kept[o, 1] == c)
                even = even or (kept[o, 0] == c and kept[o, 1] == a)
                if even:
                    fate[t] = False
                    break
                if cancel and fate[o]:
                    fate[t] = False
                    fate[o] = False
                    break
            slot = (slot + 1) & (size - 1)
    return _compacted(points, first, kept[:count], fate)


@allocating_kernel()
def _compacted(
    points: np.ndarray, first: np.ndarray, triangles: np.ndarray, fate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The triangles whose `fate` is true, over just the points they use."""
    number = np.full(len(first), -1, np.int32)
    out_points = np.empty((len(first), 3), np.int32)
    out = np.empty((len(triangles), 3), np.int32)
    used = 0
    count = 0
    for t in range(len(triangles)):
        if not fate[t]:
            continue
        for e in range(3):
            v = triangles[t, e]
            if number[v] < 0:
                number[v] = used
                for i in range(3):
                    out_points[used, i] = points[first[v], i]
                used += 1
            out[count, e] = number[v]
        count += 1
    return out_points[:used].copy(), out[:count].copy()
