"""Clustering: small objects that lie near each other become one.

The graph joins objects whose boxes lie near each other; its edges are taken from the shortest on, and one joins two
clusters if it is short compared with the longest edge inside each of them, and if their common box is not too large.

Each object is joined to its nearest ones only, found in a box hierarchy, so the graph grows with the model, not with
its square. Edges that could never join anything are left out from the start.

Based on: W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, section 4.2.2; P. Felzenszwalb, D. Huttenlocher,
Efficiently Computing a Good Segmentation, CVPR 1998.
"""

from __future__ import annotations

import numpy as np

from jobs.objects.components import find
from jobs.objects.object_options import Clustering
from jobs.objects.tree import Tree, build_tree
from storage.base.kernels import allocating_kernel

#: Boxes count as at least this thick, as a part of the model's largest extent, when their volume is compared.
THINNEST = 1e-3
#: Of objects at the same distance the one with the nearer centre counts as nearer; this much of that distance.
CENTRES = 1e-2


def cluster(
    lo: np.ndarray, hi: np.ndarray, kind: np.ndarray, options: Clustering, model_lo: np.ndarray, model_hi: np.ndarray
) -> np.ndarray:
    """The cluster (k,) int64 of each object with a box lo, hi (k, 3) float64, numbered by their first objects.

    kind (k,) int64: objects of different kinds stay apart, those of a negative kind stay alone.
    model_lo, model_hi (3,): the box that distances and volumes are compared with.
    """
    extent = np.asarray(model_hi, np.float64) - np.asarray(model_lo, np.float64)
    largest = float(extent.max())
    thin = THINNEST * largest
    reach = options.distance * largest
    most = options.volume * float(np.maximum(extent, thin).prod())
    parent = np.arange(len(lo))
    free = np.flatnonzero(kind >= 0)
    if len(free) and reach > 0:
        low, high = np.ascontiguousarray(lo[free]), np.ascontiguousarray(hi[free])
        tree = build_tree(low, high, np.ones(len(free), np.int64))
        pairs, length, apart = near_pairs(low, high, kind[free], tree, reach, options.neighbours, thin, most)
        order = np.lexsort((pairs[:, 1], pairs[:, 0], apart, length))
        joined = join_clusters(low, high, pairs[order], length[order] / reach, options.cardinality, thin, most)
        parent[free] = free[joined]
    _, first, number = np.unique(parent, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    return rank[number]


@allocating_kernel()
def joint_volume(lo: np.ndarray, hi: np.ndarray, i: int, j: int, thin: float) -> float:
    """Volume of the common box of boxes i and j, at least `thin` thick."""
    volume = 1.0
    for c in range(3):
        volume *= max(max(hi[i, c], hi[j, c]) - min(lo[i, c], lo[j, c]), thin)
    return volume


@allocating_kernel()
def near_pairs(
    lo: np.ndarray,
    hi: np.ndarray,
    kind: np.ndarray,
    tree: Tree,
    reach: float,
    neighbours: int,
    thin: float,
    most: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each box its nearest ones of its kind that are nearer than `reach` and whose common box is at most `most`.

    Returns pairs (e, 2) int64 (smaller index first, each once), the boxes' distances (e,) and those of their centres.
    """
    k = len(lo)
    found = np.empty((k, neighbours), np.int64)
    near = np.empty((k, neighbours))
    counts = np.zeros(k, np.int64)
    stack = np.empty(256, np.int64)
    for i in range(k):
        best, own, n = near[i], found[i], 0
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            gap2, centre2 = 0.0, 0.0
            for c in range(3):
                gap = max(tree.lo[node, c] - hi[i, c], lo[i, c] - tree.hi[node, c], 0.0)
                gap2 += gap * gap
                middle = (lo[i, c] + hi[i, c]) / 2.0
                if tree.leaf[node] >= 0:
                    off = middle - (tree.lo[node, c] + tree.hi[node, c]) / 2.0
                else:
                    off = max(tree.lo[node, c] - middle, middle - tree.hi[node, c], 0.0)
                centre2 += off * off
            rank = gap2 + CENTRES * CENTRES * centre2
            if gap2 >= reach * reach or (n == neighbours and rank >= best[n - 1]):
                continue
            j = tree.leaf[node]
            if j < 0:
                # the side whose centre is nearer is looked at first
                left, right = node + 1, tree.end[node + 1]
                dl, dr = 0.0, 0.0
                for c in range(3):
                    middle = lo[i, c] + hi[i, c]
                    dl += (middle - tree.lo[left, c] - tree.hi[left, c]) ** 2
                    dr += (middle - tree.lo[right, c] - tree.hi[right, c]) ** 2
                stack[top] = right if dl <= dr else left
                stack[top + 1] = left if dl <= dr else right
                top += 2
                continue
            if j == i or kind[j] != kind[i] or joint_volume(lo, hi, i, j, thin) > most:
                continue
            place = n if n < neighbours else n - 1
            while place > 0 and best[place - 1] > rank:
                best[place], own[place] = best[place - 1], own[place - 1]
                place -= 1
            best[place], own[place] = rank, j
            n = min(n + 1, neighbours)
        counts[i] = n
    total = 0
    pairs = np.empty((counts.sum(), 2), np.int64)
    length, apart = np.empty(len(pairs)), np.empty(len(pairs))
    for i in range(k):
        for place in range(counts[i]):
            j = found[i, place]
            if j < i:  # taken already if it is mutual
                mutual = False
                for other in range(counts[j]):
                    mutual = mutual or found[j, other] == i
                if mutual:
                    continue
            gap2, centre2 = 0.0, 0.0
            for c in range(3):
                gap = max(lo[j, c] - hi[i, c], lo[i, c] - hi[j, c], 0.0)
                gap2 += gap * gap
                off = (lo[i, c] + hi[i, c] - lo[j, c] - hi[j, c]) / 2.0
                centre2 += off * off
            pairs[total, 0], pairs[total, 1] = min(i, j), max(i, j)
            length[total], apart[total] = np.sqrt(gap2), np.sqrt(centre2)
            total += 1
    return pairs[:total], length[:total], apart[:total]


@allocating_kernel()
def join_clusters(
    lo: np.ndarray,
    hi: np.ndarray,
    pairs: np.ndarray,
    length: np.ndarray,
    cardinality: float,
    thin: float,
    most: float,
) -> np.ndarray:
    """The first object (k,) int64 of each one's cluster; pairs (e, 2) with increasing length (e,).

    A pair joins clusters C1 and C2 if its length is at most min(I(C1) + K / |C1|, I(C2) + K / |C2|), I the longest
    edge that made a cluster, and if the volume of their common box is at most `most`.
    """
    k = len(lo)
    parent = np.arange(k)
    size = np.ones(k, np.int64)
    longest = np.zeros(k)
    low, high = lo.copy(), hi.copy()
    for e in range(len(pairs)):
        a, b = find(parent, pairs[e, 0]), find(parent, pairs[e, 1])
        if a == b or joint_volume(low, high, a, b, thin) > most:
            continue
        if length[e] > min(longest[a] + cardinality / size[a], longest[b] + cardinality / size[b]):
            continue
        if b < a:
            a, b = b, a
        parent[b] = a
        size[a] += size[b]
        longest[a] = length[e]
        for c in range(3):
            low[a, c] = min(low[a, c], low[b, c])
            high[a, c] = max(high[a, c], high[b, c])
    for i in range(k):
        parent[i] = find(parent, i)
    return parent
