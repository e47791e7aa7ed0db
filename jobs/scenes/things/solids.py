"""Closed solids as arrays: boxes, prisms, plates with openings, tubes along routes, bodies of revolution, blobs.

Everything is made in scene coordinates with z up, in metres, wound counter-clockwise as seen from outside.
Every function makes all of its solids at once; none loops over triangles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def vec(x: float, y: float, z: float) -> Floats:
    """A point or a direction as an array (3,)."""
    return np.array((x, y, z), np.float64)


@dataclass(frozen=True)
class Mesh:
    """Triangles with a normal at every vertex."""

    positions: Floats  # (n, 3) metres, z up
    normals: Floats  # (n, 3) unit
    triangles: NDArray[np.uint32]  # (m, 3) indices into positions

    @property
    def count(self) -> int:
        """Triangles in the mesh."""
        return len(self.triangles)

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mesh:
        """The mesh shifted by (x, y, z) metres."""
        return Mesh(self.positions + vec(x, y, z), self.normals, self.triangles)

    def turned(self, matrix: ArrayLike) -> Mesh:
        """The mesh under a rotation `matrix` (3, 3)."""
        rotation = np.asarray(matrix, np.float64)
        return Mesh(self.positions @ rotation.T, self.normals @ rotation.T, self.triangles)


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh from several, in their order."""
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0] + [len(mesh.positions) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.triangles + np.uint32(start) for mesh, start in zip(meshes, starts, strict=True)]),
    )


def _cross(a: Floats, b: Floats) -> Floats:
    """The cross product along the last axis (numpy's own costs several times as much on short arrays)."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0], out[..., 1], out[..., 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return out


@lru_cache(maxsize=4096)
def turn_z(degrees: float) -> Floats:
    """The rotation (3, 3) about the vertical axis; exact for multiples of 90 degrees."""
    quarter, rest = divmod(degrees, 90.0)
    cosine, sine = (1.0, 0.0) if rest == 0 else (float(np.cos(np.radians(rest))), float(np.sin(np.radians(rest))))
    for _ in range(int(quarter) % 4):
        cosine, sine = -sine, cosine
    matrix = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) + 0.0
    matrix.flags.writeable = False
    return matrix


def copies(mesh: Mesh, shifts: ArrayLike) -> Mesh:
    """The mesh at each of `shifts` (k, 3), as one mesh."""
    offsets = np.asarray(shifts, np.float64).reshape(-1, 1, 3)
    count = len(offsets)
    positions = (mesh.positions + offsets).reshape(-1, 3)
    return Mesh(positions, _tiled(mesh.normals, count), _repeat(mesh.triangles, count, len(mesh.positions)))


def _tiled(rows: Floats, count: int) -> Floats:
    """`rows` (n, 3) repeated `count` times: (count * n, 3)."""
    return np.broadcast_to(rows, (count, *rows.shape)).reshape(-1, 3)


def _repeat(pattern: NDArray[np.uint32], count: int, stride: int) -> NDArray[np.uint32]:
    """`pattern` (m, 3) repeated for `count` solids of `stride` vertices each: (count * m, 3)."""
    starts = (np.arange(count, dtype=np.uint32) * np.uint32(stride))[:, None, None]
    return np.asarray((pattern[None] + starts).reshape(-1, 3), np.uint32)


# --------------------------------------------------------------------------------------------------- boxes

_BOX_NORMALS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)


@cache
def _box_pattern() -> tuple[NDArray[np.uint8], Floats, NDArray[np.uint32]]:
    """The 24 corners of a box (0 or 1 per axis), their normals, and its 12 triangles."""
    corners = []
    for normal in _BOX_NORMALS:
        axis = int(np.argmax(np.abs(normal)))
        side = 1 if normal[axis] > 0 else 0
        first, second = (axis + 1) % 3, (axis + 2) % 3
        ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
        for a, b in ring if side else ring[::-1]:
            corner = [0, 0, 0]
            corner[axis], corner[first], corner[second] = side, a, b
            corners.append(corner)
    quads = np.arange(24, dtype=np.uint32).reshape(6, 4)
    triangles = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return np.array(corners, np.uint8), np.repeat(_BOX_NORMALS, 4, axis=0), triangles


def boxes(lo: ArrayLike, hi: ArrayLike) -> Mesh:
    """Boxes with the corners `lo` and `hi` (k, 3): 12 triangles each. Equal coordinates stay equal exactly."""
    corners, normals, triangles = _box_pattern()
    ends = np.stack([np.asarray(lo, np.float64).reshape(-1, 3), np.asarray(hi, np.float64).reshape(-1, 3)], axis=1)
    positions = ends[:, corners, np.arange(3)].reshape(-1, 3)
    count = len(ends)
    return Mesh(positions, _tiled(normals, count), _repeat(triangles, count, 24))


def turned_boxes(centres: ArrayLike, halves: ArrayLike, axes: ArrayLike) -> Mesh:
    """Boxes about `centres` (k, 3) with half sizes `halves` (k, 3) along the columns of `axes` (k, 3, 3)."""
    corners, normals, triangles = _box_pattern()
    middle = np.asarray(centres, np.float64).reshape(-1, 1, 3)
    frame = np.asarray(axes, np.float64).reshape(-1, 3, 3)
    local = (corners * 2.0 - 1.0)[None] * np.asarray(halves, np.float64).reshape(-1, 1, 3)
    count = len(middle)
    frame = np.broadcast_to(frame, (count, 3, 3))
    positions = middle + np.einsum("kij,knj->kni", frame, np.broadcast_to(local, (count, 24, 3)))
    turned = np.einsum("kij,nj->kni", frame, normals)
    return Mesh(positions.reshape(-1, 3), turned.reshape(-1, 3), _repeat(triangles, count, 24))


# -------------------------------------------------------------------------------------------------- prisms


@cache
def _ears(outline: tuple[tuple[float, float], ...]) -> NDArray[np.uint32]:
    """Triangles (p - 2, 3) of a simple counter-clockwise polygon of p points, by ear clipping."""
    left = list(range(len(outline)))
    triangles = []

    def side(a: int, b: int, c: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = outline[a], outline[b], outline[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    while len(left) > 3:
        best = (-1.0, 0)
        for i in range(len(left)):
            a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
            area = side(a, b, c)
            if area <= 1e-12 or any(
                side(a, b, p) >= 0 and side(b, c, p) >= 0 and side(c, a, p) >= 0 for p in left if p not in (a, b, c)
            ):
                continue
            longest = max(math.dist(outline[p], outline[q]) for p, q in ((a, b), (b, c), (c, a)))
            best = max(best, (area / longest**2, i))
        i = best[1]
        triangles.append((left[i - 1], left[i], left[(i + 1) % len(left)]))
        del left[i]
    triangles.append((left[0], left[1], left[2]))
    return np.array(triangles, np.uint32)


def prisms(outline: ArrayLike, origins: ArrayLike, axes: ArrayLike, lengths: ArrayLike) -> Mesh:
    """Polygons `outline` (p, 2), counter-clockwise, pushed out along a straight line.

    Prism i starts at `origins[i]`; the columns of `axes[i]` (a rotation) are the outline's two directions and the
    direction of the push, `lengths[i]` metres far.
    """
    ring = np.asarray(outline, np.float64)
    points = len(ring)
    start = np.asarray(origins, np.float64).reshape(-1, 3)
    count = len(start)
    frame = np.broadcast_to(np.asarray(axes, np.float64).reshape(-1, 3, 3), (count, 3, 3))
    length = np.broadcast_to(np.asarray(lengths, np.float64).reshape(-1), (count,))
    near = np.concatenate([ring, np.zeros((points, 1))], axis=1)
    following = np.roll(np.arange(points), -1)
    edge = ring[following] - ring
    out = np.stack([edge[:, 1], -edge[:, 0], np.zeros(points)], axis=1)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    side = np.stack([near, near[following], near[following], near], axis=1).reshape(-1, 3)
    flat = np.concatenate([side, near, near])
    far = np.concatenate([np.tile([0.0, 0.0, 1.0, 1.0], points), np.zeros(points), np.ones(points)])
    normals = np.concatenate(
        [np.repeat(out, 4, axis=0), np.tile([0.0, 0.0, -1.0], (points, 1)), np.tile([0.0, 0.0, 1.0], (points, 1))]
    )
    quads = np.arange(4 * points, dtype=np.uint32).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    cap = _ears(tuple((x, y) for x, y in ring.tolist()))
    triangles = np.concatenate([quads, cap[:, ::-1] + np.uint32(4 * points), cap + np.uint32(5 * points)])
    local = flat[None] + far[None, :, None] * length[:, None, None] * np.array([0.0, 0.0, 1.0])
    positions = start[:, None] + np.einsum("kij,knj->kni", frame, local)
    turned = np.einsum("kij,nj->kni", frame, normals)
    return Mesh(positions.reshape(-1, 3), turned.reshape(-1, 3), _repeat(triangles, count, 6 * points))


def i_profile(width: float, height: float) -> Floats:
    """The outline (12, 2) of an I beam, centred, counter-clockwise."""
    flange, web, x, y = height * 0.09, width * 0.05, width / 2, height / 2
    right = [(x, -y), (x, -y + flange), (web, -y + flange), (web, y - flange), (x, y - flange), (x, y)]
    return np.array(right + [(-a, -b) for a, b in right], np.float64)


def frames_along(directions: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Floats:
    """Rotations (k, 3, 3) whose third column is the unit direction (k, 3) and whose second is nearest to `up`."""
    along = np.asarray(directions, np.float64).reshape(-1, 3)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    high = np.broadcast_to(np.asarray(up, np.float64), along.shape)
    steep = np.abs(np.sum(along * high, axis=1)) > 0.999
    high = np.where(steep[:, None], np.array([0.0, 1.0, 0.0]), high)
    first = _cross(high, along)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, _cross(along, first), along], axis=-1)


def beams(starts: ArrayLike, ends: ArrayLike, outline: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> Mesh:
    """Prisms of `outline` from `starts` to `ends` (k, 3), the outline's second axis towards `up`."""
    first, last = np.asarray(starts, np.float64).reshape(-1, 3), np.asarray(ends, np.float64).reshape(-1, 3)
    along = last - first
    return prisms(outline, first, frames_along(along, up), np.linalg.norm(along, axis=1))


# --------------------------------------------------------------------------------------- plates with openings

_PLATE_AXES = {"x": (1, 2, 0), "y": (0, 2, 1), "z": (0, 1, 2)}
_PLATE_CORNERS = np.array(  # per kind of face (front, back, +u, -u, +v, -v) its corners: steps in u, v and w
    [
        [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
        [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)],
        [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)],
        [(0, 0, 1), (0, 1, 1), (0, 1, 0), (0, 0, 0)],
        [(1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1)],
        [(1, 0, 1), (0, 0, 1), (0, 0, 0), (1, 0, 0)],
    ]
)
_PLATE_NORMALS = np.array([(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)], np.float64)


def plate(axis: str, us: ArrayLike, vs: ArrayLike, solid: ArrayLike, near: float, far: float) -> Mesh:
    """A plate across `axis` from `near` to `far`, solid in the cells of a grid and open elsewhere, without T-junctions.

    `us`, `vs`: ascending grid lines along the other two axes in their order (x before y before z);
    `solid` (len(us) - 1, len(vs) - 1) bool.
    """
    filled = np.asarray(solid, bool)
    padded = np.pad(filled, 1)
    inner = padded[1:-1, 1:-1]
    bare = [
        padded[2:, 1:-1],
        padded[:-2, 1:-1],
        padded[1:-1, 2:],
        padded[1:-1, :-2],
    ]  # the neighbours to +u, -u, +v, -v
    faces = np.stack([inner, inner, *(inner & ~beside for beside in bare)])
    kind, i, j = np.nonzero(faces)
    corners, normals = _PLATE_CORNERS[kind], _PLATE_NORMALS[kind]
    order = _PLATE_AXES[axis]
    positions, turned = np.empty((2, len(kind), 4, 3))
    positions[..., order[0]] = np.asarray(us, np.float64)[i[:, None] + corners[..., 0]]
    positions[..., order[1]] = np.asarray(vs, np.float64)[j[:, None] + corners[..., 1]]
    positions[..., order[2]] = np.array([near, far])[corners[..., 2]]
    turned[..., order] = normals[:, None]
    winding = [0, 1, 2, 0, 2, 3] if axis != "y" else [0, 2, 1, 0, 3, 2]
    triangles = np.arange(4 * len(kind), dtype=np.uint32).reshape(-1, 4)[:, winding].reshape(-1, 3)
    return Mesh(positions.reshape(-1, 3), turned.reshape(-1, 3), triangles)


def openings(
    span: tuple[float, float], height: tuple[float, float], holes: ArrayLike
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Grid lines and solid cells of a rectangle `span` x `height` with rectangular `holes` (k, 4): u0, u1, v0, v1."""
    cut = np.asarray(holes, np.float64).reshape(-1, 4)
    us = np.unique(np.concatenate([span, np.clip(cut[:, :2].ravel(), *span)]))
    vs = np.unique(np.concatenate([height, np.clip(cut[:, 2:].ravel(), *height)]))
    u, v = (us[1:] + us[:-1]) / 2, (vs[1:] + vs[:-1]) / 2
    inside_u = (u[None] > cut[:, :1]) & (u[None] < cut[:, 1:2])
    inside_v = (v[None] > cut[:, 2:3]) & (v[None] < cut[:, 3:])
    return us, vs, ~np.einsum("ku,kv->uv", inside_u, inside_v)


# -------------------------------------------------------------------------------------- bodies of revolution


def lathe(profile: Floats | Sequence[Sequence[float]], sectors: int, crease: float = 40.0) -> Mesh:
    """The body made by turning `profile` (p, 2), radius and height from bottom to top, about the z axis.

    The profile starts and ends on the axis (radius 0) or is a closed ring (first point repeated at the end, wound
    counter-clockwise in the radius-height plane). Corners sharper than `crease` degrees get split normals.
    """
    line = np.asarray(profile, np.float64)
    step = line[1:] - line[:-1]
    out = np.stack([step[:, 1], -step[:, 0]], axis=1)
    out /= np.sqrt(np.sum(out * out, axis=1, keepdims=True))
    sharp = np.sum(out[1:] * out[:-1], axis=1) <= math.cos(math.radians(crease))
    point = np.repeat(np.arange(len(line)), np.concatenate([[1], 1 + sharp, [1]]))  # of every ring of vertices
    joined = point[1:] != point[:-1]  # a strip of triangles joins a ring to the next one
    blend = np.zeros((len(point), 2))
    blend[:-1][joined] += out[point[:-1][joined]]
    blend[1:][joined] += out[point[:-1][joined]]
    blend /= np.sqrt(np.sum(blend * blend, axis=1, keepdims=True))
    angle = np.arange(sectors) * (2 * np.pi / sectors)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    positions, normals = np.empty((2, len(point), sectors, 3))
    for array, values in ((positions, line[point]), (normals, blend)):
        array[..., :2] = values[:, None, :1] * circle
        array[..., 2] = values[:, 1:]
    strip = np.nonzero(joined)[0]
    low = _quads(strip[line[point[strip], 0] > 0], sectors)[:, [0, 1, 2]]
    high = _quads(strip[line[point[strip + 1], 0] > 0], sectors)[:, [0, 2, 3]]
    triangles = np.concatenate([low, high]).astype(np.uint32)
    return Mesh(positions.reshape(-1, 3), normals.reshape(-1, 3), triangles)


def _quads(rings: NDArray[np.int64], sectors: int) -> NDArray[np.int64]:
    """Corners (k * sectors, 4) of the quads from each of `rings` (k,) to the following ring of `sectors` vertices."""
    here = rings[:, None] * sectors
    at = np.arange(sectors)
    following = np.where(at + 1 < sectors, at + 1, 0)
    corners = np.stack([here + at, here + following, here + following + sectors, here + at + sectors], axis=-1)
    return corners.reshape(-1, 4)


def cylinders(starts: ArrayLike, ends: ArrayLike, radii: ArrayLike, sides: int) -> Mesh:
    """Straight round bars from `starts` to `ends` (k, 3) of `radii` (k,): 4 sides - 4 triangles each."""
    first, last = np.asarray(starts, np.float64).reshape(-1, 3), np.asarray(ends, np.float64).reshape(-1, 3)
    return tubes(np.stack([first, last], axis=1), np.broadcast_to(radii, (len(first),)), 0.0, sides, 1)


def tubes(
    routes: Floats | Sequence[Sequence[Sequence[float]]], radii: ArrayLike, bend: float, sides: int, bend_steps: int
) -> Mesh:
    """Round pipes along `routes` (k, p, 3), rounded at inner points, smooth, with flat ends.

    The bends' radius is `bend` times the pipe's radius; the legs must be long enough for them.
    Triangles each: 2 sides (1 + (p - 2) (bend_steps + 1)) + 2 (sides - 2).
    """
    points = np.asarray(routes, np.float64)
    count, corners = points.shape[:2]
    radius = np.broadcast_to(np.asarray(radii, np.float64), (count,))
    legs = np.diff(points, axis=1)
    legs = legs / np.linalg.norm(legs, axis=2, keepdims=True)
    across = frames_along(legs[:, 0])[:, :, 0]
    centres = [points[:, :1]]
    crosses = [across[:, None]]
    alongs = [legs[:, :1]]
    for k in range(1, corners - 1):
        before, after = legs[:, k - 1], legs[:, k]
        axis = _cross(before, after)
        sine = np.linalg.norm(axis, axis=1, keepdims=True)
        axis /= sine
        turn = np.arctan2(sine[:, 0], np.sum(before * after, axis=1))
        size = bend * radius
        start = points[:, k] - before * (size * np.tan(turn / 2))[:, None]
        inward = _cross(axis, before)
        middle = start + inward * size[:, None]
        kept = np.sum(across * axis, axis=1, keepdims=True)
        turning = np.sum(across * inward, axis=1, keepdims=True)
        angle = turn[:, None, None] * (np.arange(bend_steps + 1) / bend_steps)[:, None]
        cosine, sine = np.cos(angle), np.sin(angle)
        inward, before, axis = inward[:, None], before[:, None], axis[:, None]
        out = inward * cosine - before * sine
        centres.append(middle[:, None] - out * size[:, None, None])
        crosses.append(axis * kept[:, None] + out * turning[:, None])
        alongs.append(before * cosine + inward * sine)
        across = crosses[-1][:, -1]
    centres.append(points[:, -1:])
    crosses.append(across[:, None])
    alongs.append(legs[:, -1:])
    centre, first, along = (np.concatenate(rows, axis=1) for rows in (centres, crosses, alongs))
    second = _cross(along, first)
    rings = centre.shape[1]
    angle = np.arange(sides) * (2 * np.pi / sides)
    out = (
        first[:, :, None] * np.cos(angle)[None, None, :, None] + second[:, :, None] * np.sin(angle)[None, None, :, None]
    )
    shell = centre[:, :, None] + out * radius[:, None, None, None]
    positions = np.concatenate([shell.reshape(count, -1, 3), shell[:, 0], shell[:, -1]], axis=1)
    ends = [np.broadcast_to(way[:, None], (count, sides, 3)) for way in (-along[:, 0], along[:, -1])]
    normals = np.concatenate([out.reshape(count, -1, 3), *ends], axis=1)
    wall = _quads(np.arange(rings - 1), sides)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    fan = np.arange(1, sides - 1)
    cap = np.stack([np.zeros_like(fan), fan, fan + 1], axis=1)
    total = rings * sides
    pattern = np.concatenate([wall, cap[:, ::-1] + total, cap + total + sides])
    return Mesh(
        positions.reshape(-1, 3), normals.reshape(-1, 3), _repeat(pattern.astype(np.uint32), count, total + 2 * sides)
    )


def tube_triangles(points: int, sides: int, bend_steps: int) -> int:
    """Triangles of one tube along a route of `points` points."""
    return 2 * sides * (1 + (points - 2) * (bend_steps + 1)) + 2 * (sides - 2)


def ring(radius: float, thickness: float, around: int, sides: int) -> Mesh:
    """A torus about the z axis with `radius` to the middle of a round section of radius `thickness`."""
    angle = np.linspace(0.0, 2 * np.pi, sides + 1)
    section = np.stack([radius + thickness * np.cos(angle), thickness * np.sin(angle)], axis=1)
    section[-1] = section[0]
    return lathe(section, around, crease=181.0)


# --------------------------------------------------------------------------------------------------- blobs


@cache
def _icosphere(subdivisions: int) -> tuple[Floats, NDArray[np.uint32]]:
    """Unit sphere: vertices and triangles (20 * 4^subdivisions)."""
    golden = (1 + 5**0.5) / 2
    corners = [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0)]
    vertices = np.array([np.roll(corner, turn) for turn in (0, 1, 2) for corner in corners], np.float64)
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    gaps = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    near = (gaps > 0.1) & (gaps < 1.1)
    found = [
        (a, b, c)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if near[a, b] & near[b, c] & near[a, c]
    ]
    triangles = np.array(found)
    p, q, r = (vertices[triangles[:, k]] for k in range(3))
    inward = np.sum(np.cross(q - p, r - p) * p, axis=1) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    for _ in range(subdivisions):
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        middle = vertices[unique].mean(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        ab, bc, ca = (inverse.reshape(-1, 3) + len(vertices)).T
        a, b, c = triangles.T
        triangles = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        vertices = np.concatenate([vertices, middle])
    return vertices, triangles.astype(np.uint32)


def blob(radii: ArrayLike, roughness: float, subdivisions: int, rng: np.random.Generator) -> Mesh:
    """A bumpy ellipsoid with half axes `radii` (3,), its radius varied by up to `roughness` (a fraction), smooth."""
    sphere, triangles = _icosphere(subdivisions)
    positions = sphere * (1 + roughness * rng.uniform(-1, 1, (len(sphere), 1))) * np.asarray(radii, np.float64)
    p, q, r = (positions[triangles[:, k]] for k in range(3))
    area = np.cross(q - p, r - p)
    normals = np.zeros_like(positions)
    for k in range(3):
        np.add.at(normals, triangles[:, k], area)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(positions, normals, triangles)


def sphere(radius: float, subdivisions: int) -> Mesh:
    """A sphere of 20 * 4^subdivisions triangles, smooth."""
    points, triangles = _icosphere(subdivisions)
    return Mesh(points * radius, points, triangles)
