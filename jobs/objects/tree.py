"""The box hierarchy over objects: from the top down, by the centres of their boxes.

A node's objects are parted across the axis along which their centres lie farthest apart, so that both sides hold about
half of the triangles. Ties are broken by index, and nothing is random: the same boxes give the same tree.

Based on: W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, section 4.2.4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from storage.base.kernels import allocating_kernel

#: Every object weighs this many triangles more than it has: many small ones do not all end on one side.
OBJECT_WEIGHT = 64


class Tree(NamedTuple):
    """Nodes in preorder: those below node i are i + 1 ... end[i] - 1; leaves hold one object each."""

    end: np.ndarray  # (n,) int64: first node after all below this one
    leaf: np.ndarray  # (n,) int64: the object of a leaf, -1 for inner nodes
    lo: np.ndarray  # (n, 3) float64: box
    hi: np.ndarray  # (n, 3) float64


@allocating_kernel()
def build_tree(lo: np.ndarray, hi: np.ndarray, triangles: np.ndarray) -> Tree:
    """The tree over objects with boxes lo, hi (k, 3) float64 and triangles (k,) int64 each; k > 0."""
    k = len(triangles)
    count = 2 * k - 1
    end = np.zeros(count, np.int64)
    leaf = np.full(count, -1, np.int64)
    order = np.arange(k)
    stack = np.empty((k + 2, 2), np.int64)  # objects first ... last - 1
    stack[0, 0], stack[0, 1] = 0, k
    top = 1
    node = 0
    while top > 0:
        top -= 1
        first, last = stack[top, 0], stack[top, 1]
        end[node] = node + 2 * (last - first) - 1
        if last - first == 1:
            leaf[node] = order[first]
            node += 1
            continue
        axis, widest = 0, -1.0
        for c in range(3):
            low, high = np.inf, -np.inf
            for i in order[first:last]:
                centre = lo[i, c] + hi[i, c]
                low, high = min(low, centre), max(high, centre)
            if high - low > widest:
                widest, axis = high - low, c
        run = np.sort(order[first:last])
        run = run[np.argsort(lo[run, axis] + hi[run, axis], kind="mergesort")]
        order[first:last] = run
        total = 0
        for i in run:
            total += triangles[i] + OBJECT_WEIGHT
        below, middle = 0, first
        while middle < last - 1:
            own = triangles[order[middle]] + OBJECT_WEIGHT
            if middle > first and 2 * below + own > total:
                break
            below += own
            middle += 1
        stack[top, 0], stack[top, 1] = middle, last
        stack[top + 1, 0], stack[top + 1, 1] = first, middle
        top += 2
        node += 1
    node_lo, node_hi = np.empty((count, 3)), np.empty((count, 3))
    for node in range(count - 1, -1, -1):
        if leaf[node] >= 0:
            for c in range(3):
                node_lo[node, c], node_hi[node, c] = lo[leaf[node], c], hi[leaf[node], c]
        else:
            left, right = node + 1, end[node + 1]
            for c in range(3):
                node_lo[node, c] = min(node_lo[left, c], node_lo[right, c])
                node_hi[node, c] = max(node_hi[left, c], node_hi[right, c])
    return Tree(end, leaf, node_lo, node_hi)
