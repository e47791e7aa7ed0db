"""Clusters from near to far on a face of the cube, without those that are hidden: best first through their tree.

Nodes wait in a heap by their distance. One that is hidden for good, or that lies beside the face's pyramid, is dropped
with all below it; so the clusters that come up are those that would if all were sorted and each was asked, in the same
order, but only what may be of use is touched. For that a box must be hidden where one around it is: see `occludees`.

Based on: N. Greene, M. Kass, G. Miller: Hierarchical Z-Buffer Visibility, SIGGRAPH 1993; the heap is J. Williams',
Algorithm 232, CACM 7(6), 1964.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.flooding.occludees import box_hidden_on
from jobs.visibility.images.cube_faces import box_on_face
from jobs.visibility.surfaces.clusters import Clusters, place_cluster, place_node
from jobs.visibility.surfaces.seen_mesh import Mesh
from storage.base.kernels import kernel

#: Clusters whose sheet is so narrow that its silhouettes would spoil all of it at this many times its depth are not
#: worth drawing.
WORTH = 1.25


class Queue(NamedTuple):
    """What waits, a binary heap: nearest first; of equally near ones inner nodes, then clusters by number."""

    distance: np.ndarray  # (k + 1,) float64 in cell coordinates, along the axis where it is the greatest
    item: np.ndarray  # (k + 1,) int64 a cluster, or -1 - an inner node
    placed: np.ndarray  # (2, 3) float64 the box of the cluster that was found last, in cell coordinates


def make_queue(clusters: int) -> Queue:
    """Room for so many clusters."""
    return Queue(np.empty(clusters + 1), np.empty(clusters + 1, np.int64), np.empty((2, 3)))


@kernel()
def begin_queue(clusters: Clusters, mesh: Mesh, face: int, resolution: int, queue: Queue) -> int:
    """What waits at first, for `next_cluster`."""
    return _put(clusters, mesh, face, resolution, 0, queue, 0) if clusters.right.shape[0] else 0


@kernel()
def next_cluster(
    clusters: Clusters, mesh: Mesh, face: int, layers: np.ndarray, queue: Queue, waiting: int
) -> tuple[int, int]:
    """The nearest cluster of the cut that was not found before and may occlude more on a face; -1: there is no more.

    Args:
        layers: (6, r, r, k, 2) float32, see `layers`; what they hide at all depths must stay hidden.
        waiting: how many wait in the queue, see `begin_queue`.

    Returns:
        (the cluster, how many wait).
    """
    while waiting:
        waiting = _take(queue.distance, queue.item, waiting)
        item = queue.item[waiting]
        if item >= 0:
            place_cluster(clusters, item, mesh.centre, mesh.half, queue.placed)
        else:
            place_node(clusters, -1 - item, mesh.centre, mesh.half, queue.placed)
        if box_hidden_on(face, queue.placed[0], queue.placed[1], layers, True):
            continue
        if item >= 0:
            return item, waiting
        node = -1 - item
        waiting = _put(clusters, mesh, face, layers.shape[2], node + 1, queue, waiting)
        waiting = _put(clusters, mesh, face, layers.shape[2], clusters.right[node], queue, waiting)
    return -1, 0


@kernel()
def _put(clusters: Clusters, mesh: Mesh, face: int, resolution: int, node: int, queue: Queue, waiting: int) -> int:
    """Let a node wait unless it is of no use; how many wait."""
    c, placed = clusters.cluster[node], queue.placed
    if c >= 0 and not mesh.active[clusters.drawable[c]]:
        return waiting
    place_node(clusters, node, mesh.centre, mesh.half, placed)
    breadth = clusters.broadest[node] / min(mesh.half[0], mesh.half[1], mesh.half[2])
    if breadth < 2.0 * _least_inflation(placed) or not box_on_face(placed[0], placed[1], face, resolution)[0]:
        return waiting
    near = 0.0
    for k in range(3):
        near = max(near, placed[0, k], -placed[1, k])
    item = c if c >= 0 else -1 - node
    distance, items = queue.distance, queue.item
    at = waiting
    while at > 0:
        above = (at - 1) >> 1
        if not (near < distance[above] or (near == distance[above] and item < items[above])):
            break
        distance[at], items[at] = distance[above], items[above]
        at = above
    distance[at], items[at] = near, item
    return waiting + 1


@kernel()
def _take(distance: np.ndarray, items: np.ndarray, waiting: int) -> int:
    """Take the first one out, and put it behind the others; how many wait."""
    waiting -= 1
    first_near, first = distance[0], items[0]
    near, item = distance[waiting], items[waiting]
    at = 0
    while True:
        below = 2 * at + 1
        if below >= waiting:
            break
        other = below + 1
        if other < waiting and (
            distance[other] < distance[below] or (distance[other] == distance[below] and items[other] < items[below])
        ):
            below = other
        if not (distance[below] < near or (distance[below] == near and items[below] < item)):
            break
        distance[at], items[at] = distance[below], items[below]
        at = below
    distance[at], items[at] = near, item
    distance[waiting], items[waiting] = first_near, first
    return waiting


@kernel(inline="always")
def _least_inflation(placed: np.ndarray) -> float:
    """The alpha (see `cube_faces`) of a box's farthest point for occludees WORTH times as deep."""
    far = 0.0
    for k in range(3):
        far = max(far, abs(placed[0, k]), abs(placed[1, k]))
    return (WORTH - 1.0) * far / (WORTH * far - 1.0)
