"""A length that no tour can fall below: the 1-tree with prices on columns that make it as near to a tour as can be.

Based on: M. Held, R. M. Karp, The Traveling-Salesman Problem and Minimum Spanning Trees, Operations Research 18, 1970,
and part II, Mathematical Programming 1, 1971 (subgradient); A. Volgenant, R. Jonker, A Branch and Bound Algorithm for
the Symmetric Traveling Salesman Problem, European Journal of Operational Research 9, 1982 (the step's memory).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from jobs.ordering.columns import Columns
from jobs.ordering.identical import representatives
from jobs.ordering.nearest import distance_to_marked, mark
from storage.base.kernels import allocating_kernel

#: The bound has converged where the price of a step is below this part of its first.
CONVERGED = 0.002


@dataclass(frozen=True)
class Bound:
    """What is known of the shortest tour."""

    runs: int  # no order has fewer
    converged: bool
    steps: int
    seconds: float


def held_karp(columns: Columns, runs: int, seconds: float) -> Bound:
    """The least runs that an order may have; runs: of some order, the fewer the better; seconds: when to stop.

    Needs 4 bytes for each pair of different columns.
    """
    began = time.perf_counter()
    distinct = np.flatnonzero((representatives(columns) == np.arange(columns.count)) & (columns.sizes > 0))
    nodes = np.append(
        columns.count, distinct
    )  # the empty column first: it is no column's nearest, and the 1-tree's own
    far = _distances(columns.offsets, columns.rows, columns.height, nodes)
    price, degree = np.zeros(len(nodes)), np.zeros(len(nodes), np.int64)
    best, scale, idle, taken, former = -np.inf, 1.0, 0, 0, np.zeros(len(nodes))
    while scale > CONVERGED and time.perf_counter() - began < seconds:
        length = _one_tree(far, price, degree) - 2 * price.sum()
        taken += 1
        idle += 1
        if length > best + 0.1:
            best, idle = length, 0
        slope = degree - 2
        if not slope.any():  # it is a tour, and the shortest
            scale = 0.0
            break
        if idle >= 12:
            scale, idle = 0.8 * scale, 0
        price = price + scale * (2 * runs - length) / (slope @ slope) * (0.7 * slope + 0.3 * former)
        former = slope
    # Float prices: a few units in the last place of sums below 2^24 are far less than the tenth that is left.
    return Bound(int(np.ceil(best / 2 - 0.05)), scale <= CONVERGED, taken, time.perf_counter() - began)


@allocating_kernel()
def _distances(offsets: np.ndarray, rows: np.ndarray, height: int, nodes: np.ndarray) -> np.ndarray:
    far = np.zeros((len(nodes), len(nodes)), np.float32)
    marks = np.zeros(height, np.uint8)
    for a in range(len(nodes)):
        size = offsets[nodes[a] + 1] - offsets[nodes[a]]
        mark(offsets, rows, nodes[a], marks, 1)
        for b in range(a):
            far[a, b] = far[b, a] = distance_to_marked(offsets, rows, size, nodes[b], marks)
        mark(offsets, rows, nodes[a], marks, 0)
    return far


@allocating_kernel()
def _one_tree(far: np.ndarray, price: np.ndarray, degree: np.ndarray) -> float:
    """The length with prices of the least spanning tree of nodes 1 on and the two best edges of node 0; and degrees."""
    count = len(far)
    degree[:] = 0
    nearest, parent = np.full(count, np.inf), np.zeros(count, np.int64)
    left = np.arange(2, count)
    total, current = 0.0, 1
    for remaining in range(count - 2, 0, -1):
        closest, place = np.inf, -1
        for at in range(remaining):
            node = left[at]
            length = far[current, node] + price[current] + price[node]
            if length < nearest[node]:
                nearest[node], parent[node] = length, current
            if nearest[node] < closest:
                closest, place = nearest[node], at
        current = left[place]
        left[place] = left[remaining - 1]
        total += closest
        degree[current] += 1
        degree[parent[current]] += 1
    first, second, one, two = np.inf, np.inf, -1, -1
    for node in range(1, count):
        length = far[0, node] + price[0] + price[node]
        if length < first:
            second, two, first, one = first, one, length, node
        elif length < second:
            second, two = length, node
    degree[0] = 2
    degree[one] += 1
    degree[two] += 1
    return total + first + second
