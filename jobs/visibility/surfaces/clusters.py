"""A soup's clusters below a tree of boxes, so that a cell can pass over what it does not see without looking at it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.surfaces.ray_tree import build_tree
from storage.base.kernels import allocating_kernel, kernel


class Clusters(NamedTuple):
    """Clusters of a soup, and the tree over them; nodes in preorder, a node's left child right after it."""

    start: np.ndarray  # (k + 1,) int32: cluster c holds triangles start[c] ... start[c + 1] - 1
    drawable: np.ndarray  # (k,) int32
    lo: np.ndarray  # (k, 3) float64 boxes in grid units
    hi: np.ndarray  # (k, 3) float64
    box: np.ndarray  # (nodes, 2, 3) float64 lower and upper corners, in grid units, around all that is below
    right: np.ndarray  # (nodes,) int32 right child; 0 at leaves
    cluster: np.ndarray  # (nodes,) int32 cluster of a leaf; -1 at inner nodes
    broadest: np.ndarray  # (nodes,) float64 the greatest breadth below, in grid units


def make_clusters(
    start: np.ndarray, drawable: np.ndarray, lo: np.ndarray, hi: np.ndarray, breadth: np.ndarray
) -> Clusters:
    """The tree over clusters; args: as in `Clusters`, and breadth (k,) float64 as in `soup`."""
    box, right, cluster, _ = build_tree(lo, hi)
    return Clusters(start, drawable, lo, hi, box, right, cluster, _broadest(right, cluster, breadth))


@allocating_kernel()
def _broadest(right: np.ndarray, cluster: np.ndarray, breadth: np.ndarray) -> np.ndarray:
    """See `Clusters`."""
    broadest = np.empty(len(right), np.float64)
    for node in range(len(right) - 1, -1, -1):
        if cluster[node] >= 0:
            broadest[node] = breadth[cluster[node]]
        else:
            broadest[node] = max(broadest[node + 1], broadest[right[node]])
    return broadest


@kernel()
def place_node(clusters: Clusters, node: int, centre: np.ndarray, half: np.ndarray, placed: np.ndarray) -> None:
    """A node's box in a cell's coordinates, into placed (2, 3) float64; that of a leaf is its cluster's own.

    centre, half: (3,) float64 the cell in grid units. Rounding keeps a box around all that is below its node.
    """
    if clusters.cluster[node] >= 0:
        place_cluster(clusters, clusters.cluster[node], centre, half, placed)
        return
    for k in range(3):
        placed[0, k] = (clusters.box[node, 0, k] - centre[k]) / half[k]
        placed[1, k] = (clusters.box[node, 1, k] - centre[k]) / half[k]


@kernel()
def place_cluster(clusters: Clusters, c: int, centre: np.ndarray, half: np.ndarray, placed: np.ndarray) -> None:
    """As `place_node`, for a cluster."""
    for k in range(3):
        placed[0, k] = (clusters.lo[c, k] - centre[k]) / half[k]
        placed[1, k] = (clusters.hi[c, k] - centre[k]) / half[k]
