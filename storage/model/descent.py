"""From the roots down to the nodes that are fine enough: the inner loop of `storage.model.cut`.

Float64, and no operation is fused with another: the same bits on every machine.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel


@allocating_kernel()
def descend(
    nodes: np.ndarray,
    drawables: np.ndarray,
    tops: NDArray[np.int64],
    all_the_way: bool,
    box: NDArray[np.float64],
    allowed: float,
    anywhere: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The drawables (n,) int64 that stand for all below some nodes, and the nodes (m,) int64 for which none does.

    A node's coarsest level that is allowed stands for it, of a leaf else its finest. Both in preorder of their nodes.
    One kernel with no other: calls of one for each node, with all these arrays, took five times as long.

    Args:
        nodes, drawables: NODE, DRAWABLE.
        tops: (t,) int64 increasing, none of them above another.
        all_the_way: in place of a node for which none stands, go on with those below it, so that m is 0.
        box: (2, 3) lo and hi of the cell, model units.
        allowed: error over distance.
        anywhere: error that is allowed however near, model units.

    Raises IndexError where a node has levels that there are not.
    """
    end, first, levels = nodes["end"], nodes["first_drawable"], nodes["levels"]
    lo, hi, errors = nodes["lo"], nodes["hi"], drawables["error"]
    chosen = np.empty(len(nodes) if all_the_way else len(tops), np.int64)
    left = np.empty(len(tops), np.int64)
    count = remaining = 0
    for top in tops:
        node = top
        stop = np.int64(end[top]) if all_the_way else top + 1
        while node < stop:
            finest = np.int64(first[node])
            beyond = finest + np.int64(levels[node])
            if beyond > len(errors):
                raise IndexError("a node has levels that there are not")
            x = max(lo[node, 0] - box[1, 0], box[0, 0] - hi[node, 0], 0.0)
            y = max(lo[node, 1] - box[1, 1], box[0, 1] - hi[node, 1], 0.0)
            z = max(lo[node, 2] - box[1, 2], box[0, 2] - hi[node, 2], 0.0)
            reach = math.sqrt((x * x + y * y) + z * z)
            behind = np.int64(end[node])
            best = finest if behind == node + 1 else np.int64(-1)
            for drawable in range(beyond - 1, finest - 1, -1):
                error = np.float64(errors[drawable])
                if error <= allowed * (reach - error) or error <= anywhere:
                    best = np.int64(drawable)
                    break
            if best >= 0:
                chosen[count] = best
                count += 1
            elif not all_the_way:
                left[remaining] = node
                remaining += 1
            node = behind if best >= 0 and behind > node else node + 1
    return chosen[:count].copy(), left[:remaining].copy()
