"""What a level's vertices carry: normals with creases kept, and colours; vertices are split where these differ.

Everything is worked out per corner of a triangle first; then corners with the same position, normal and colour become
one vertex.

Based on: G. Thürmer, C. A. Wüthrich, Computing vertex normals from polygonal facets, Journal of Graphics Tools 3(1),
1998 (weights by corner angle, here times area).
"""

from __future__ import annotations

import numpy as np

from jobs.detail.bounds.closest import Surface, closest, closest_weights
from jobs.detail.collapsing.face_normals import arc_cosine
from jobs.objects.components import find, unite
from jobs.objects.weld import mix, table_size
from storage.base.kernels import allocating_kernel

#: How far corners' colours may differ, per channel, and still be one vertex in coarser levels.
SAME_COLOUR = 20
#: Where a corner of a coarser level takes its colour: this far from the corner towards the triangle's centre.
INSET = 0.2


@allocating_kernel()
def corner_normals(
    points: np.ndarray, triangles: np.ndarray, twin: np.ndarray, normals: np.ndarray, areas: np.ndarray, crease: float
) -> np.ndarray:
    """Unit normals (3 m, 3) float32 of the corners of triangles (m, 3) int32 over points (n, 3) int32.

    Around a vertex, corners are averaged as far as they can be reached across paired edges (twin (3 m,)) whose
    triangles' unit normals (m, 3) have a cosine of at least `crease`. areas (m,): twice the triangles' areas.
    """
    corners = 3 * len(triangles)
    group = np.arange(corners).astype(np.int32)
    for h in range(corners):
        o = twin[h]
        if o <= h:
            continue
        t, s = h // 3, o // 3
        if normals[t, 0] * normals[s, 0] + normals[t, 1] * normals[s, 1] + normals[t, 2] * normals[s, 2] >= crease:
            unite(group, h, 3 * s + (o + 1) % 3)
            unite(group, 3 * t + (h + 1) % 3, o)
    total = np.zeros((corners, 3))
    for c in range(corners):
        t, e = c // 3, c % 3
        a, b, d = triangles[t, e], triangles[t, (e + 1) % 3], triangles[t, (e + 2) % 3]
        dot, uu, vv = 0.0, 0.0, 0.0
        for i in range(3):
            u = np.float64(points[b, i]) - points[a, i]
            v = np.float64(points[d, i]) - points[a, i]
            dot += u * v
            uu += u * u
            vv += v * v
        weight = areas[t]
        if uu > 0.0 and vv > 0.0:
            weight *= arc_cosine(dot / np.sqrt(uu * vv))
        root = find(group, c)
        for i in range(3):
            total[root, i] += weight * normals[t, i]
    result = np.empty((corners, 3), np.float32)
    for c in range(corners):
        t, root = c // 3, find(group, c)
        x, y, z = total[root, 0], total[root, 1], total[root, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0 and x * normals[t, 0] + y * normals[t, 1] + z * normals[t, 2] > 0.0:
            result[c, 0], result[c, 1], result[c, 2] = x / length, y / length, z / length
        else:
            for i in range(3):
                result[c, i] = normals[t, i]
    return result


@allocating_kernel()
def keep_given_normals(computed: np.ndarray, given: np.ndarray, vertex: np.ndarray, normals: np.ndarray) -> None:
    """Overwrite computed corner normals (3 m, 3) float32 by the file's, where those are sane.

    given (n, 3) float32 per vertex of the file, vertex (3 m,) the file's vertex of each corner, normals (m, 3) the
    triangles' own. Sane: about unit length, and not on the triangle's far side.
    """
    for c in range(len(vertex)):
        v, t = vertex[c], c // 3
        x, y, z = np.float64(given[v, 0]), np.float64(given[v, 1]), np.float64(given[v, 2])
        length2 = x * x + y * y + z * z
        if 0.9 < length2 < 1.1 and x * normals[t, 0] + y * normals[t, 1] + z * normals[t, 2] > 0.0:
            length = np.sqrt(length2)
            computed[c, 0], computed[c, 1], computed[c, 2] = x / length, y / length, z / length


@allocating_kernel()
def take_over_border_normals(
    computed: np.ndarray,
    triangles: np.ndarray,
    normals: np.ndarray,
    held: np.ndarray,
    finest: np.ndarray,
    finest_triangles: np.ndarray,
    locked: np.ndarray,
    crease: float,
) -> None:
    """Overwrite corner normals (3 m, 3) float32 at the border to other pieces by those of the finest level.

    They were averaged across the border, so shading shows no seam there. triangles (m, 3) int32 and their unit normals
    (m, 3), finest (3 m0, 3) float32 corner normals of finest_triangles (m0, 3) int32; vertex held[i] of the level is
    vertex locked[i] of the finest. Of a vertex's normals the one nearest to the triangle's own is taken, if its cosine
    is at least `crease`.
    """
    if len(locked) == 0:
        return
    place = np.full(max(finest_triangles.max(), locked.max()) + 1, -1, np.int32)
    for i in range(len(locked)):
        place[locked[i]] = i
    start = np.zeros(len(locked) + 1, np.int64)
    for c in range(3 * len(finest_triangles)):
        i = place[finest_triangles[c // 3, c % 3]]
        if i >= 0:
            start[i + 1] += 1
    for i in range(len(locked)):
        start[i + 1] += start[i]
    filled = start[:-1].copy()
    corners = np.empty(start[-1], np.int64)
    for c in range(3 * len(finest_triangles)):
        i = place[finest_triangles[c // 3, c % 3]]
        if i >= 0:
            corners[filled[i]] = c
            filled[i] += 1
    where = np.full(max(triangles.max(), held.max()) + 1, -1, np.int32)
    for i in range(len(held)):
        where[held[i]] = i
    for c in range(3 * len(triangles)):
        t, i = c // 3, where[triangles[c // 3, c % 3]]
        if i < 0:
            continue
        best, chosen = crease, np.int64(-1)
        for k in range(start[i], start[i + 1]):
            o = corners[k]
            cosine = finest[o, 0] * normals[t, 0] + finest[o, 1] * normals[t, 1] + finest[o, 2] * normals[t, 2]
            if cosine > best:
                best, chosen = cosine, o
        if chosen >= 0:
            for e in range(3):
                computed[c, e] = finest[chosen, e]


@allocating_kernel()
def sampled_colours(level: Surface, finest: Surface, finest_colours: np.ndarray) -> np.ndarray:
    """Colours (3 m, 4) uint8 for the corners of a coarser level, from the closest places of the finest one.

    finest_colours (3 m0, 4) uint8 per corner. Corners look a little inward, so that the two sides of a boundary between
    materials keep their own colours; corners around a vertex that differ by less than SAME_COLOUR become equal.
    The result is in the order of the level's triangles as given, not of its surface.
    """
    m = len(level.triangles)
    query = np.empty(128, np.int32)
    colours = np.empty((3 * m, 4), np.uint8)
    hint = 0
    for s in range(m):
        t = level.source[s]
        for e in range(3):
            p = np.zeros(3)
            for i in range(3):
                centre = 0.0
                for k in range(3):
                    centre += level.points[level.triangles[s, k], i]
                own = level.points[level.triangles[s, e], i]
                p[i] = own + INSET * (centre / 3.0 - own)
            hint, _ = closest(finest.tree, query, p[0], p[1], p[2], hint, 0.0)
            _, v, w = closest_weights(finest.corners, hint, p[0], p[1], p[2])
            f = 3 * finest.source[hint]
            for i in range(4):
                mixed = (
                    (1.0 - v - w) * finest_colours[f, i] + v * finest_colours[f + 1, i] + w * finest_colours[f + 2, i]
                )
                colours[3 * t + e, i] = np.uint8(min(max(np.floor(mixed + 0.5), 0.0), 255.0))
    first = np.full((len(level.points), 4), -1, np.int32)  # up to four colours' first corners per vertex
    vertex = np.empty(3 * m, np.int32)
    for s in range(m):
        for e in range(3):
            vertex[3 * level.source[s] + e] = level.triangles[s, e]
    for c in range(3 * m):
        for place in range(4):
            o = first[vertex[c], place]
            if o < 0:
                first[vertex[c], place] = c
                break
            apart = np.int64(0)
            for i in range(4):
                apart = max(apart, abs(np.int64(colours[o, i]) - np.int64(colours[c, i])))
            if apart <= SAME_COLOUR:
                for i in range(4):
                    colours[c, i] = colours[o, i]
                break
    return colours


@allocating_kernel()
def build_vertices(
    points: np.ndarray, triangles: np.ndarray, start: np.ndarray, normals: np.ndarray, colours: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Vertices for the corners of each group of triangles start (groups + 1,): one per position, normal and colour.

    points (w, 3) int32, triangles (m, 3) int32, normals (3 m, 3) float32, colours (3 m, 4) uint8 per corner.
    Returns positions (n, 3) int32, normals (n, 3) float32, colours (n, 4) uint8, triangles (m, 3) uint32 numbered from
    each group's first vertex, and first vertices (groups + 1,) int64. Vertices are in the order of first use.
    """
    m = len(triangles)
    size = table_size(3 * m)
    table = np.full(size, -1, np.int32)
    corner_of = np.empty(3 * m, np.int32)
    out = np.empty((m, 3), np.uint32)
    vertex_start = np.zeros(len(start), np.int64)
    count = 0
    for g in range(len(start) - 1):
        vertex_start[g] = count
        for c in range(3 * start[g], 3 * start[g + 1]):
            v = triangles[c // 3, c % 3]
            key = (np.int64(v) << 28) ^ (np.int64(colours[c, 0]) << 16) ^ (np.int64(colours[c, 1]) << 8)
            key ^= np.int64(colours[c, 2]) ^ (np.int64(normals[c, 0] * 511.0 + 512.0) << 20)
            key ^= (np.int64(normals[c, 1] * 511.0 + 512.0) << 10) ^ np.int64(normals[c, 2] * 511.0 + 512.0)
            slot = mix(key) & (size - 1)
            while True:
                o = table[slot]
                if o < 0:
                    table[slot] = count
                    corner_of[count] = c
                    o = count
                    count += 1
                    break
                d = corner_of[o]
                if (
                    o >= vertex_start[g]
                    and triangles[d // 3, d % 3] == v
                    and normals[d, 0] == normals[c, 0]
                    and normals[d, 1] == normals[c, 1]
                    and normals[d, 2] == normals[c, 2]
                    and colours[d, 0] == colours[c, 0]
                    and colours[d, 1] == colours[c, 1]
                    and colours[d, 2] == colours[c, 2]
                    and colours[d, 3] == colours[c, 3]
                ):
                    break
                slot = (slot + 1) & (size - 1)
            out[c // 3, c % 3] = o - vertex_start[g]
    vertex_start[len(start) - 1] = count
    out_positions = np.empty((count, 3), np.int32)
    out_normals = np.empty((count, 3), np.float32)
    out_colours = np.empty((count, 4), np.uint8)
    for v in range(count):
        c = corner_of[v]
        for i in range(3):
            out_positions[v, i] = points[triangles[c // 3, c % 3], i]
            out_normals[v, i] = normals[c, i]
        for i in range(4):
            out_colours[v, i] = colours[c, i]
    return out_positions, out_normals, out_colours, out, vertex_start
