"""Walking the hierarchy: NODE arrays are in preorder, and `end` says where the nodes below each one end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def leaves(nodes: np.ndarray) -> NDArray[np.bool_]:
    """Which nodes (n,) have none below them."""
    return np.asarray(nodes["end"] == np.arange(len(nodes)) + 1)


def roots(nodes: np.ndarray) -> NDArray[np.int64]:
    """The nodes (n,) that lie below no other."""
    found, node = [], 0
    while node < len(nodes):
        found.append(node)
        node = int(nodes["end"][node])
    return np.array(found, np.int64)


def children(nodes: np.ndarray, parents: NDArray[np.int64]) -> NDArray[np.int64]:
    """The nodes (n,) right below any of `parents`, increasing."""
    end = nodes["end"]
    found = [np.zeros(0, np.int64)]
    which, last = parents + 1, end[parents].astype(np.int64)
    which, last = which[which < last], last[which < last]
    while len(which):
        found.append(which)
        following = end[which].astype(np.int64)
        more = following < last
        which, last = following[more], last[more]
    return np.sort(np.concatenate(found))


def parents(nodes: np.ndarray) -> NDArray[np.int64]:
    """The node (n,) right above each one, -1 above roots."""
    above = np.full(len(nodes), -1, np.int64)
    front = roots(nodes)
    while len(front):
        below = children(nodes, front)
        above[below] = front[np.searchsorted(front, below, side="right") - 1]
        front = below
    return above


def heights(nodes: np.ndarray) -> NDArray[np.int64]:
    """How many nodes (n,) the longest way down from each one passes; 0 for leaves."""
    above = parents(nodes)
    found = np.zeros(len(nodes), np.int64)
    front, steps = np.flatnonzero(leaves(nodes)), 0
    while len(front):
        found[front] = steps
        front, steps = np.unique(above[front]), steps + 1
        front = front[front >= 0]
    return found


def overlapping(nodes: np.ndarray, some: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which of `some` nodes (k,) are, lie above, or lie below one of `others` (m,), increasing, none above another."""
    end = nodes["end"].astype(np.int64)
    above = np.searchsorted(others, end[some]) > np.searchsorted(others, some)
    before = np.searchsorted(others, some, side="right") - 1
    below = (before >= 0) & (end[others[before]] > some) if len(others) else np.zeros(len(some), np.bool_)
    return np.asarray(above | below)
