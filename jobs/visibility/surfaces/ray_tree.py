"""Rays against a soup, through a tree of boxes: what is met first, and what may be in the way.

The tree is built once for a soup. A cell prunes it to the drawables that stand in it (`prune`), so that rays never meet
what cannot be seen. Leaves hold a *bundle*, a few neighbouring triangles of one cluster. Halves have equally many
bundles, cut across the widest extent of their middles.

Rays go down the tree three levels at a time: a *wide node* holds the boxes of the eight nodes there side by side, so
that a ray is tried against all of them at once. Bundles come in the order in which the tree itself gives them.

Everything is in grid units. Corners are integers of at most 24 bits, so differences of corners and the normals made of
them are exact in float64; a corner seen from a ray's start is rounded once.

Based on: the volumes that tell on which side of an edge a line passes, M. Shevtsov, A. Soupikov, A. Kapustin:
Ray-Triangle Intersection Algorithm for Modern CPU Architectures, GraphiCon 2007 (after Plücker); nodes of many boxes,
I. Wald, C. Benthin, S. Boulos: Getting Rid of Packets, Interactive Ray Tracing 2008.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.surfaces.planes import plane_of
from jobs.visibility.surfaces.topology import boxes
from storage.base.kernels import allocating_kernel, kernel

#: Boxes are grown by this many grid units, far more than slabs are rounded by.
GROWN = 0.5
#: A triangle is in the way also where exact arithmetic would see it this much beside it, relative to the lengths of
#: the factors: some thousand times float64's rounding.
MARGIN = 1e-12
#: What lies this near what is looked at, as a part of the ray, is in the same place: either of the two is drawn there.
SAME = 1e-9
#: Levels of the tree that a wide node stands for, and the boxes that it holds.
LEVELS = 3
WIDE = 1 << LEVELS
#: Most triangles in a bundle.
BUNDLE = 8
#: What stands between the two ends of a segment: see `meets`.
APART, PERHAPS, SURELY = 0, 1, 2
#: Nodes that can wait at once: a tree of n leaves is at most log2(n) + 1 deep, and a wide node leaves seven waiting.
STACK = 96


class Scene(NamedTuple):
    """The triangles of a soup below a tree of boxes; wide nodes in preorder."""

    slab: np.ndarray  # (wide, 6, WIDE) float32 three lower bounds, then three upper ones; nothing enters an empty one
    child: np.ndarray  # (wide, WIDE) int32 what is in the boxes: a wide node, or ~ a bundle
    order: np.ndarray  # (wide, 8) int32 for each octant of directions: the boxes from far to near, 3 bits each
    vertices: np.ndarray  # (n, 3) int32
    triangles: np.ndarray  # (m, 3) int32
    bundle_start: np.ndarray  # (b + 1,) int32 offsets into the triangles
    triangle_drawable: np.ndarray  # (m,) int32
    one_sided: np.ndarray  # (drawables,) bool: their backs let rays pass
    corners: np.ndarray  # (b, 9, BUNDLE) float32 each bundle's triangles side by side, the last one repeated


class Tree(NamedTuple):
    """A soup's tree, and how to get up to its root; nodes in preorder, a node's left child right after it."""

    box: np.ndarray  # (nodes, 2, 3) float64 lower and upper corners, grown
    right: np.ndarray  # (nodes,) int32 right child; 0 at leaves
    bundle: np.ndarray  # (nodes,) int32 bundle of a leaf; -1 at inner nodes
    axis: np.ndarray  # (nodes,) int8 that the node is cut across
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
) -> tuple[Scene, Tree]:
    """The triangles of a soup, and the tree over them.

    Args:
        vertices, triangles, triangle_drawable, one_sided: as in `Scene`.
        cluster_start: (k + 1,) int32 offsets into the triangles; bundles lie within clusters.
    """
    sizes = np.diff(cluster_start)
    bundles = -(-sizes // BUNDLE)
    number = np.arange(bundles.sum()) - np.repeat(np.cumsum(bundles) - bundles, bundles)
    start = np.append(np.repeat(cluster_start[:-1], bundles) + BUNDLE * number, len(triangles)).astype(np.int32)
    lo, hi = (box.astype(np.float64) for box in boxes(vertices, triangles, start))
    nodes = build_tree(lo, hi)
    corners = _side_by_side(vertices, triangles, start)
    scene = Scene(*widen(*nodes), vertices, triangles, start, triangle_drawable, one_sided, corners)
    return scene, _tree(scene, *nodes)


@allocating_kernel()
def _side_by_side(vertices: np.ndarray, triangles: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The corners of bundles start (b + 1,): (b, 9, BUNDLE) float32, see `Scene`."""
    count = len(start) - 1
    corners = np.empty((count, 9, BUNDLE), np.float32)
    for b in range(count):
        for place in range(BUNDLE):
            t = min(start[b] + place, start[b + 1] - 1)
            for c in range(3):
                for k in range(3):
                    corners[b, 3 * c + k, place] = vertices[triangles[t, c], k]
    return corners


def _tree(scene: Scene, box: np.ndarray, right: np.ndarray, bundle: np.ndarray, axis: np.ndarray) -> Tree:
    """See `Tree`; scene: its slabs are not looked at."""
    inner = np.flatnonzero(bundle < 0)
    parent = np.full(len(right), -1, np.int32)
    parent[inner + 1] = inner
    parent[right[inner]] = inner
    leaf = np.empty(len(scene.bundle_start) - 1, np.int32)
    leaves = np.flatnonzero(bundle >= 0)
    leaf[bundle[leaves]] = leaves
    owner = scene.triangle_drawable[scene.bundle_start[:-1]]
    first = np.searchsorted(owner, np.arange(len(scene.one_sided) + 1)).astype(np.int32)
    return Tree(box, right, bundle, axis, parent, leaf, first, np.zeros(len(right), np.bool_))


def prune(scene: Scene, tree: Tree, standing: np.ndarray) -> Scene:
    """The same triangles below a tree of some drawables alone, whose boxes hold these alone.

    standing: (s,) int64 drawables.
    """
    slab, child, order = widen(*prune_tree(*tree, standing))
    return scene._replace(slab=slab, child=child, order=order)


@allocating_kernel()
def widen(
    box: np.ndarray, right: np.ndarray, bundle: np.ndarray, axis: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A tree's wide nodes: slab, child and order as in `Scene`. Args: see `Tree`.

    Bounds are rounded outward to integers, which float32 holds exactly, so that no ray that meets a box misses it here.
    Where the tree ends above a wide node's last level, its leaf is in the first of the boxes that it stands for.
    """
    nodes = len(right)
    row = np.full(nodes, -1, np.int32)
    level = np.zeros(nodes, np.int8)
    count = 0
    for node in range(nodes):
        if level[node] == 0 and (bundle[node] < 0 or node == 0):
            row[node] = count
            count += 1
        if bundle[node] < 0:
            level[node + 1] = level[right[node]] = (level[node] + 1) % LEVELS
    slab = np.empty((count, 6, WIDE), np.float32)
    child = np.zeros((count, WIDE), np.int32)
    order = np.zeros((count, 8), np.int32)
    for top in range(nodes):
        w = row[top]
        if w < 0:
            continue
        for octant in range(8):
            for place in range(WIDE):
                node, slot, first = top, 0, True
                for shift in range(LEVELS - 1, -1, -1):
                    side = place >> shift & 1
                    if bundle[node] < 0:
                        side ^= octant >> int(axis[node]) & 1
                        node = right[node] if side else node + 1
                    else:
                        first &= not side
                    slot = 2 * slot + side
                order[w, octant] |= slot << (3 * (WIDE - 1 - place))
                if octant:
                    continue
                for k in range(3):
                    slab[w, k, slot] = np.floor(box[node, 0, k]) if first else np.inf
                    slab[w, 3 + k, slot] = np.ceil(box[node, 1, k]) if first else -np.inf
                if first:
                    child[w, slot] = ~bundle[node] if bundle[node] >= 0 else row[node]
    return slab, child, order


@allocating_kernel()
def prune_tree(
    box: np.ndarray, right: np.ndarray, bundle: np.ndarray, axis: np.ndarray, parent: np.ndarray, leaf: np.ndarray,
    first_bundle: np.ndarray, kept: np.ndarray, standing: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """The part of a tree above some drawables' bundles: box, right, bundle and axis. Args: see `Tree`."""
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
    """The tree over boxes lo, hi (k, 3) float64: box, right, bundle and axis as in `Tree`."""
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
    """One over each part of a direction d (3,) into `over`, with its sign; finite where a part is 0."""
    for k in range(3):
        over[k] = 1.0 / d[k] if abs(d[k]) > 1e-200 else (-1e200 if d[k] < 0 else 1e200)


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


@kernel(inline="always")
def _entered(slab: np.ndarray, node: int, o: np.ndarray, over: np.ndarray, limit: float) -> int:
    """Which of a wide node's boxes a ray from o meets between its start and `limit` ray lengths: a bit for each.

    Without branches, and over a length that the compiler does not know, or it would not work them out side by side.
    """
    x, y, z = (3 if over[0] < 0 else 0), (4 if over[1] < 0 else 1), (5 if over[2] < 0 else 2)
    ox, oy, oz = o[0], o[1], o[2]
    vx, vy, vz = over[0], over[1], over[2]
    mask = 0
    for k in range(slab.shape[2]):
        near = _larger((slab[node, x, k] - ox) * vx, (slab[node, y, k] - oy) * vy)
        near = _larger(near, _larger((slab[node, z, k] - oz) * vz, 0.0))
        far = _smaller((slab[node, 3 - x, k] - ox) * vx, (slab[node, 5 - y, k] - oy) * vy)
        far = _smaller(far, _smaller((slab[node, 7 - z, k] - oz) * vz, limit))
        mask |= (1 << k) if near <= far else 0
    return mask


@kernel(inline="always")
def next_bundle(
    scene: Scene, o: np.ndarray, over: np.ndarray, limit: float, stack: np.ndarray, count: int
) -> tuple[int, int]:
    """The next bundle whose box a ray enters before `limit` ray lengths, about from near to far; -1: no more.

    Args:
        o: (3,) float64 where the ray starts; over: (3,) float64 one over its direction, see `inverse`.
        limit: may become less from call to call; what waits already is not tried again.
        stack: (STACK,) int32 what is still to visit, as in `Scene.child`, `count` of it: node 0 at first.

    Returns:
        (the bundle, how much is left).
    """
    octant = (1 if over[0] < 0 else 0) | (2 if over[1] < 0 else 0) | (4 if over[2] < 0 else 0)
    while count:
        count -= 1
        node = stack[count]
        if node < 0:
            return ~node, count
        entered = _entered(scene.slab, node, o, over, limit)
        order = scene.order[node, octant]
        for _ in range(WIDE):
            slot = order & (WIDE - 1)
            order >>= LEVELS
            stack[count] = scene.child[node, slot]
            count += entered >> slot & 1
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


@kernel(inline="always")
def _smaller(a: float, b: float) -> float:
    """The smaller of two numbers, as `_larger`."""
    return a if a < b else b


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
    count = min(len(scene.child), 1)
    while True:
        c, count = next_bundle(scene, o, work, 1.0 + SAME, stack, count)
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


@kernel(inline="always")
def met_at(scene: Scene, t: int, one_sided: bool, o: np.ndarray, d: np.ndarray) -> float:
    """Where the line from o along d meets triangle t, in lengths of d; 0 where it passes beside, or meets a back that
    lets it pass.
    """
    i0, i1, i2 = scene.triangles[t, 0], scene.triangles[t, 1], scene.triangles[t, 2]
    ax, ay, az = scene.vertices[i0, 0] - o[0], scene.vertices[i0, 1] - o[1], scene.vertices[i0, 2] - o[2]
    bx, by, bz = scene.vertices[i1, 0] - o[0], scene.vertices[i1, 1] - o[1], scene.vertices[i1, 2] - o[2]
    cx, cy, cz = scene.vertices[i2, 0] - o[0], scene.vertices[i2, 1] - o[1], scene.vertices[i2, 2] - o[2]
    va, vb, vc = edge_volumes(ax, ay, az, bx, by, bz, cx, cy, cz, d)
    along = va + vb + vc
    beside = (va < 0 or vb < 0 or vc < 0) and (va > 0 or vb > 0 or vc > 0)
    at = 0.0
    if not (beside or along == 0 or (along > 0 and one_sided)):
        at = (ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)) / along
    return at


@kernel()
def find_first(scene: Scene, o: np.ndarray, d: np.ndarray, work: np.ndarray, stack: np.ndarray) -> tuple[int, float]:
    """The triangle that a ray from o along d meets first, and where, in ray lengths; -1 where it meets none.

    Args: as for `find_blocker`. Backs of one-sided drawables let the ray pass.
    """
    found, nearest = -1, np.inf
    inverse(d, work)
    stack[0] = 0
    count = min(len(scene.child), 1)
    while True:
        c, count = next_bundle(scene, o, work, nearest, stack, count)
        if c < 0:
            return found, nearest
        drawable = scene.triangle_drawable[scene.bundle_start[c]]
        beside = passes_beside(scene.corners, c, o, d, 0.0)
        for t in range(scene.bundle_start[c], scene.bundle_start[c + 1]):
            if beside >> (t - scene.bundle_start[c]) & 1:
                continue
            at = met_at(scene, t, scene.one_sided[drawable], o, d)
            if 0 < at < nearest:
                found, nearest = t, at
