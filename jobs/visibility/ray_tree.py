"""Rays against a soup, through a tree of boxes: what is met first, and what may be in the way.

The tree is built once for a soup. A cell prunes it to the drawables that stand in it (`prune`), so that rays never meet
what cannot be seen. Leaves hold a *bundle*, a few neighbouring triangles of one cluster. Halves have equally many
bundles, cut across the widest extent of their middles.

Everything is in grid units. Corners are integers of at most 24 bits, so differences of corners and the normals made of
them are exact in float64; a corner seen from a ray's start is rounded once.

Based on: the volumes that tell on which side of an edge a line passes, M. Shevtsov, A. Soupikov, A. Kapustin:
Ray-Triangle Intersection Algorithm for Modern CPU Architectures, GraphiCon 2007 (after Plücker).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.planes import plane_of
from storage.kernels import allocating_kernel, kernel

#: Boxes are grown by this many grid units, far more than slabs are rounded by.
GROWN = 0.5
#: A triangle is in the way also where exact arithmetic would see it this much beside it, relative to the lengths of
#: the factors: some thousand times float64's rounding.
MARGIN = 1e-12
#: What lies this near what is looked at, as a part of the ray, is in the same place: either of the two is drawn there.
SAME = 1e-9
#: Most triangles in a bundle.
BUNDLE = 8
#: What stands between the two ends of a segment: see `meets`.
APART, PERHAPS, SURELY = 0, 1, 2
#: Nodes that can wait at once: a tree of n leaves is at most log2(n) + 1 deep.
STACK = 64


class Scene(NamedTuple):
    """The triangles of a soup below a tree of boxes; nodes in preorder, a node's left child right after it."""

    box: np.ndarray  # (nodes, 2, 3) float64 lower and upper corners, grown
    right: np.ndarray  # (nodes,) int32 right child; 0 at leaves
    bundle: np.ndarray  # (nodes,) int32 bundle of a leaf; -1 at inner nodes
    axis: np.ndarray  # (nodes,) int8 that the node is cut across
    vertices: np.ndarray  # (n, 3) int32
    triangles: np.ndarray  # (m, 3) int32
    bundle_start: np.ndarray  # (b + 1,) int32 offsets into the triangles
    triangle_drawable: np.ndarray  # (m,) int32
    one_sided: np.ndarray  # (drawables,) bool: their backs let rays pass
    corners: np.ndarray  # (b, 9, BUNDLE) float32 each bundle's triangles side by side, the last one repeated


class Ancestry(NamedTuple):
    """How to get from drawables up to the root of a soup's tree."""

    parent: np.ndarray  # (nodes,) int32; -1 at the root
    leaf: np.ndarray  # (b,) int32 the node of each bundle
    first_bundle: np.ndarray  # (drawables + 1,) int32 offsets of the drawables' bundles
    kept: np.ndarray  # (nodes,) bool scratch, all False


def build_scene(
    vertices: np.ndarray,
    triangles: np.ndarray,
    triangle_drawable: np.ndarray,
    one_sided: np.ndarray,
    cluster_start: np.ndarray,
) -> Scene:
    """The tree over the triangles of a soup.

    Args:
        vertices, triangles, triangle_drawable, one_sided: as in `Scene`.
        cluster_start: (k + 1,) int32 offsets into the triangles; bundles lie within clusters.
    """
    sizes = np.diff(cluster_start)
    bundles = -(-sizes // BUNDLE)
    number = np.arange(bundles.sum()) - np.repeat(np.cumsum(bundles) - bundles, bundles)
    start = np.append(np.repeat(cluster_start[:-1], bundles) + BUNDLE * number, len(triangles)).astype(np.int32)
    side_by_side = np.empty((len(number), 9, BUNDLE), np.float32)
    if len(triangles):
        corners = vertices[triangles]
        within = np.minimum(start[:-1, None] + np.arange(BUNDLE), start[1:, None] - 1)
        side_by_side[:] = corners[within].reshape(-1, BUNDLE, 9).transpose(0, 2, 1)
        lo = np.minimum.reduceat(corners.min(axis=1), start[:-1], axis=0).astype(np.float64)
        hi = np.maximum.reduceat(corners.max(axis=1), start[:-1], axis=0).astype(np.float64)
    else:
        lo = hi = np.zeros((0, 3))
    return Scene(*build_tree(lo, hi), vertices, triangles, start, triangle_drawable, one_sided, side_by_side)


def ancestry_of(scene: Scene) -> Ancestry:
    """The ancestry of a soup's tree, before anything is pruned."""
    nodes = len(scene.right)
    inner = np.flatnonzero(scene.bundle < 0)
    parent = np.full(nodes, -1, np.int32)
    parent[inner + 1] = inner
    parent[scene.right[inner]] = inner
    leaf = np.empty(len(scene.bundle_start) - 1, np.int32)
    leaves = np.flatnonzero(scene.bundle >= 0)
    leaf[scene.bundle[leaves]] = leaves
    owner = scene.triangle_drawable[scene.bundle_start[:-1]]
    first = np.searchsorted(owner, np.arange(len(scene.one_sided) + 1)).astype(np.int32)
    return Ancestry(parent, leaf, first, np.zeros(nodes, np.bool_))


def prune(scene: Scene, ancestry: Ancestry, standing: np.ndarray) -> Scene:
    """The same triangles below a tree of some drawables alone, whose boxes hold these alone.

    standing: (s,) int64 drawables.
    """
    box, right, bundle, axis = prune_tree(
        scene.box, scene.right, scene.bundle, scene.axis, ancestry.parent, ancestry.leaf, ancestry.first_bundle,
        ancestry.kept, standing,
    )  # fmt: skip
    return scene._replace(box=box, right=right, bundle=bundle, axis=axis)


@allocating_kernel()
def prune_tree(
    box: np.ndarray, right: np.ndarray, bundle: np.ndarray, axis: np.ndarray, parent: np.ndarray, leaf: np.ndarray,
    first_bundle: np.ndarray, kept: np.ndarray, standing: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """The part of a tree above some drawables' bundles: box, right, bundle and axis. Args: see `Scene`, `Ancestry`."""
    count = 0
    for drawable in standing:
        for b in range(first_bundle[drawable], first_bundle[drawable + 1]):
            count += 1
            node = leaf[b]
            while node >= 0 and not kept[node]:
                kept[node] = True
                node = parent[node]
    nodes = max(2 * count - 1, 0)
    new_box = np.empty((nodes, 2, 3), np.float64)
    new_right = np.zeros(nodes, np.int32)
    new_bundle = np.full(nodes, -1, np.int32)
    new_axis = np.zeros(nodes, np.int8)
    waiting = np.empty((STACK, 2), np.int32)  # a node, and the new one whose right child it is
    waiting[0, 0], waiting[0, 1] = 0, -1
    stack = 1 if count else 0
    new = 0
    while stack:
        stack -= 1
        node, above = waiting[stack, 0], waiting[stack, 1]
        while bundle[node] < 0 and not (kept[node + 1] and kept[right[node]]):
            node = node + 1 if kept[node + 1] else right[node]
        if above >= 0:
            new_right[above] = new
        if bundle[node] >= 0:
            new_bundle[new] = bundle[node]
            new_box[new] = box[node]
        else:
            new_axis[new] = axis[node]
            waiting[stack, 0], waiting[stack, 1] = right[node], new
            waiting[stack + 1, 0], waiting[stack + 1, 1] = node + 1, -1
            stack += 2
        new += 1
    for node in range(nodes - 1, -1, -1):
        if new_bundle[node] < 0:
            for k in range(3):
                new_box[node, 0, k] = min(new_box[node + 1, 0, k], new_box[new_right[node], 0, k])
                new_box[node, 1, k] = max(new_box[node + 1, 1, k], new_box[new_right[node], 1, k])
    for drawable in standing:
        for b in range(first_bundle[drawable], first_bundle[drawable + 1]):
            node = leaf[b]
            while node >= 0 and kept[node]:
                kept[node] = False
                node = parent[node]
    return new_box, new_right, new_bundle, new_axis


@allocating_kernel()
def build_tree(lo: np.ndarray, hi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The tree over boxes lo, hi (k, 3) float64: box, right, bundle and axis as in `Scene`."""
    k = len(lo)
    nodes = max(2 * k - 1, 0)
    box = np.empty((nodes, 2, 3), np.float64)
    right = np.zeros(nodes, np.int32)
    bundle = np.full(nodes, -1, np.int32)
    axes = np.zeros(nodes, np.int8)
    middle = 0.5 * (lo + hi)
    order = np.arange(k)
    waiting = np.empty((STACK, 3), np.int64)  # first and last place in `order`, and whose right child it is
    waiting[0, 0], waiting[0, 1], waiting[0, 2] = 0, k, -1
    count = 1 if k else 0
    node = 0
    while count:
        count -= 1
        begin, end, parent = waiting[count, 0], waiting[count, 1], waiting[count, 2]
        if parent >= 0:
            right[parent] = node
        widest, axis = -1.0, 0
        for i in range(3):
            low, high, first, last = np.inf, -np.inf, np.inf, -np.inf
            for at in range(begin, end):
                c = order[at]
                low, high = min(low, lo[c, i]), max(high, hi[c, i])
                first, last = min(first, middle[c, i]), max(last, middle[c, i])
            box[node, 0, i], box[node, 1, i] = low - GROWN, high + GROWN
            if last - first > widest:
                widest, axis = last - first, i
        if end - begin == 1:
            bundle[node] = order[begin]
        else:
            axes[node] = axis
            part = order[begin:end].copy()
            order[begin:end] = part[np.argsort(middle[part, axis], kind="mergesort")]
            half = (begin + end) // 2
            waiting[count, 0], waiting[count, 1], waiting[count, 2] = half, end, node
            waiting[count + 1, 0], waiting[count + 1, 1], waiting[count + 1, 2] = begin, half, -1
            count += 2
        node += 1
    return box, right, bundle, axes


@kernel()
def inverse(d: np.ndarray, over: np.ndarray) -> None:
    """One over each part of a direction d (3,) into `over`; finite where a part is 0."""
    for k in range(3):
        over[k] = 1.0 / d[k] if abs(d[k]) > 1e-200 else 1e200


@kernel(inline="always")
def enters(box: np.ndarray, node: int, o: np.ndarray, over: np.ndarray, limit: float) -> bool:
    """Whether a ray from o meets a node's box between its start and `limit` ray lengths."""
    near, far = 0.0, limit
    for k in range(3):
        a = (box[node, 0, k] - o[k]) * over[k]
        b = (box[node, 1, k] - o[k]) * over[k]
        near = max(near, min(a, b))
        far = min(far, max(a, b))
    return near <= far


@kernel(inline="always")
def edge_volumes(
    ax: float, ay: float, az: float, bx: float, by: float, bz: float, cx: float, cy: float, cz: float, d: np.ndarray
) -> tuple[float, float, float]:
    """Six times the volumes between a ray along d and a triangle's three edges, its corners seen from the ray's start.

    All of one sign where the ray's line passes inside; their parts of the sum are the weights of a, b and c there.
    """
    return (
        d[0] * (by * cz - bz * cy) + d[1] * (bz * cx - bx * cz) + d[2] * (bx * cy - by * cx),
        d[0] * (cy * az - cz * ay) + d[1] * (cz * ax - cx * az) + d[2] * (cx * ay - cy * ax),
        d[0] * (ay * bz - az * by) + d[1] * (az * bx - ax * bz) + d[2] * (ax * by - ay * bx),
    )


@kernel()
def next_bundle(
    scene: Scene, o: np.ndarray, d: np.ndarray, over: np.ndarray, limit: float, stack: np.ndarray, count: int
) -> tuple[int, int]:
    """The next bundle whose box a ray enters before `limit` ray lengths, about from near to far; -1: no more.

    Args:
        o, d: (3,) float64 start and direction of the ray; over: (3,) float64, see `inverse`.
        stack: (STACK,) int32 the nodes that are still to visit, `count` of them: node 0 at first.

    Returns:
        (the bundle, the nodes that are left).
    """
    while count:
        count -= 1
        node = stack[count]
        if not enters(scene.box, node, o, over, limit):
            continue
        if scene.bundle[node] >= 0:
            return scene.bundle[node], count
        near, far = node + 1, scene.right[node]
        if d[scene.axis[node]] < 0:
            near, far = far, near
        stack[count] = far
        stack[count + 1] = near
        count += 2
    return -1, 0


@kernel()
def passes_beside(corners: np.ndarray, c: int, o: np.ndarray, d: np.ndarray, reach: float) -> int:
    """Which triangles of a bundle the line from o along d surely passes beside: `meets` says APART of them.

    Without branches, and with nothing written, so that all triangles are worked out side by side.

    Args: corners: see `Scene`; c: the bundle; the others as for `meets`.

    Returns:
        A bit for each triangle, the first one's the lowest.
    """
    ox, oy, oz = o[0], o[1], o[2]
    dx, dy, dz = d[0], d[1], d[2]
    margin = MARGIN * reach
    mask = 0
    for k in range(BUNDLE):
        ax, ay, az = corners[c, 0, k] - ox, corners[c, 1, k] - oy, corners[c, 2, k] - oz
        bx, by, bz = corners[c, 3, k] - ox, corners[c, 4, k] - oy, corners[c, 5, k] - oz
        cx, cy, cz = corners[c, 6, k] - ox, corners[c, 7, k] - oy, corners[c, 8, k] - oz
        va = dx * (by * cz - bz * cy) + dy * (bz * cx - bx * cz) + dz * (bx * cy - by * cx)
        vb = dx * (cy * az - cz * ay) + dy * (cz * ax - cx * az) + dz * (cx * ay - cy * ax)
        vc = dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx)
        na = _larger(_larger(abs(ax), abs(ay)), abs(az))
        nb = _larger(_larger(abs(bx), abs(by)), abs(bz))
        nc = _larger(_larger(abs(cx), abs(cy)), abs(cz))
        ma, mb, mc = margin * nb * nc, margin * nc * na, margin * na * nb
        above = _larger(_larger(va - ma, vb - mb), vc - mc)
        below = _larger(_larger(-va - ma, -vb - mb), -vc - mc)
        mask |= (1 << k) if (above > 0.0) & (below > 0.0) else 0
    return mask


@kernel(inline="always")
def _larger(a: float, b: float) -> float:
    """The larger of two numbers: unlike `max`, one instruction, which works on many side by side."""
    return a if a > b else b


@kernel()
def meets(vertices: np.ndarray, triangles: np.ndarray, t: int, o: np.ndarray, d: np.ndarray, reach: float) -> int:
    """Whether triangle t stands between o and the point o + d.

    What lies in the very same place as that point does not: of coincident faces any may be the one that is drawn.

    Args:
        o, d: (3,) float64 grid units; d may be off by float64's rounding of `reach`, the largest coordinate (seen from
            o) of what d was made from.

    Returns:
        APART where it surely does not; SURELY where the segment crosses it well inside, from its front, -SURELY from
        its back; PERHAPS where rounding may be to blame, -PERHAPS where the front is surely turned away.
    """
    i0, i1, i2 = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    x0, y0, z0 = float(vertices[i0, 0]), float(vertices[i0, 1]), float(vertices[i0, 2])
    x1, y1, z1 = float(vertices[i1, 0]), float(vertices[i1, 1]), float(vertices[i1, 2])
    x2, y2, z2 = float(vertices[i2, 0]), float(vertices[i2, 1]), float(vertices[i2, 2])
    ax, ay, az = x0 - o[0], y0 - o[1], z0 - o[2]
    bx, by, bz = x1 - o[0], y1 - o[1], z1 - o[2]
    cx, cy, cz = x2 - o[0], y2 - o[1], z2 - o[2]
    va, vb, vc = edge_volumes(ax, ay, az, bx, by, bz, cx, cy, cz, d)
    na = max(abs(ax), abs(ay), abs(az))
    nb = max(abs(bx), abs(by), abs(bz))
    nc = max(abs(cx), abs(cy), abs(cz))
    ma, mb, mc = MARGIN * reach * nb * nc, MARGIN * reach * nc * na, MARGIN * reach * na * nb
    above = va > ma or vb > mb or vc > mc
    below = va < -ma or vb < -mb or vc < -mc
    if above and below:
        return APART
    _, _, _, nx, ny, nz = plane_of(vertices, triangles, t)
    to_plane = nx * ax + ny * ay + nz * az
    along = nx * d[0] + ny * d[1] + nz * d[2]
    slack = 3.0 * MARGIN * max(abs(nx), abs(ny), abs(nz)) * (na + reach)
    sign = -1 if to_plane > slack else 1
    if along < 0:
        to_plane, along = -to_plane, -along
    if along * SAME > 2.0 * slack:
        if not -slack <= to_plane < along * (1.0 - SAME):
            return APART
        inside = (va > ma and vb > mb and vc > mc) or (va < -ma and vb < -mb and vc < -mc)
        return sign * (SURELY if inside and to_plane > slack else PERHAPS)
    # almost along the plane: nobody can tell
    return sign * PERHAPS if -slack <= to_plane <= along * (1.0 + SAME) + slack else APART


@kernel(inline="always")
def may_block(
    vertices: np.ndarray, triangles: np.ndarray, t: int, one_sided: bool, o: np.ndarray, d: np.ndarray, reach: float
) -> bool:
    """Whether triangle t may keep somebody at o from seeing the point o + d: False only where it surely does not."""
    met = meets(vertices, triangles, t, o, d, reach)
    return met > APART or (met < APART and not one_sided)


@kernel()
def find_blocker(
    scene: Scene, own: int, o: np.ndarray, d: np.ndarray, reach: float, work: np.ndarray,
    stack: np.ndarray,
) -> int:  # fmt: skip
    """A triangle of another drawable that may stand before the point o + d, or -1 where none can.

    Args:
        scene: of what may block; own: the drawable that is looked at, which never blocks.
        o, d, reach: see `may_block`; work: (3,) float64 and stack: (STACK,) int32 are written to.
    """
    inverse(d, work)
    stack[0] = 0
    count = min(len(scene.right), 1)
    while True:
        c, count = next_bundle(scene, o, d, work, 1.0 + SAME, stack, count)
        if c < 0:
            return -1
        drawable = scene.triangle_drawable[scene.bundle_start[c]]
        if drawable == own:
            continue
        beside = passes_beside(scene.corners, c, o, d, reach)
        for t in range(scene.bundle_start[c], scene.bundle_start[c + 1]):
            if beside >> (t - scene.bundle_start[c]) & 1:
                continue
            if may_block(scene.vertices, scene.triangles, t, scene.one_sided[drawable], o, d, reach):
                return t


@kernel()
def find_first(scene: Scene, o: np.ndarray, d: np.ndarray, work: np.ndarray, stack: np.ndarray) -> tuple[int, float]:
    """The triangle that a ray from o along d meets first, and where, in ray lengths; -1 where it meets none.

    Args: as for `find_blocker`. Backs of one-sided drawables let the ray pass.
    """
    found, nearest = -1, np.inf
    inverse(d, work)
    stack[0] = 0
    count = min(len(scene.right), 1)
    while True:
        c, count = next_bundle(scene, o, d, work, nearest, stack, count)
        if c < 0:
            return found, nearest
        drawable = scene.triangle_drawable[scene.bundle_start[c]]
        beside = passes_beside(scene.corners, c, o, d, 0.0)
        for t in range(scene.bundle_start[c], scene.bundle_start[c + 1]):
            if beside >> (t - scene.bundle_start[c]) & 1:
                continue
            i0, i1, i2 = scene.triangles[t, 0], scene.triangles[t, 1], scene.triangles[t, 2]
            ax, ay, az = scene.vertices[i0, 0] - o[0], scene.vertices[i0, 1] - o[1], scene.vertices[i0, 2] - o[2]
            bx, by, bz = scene.vertices[i1, 0] - o[0], scene.vertices[i1, 1] - o[1], scene.vertices[i1, 2] - o[2]
            cx, cy, cz = scene.vertices[i2, 0] - o[0], scene.vertices[i2, 1] - o[1], scene.vertices[i2, 2] - o[2]
            va, vb, vc = edge_volumes(ax, ay, az, bx, by, bz, cx, cy, cz, d)
            if (va < 0 or vb < 0 or vc < 0) and (va > 0 or vb > 0 or vc > 0):
                continue
            along = va + vb + vc
            if along == 0 or (along > 0 and scene.one_sided[drawable]):
                continue
            to_plane = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            at = to_plane / along
            if 0 < at < nearest:
                found, nearest = t, at
