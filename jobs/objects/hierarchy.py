"""From placed pieces to the model's objects and the trees above them.

Pieces come out of Partition I. Small ones are clustered, clusters that became too much are split again (Partition II),
and a tree is built over the objects that result. Only boxes and counts are needed for that, never triangles.

A piece of a mesh that is placed several times stays shared, with levels of its own, as an object by itself: its
triangles are then stored once. Where it has so few triangles that naming it costs more than repeating it, its
placements are merged into their surroundings like any other piece.

What can be seen through and what is opaque have a tree each, the opaque first: so no object, and no node above objects,
is ever of both, and the tree of either is the same whatever there is of the other.

Based on: W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, sections 4.2 and 6.3.1.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from jobs.objects.clustering import cluster
from jobs.objects.components import grouped
from jobs.objects.object_options import Limits, ObjectOptions
from jobs.objects.partition import divide
from jobs.objects.tree import Tree, build_tree

#: Instanced pieces of at most this many triangles are merged: they take fewer bytes than the rows that name them.
MERGED_TRIANGLES = 64

#: A piece as it is placed in the model.
PLACED_PIECE = np.dtype(
    [
        ("piece", "<u4"),  # index among all pieces
        ("part", "<u4"),  # index of the part that places it
        ("triangles", "<u4"),
        ("lo", "<f8", (3,)),  # box in model space
        ("hi", "<f8", (3,)),
        ("instanced", "?"),  # its mesh is placed several times
        ("outward", "?"),  # closed and wound outward
        ("see_through", "?"),  # none of its triangles is opaque
    ]
)


class Hierarchy(NamedTuple):
    """Objects and the trees above them."""

    tree: Tree  # one tree, or two one after the other; its leaves' objects count from 0 in their order
    roots: np.ndarray  # (trees,) int64, increasing: the node above all others of each tree
    members: np.ndarray  # (p,) int64: placed pieces, object by object
    start: np.ndarray  # (objects + 1,) int64 into members
    shared: np.ndarray  # (objects,) bool: one placement of an instanced piece
    clusters: int  # objects before Partition II


def build_hierarchy(
    placed: np.ndarray, options: ObjectOptions, model_lo: np.ndarray, model_hi: np.ndarray
) -> Hierarchy:
    """Cluster placed pieces, PLACED_PIECE (p,), p > 0, split what became too much, and build the trees."""
    kinds = (np.flatnonzero(placed["see_through"] == kind) for kind in (False, True))
    return functools.reduce(
        _beside, (_of_one_kind(placed, own, options, model_lo, model_hi) for own in kinds if len(own))
    )


def _of_one_kind(
    placed: np.ndarray, own: np.ndarray, options: ObjectOptions, model_lo: np.ndarray, model_hi: np.ndarray
) -> Hierarchy:
    """The objects and the tree of some placed pieces, `own` (k,): all of them opaque, or none."""
    placed = placed[own]
    shared = placed["instanced"] & (placed["triangles"] > MERGED_TRIANGLES)
    kind = np.where(shared, -1, placed["outward"].astype(np.int64))
    lo, hi = np.ascontiguousarray(placed["lo"]), np.ascontiguousarray(placed["hi"])
    number = cluster(lo, hi, kind, options.clustering, model_lo, model_hi)
    clusters = int(number.max()) + 1
    order, begin = grouped(number, clusters)
    extent = np.asarray(model_hi, np.float64) - np.asarray(model_lo, np.float64)
    diagonal = float(np.sqrt((extent * extent).sum()))
    order, start = _divided(order, begin, lo, hi, placed["triangles"].astype(np.int64), options.again, diagonal)

    objects = len(start) - 1
    object_lo = np.minimum.reduceat(lo[order], start[:-1], axis=0)
    object_hi = np.maximum.reduceat(hi[order], start[:-1], axis=0)
    triangles = np.add.reduceat(placed["triangles"][order].astype(np.int64), start[:-1])
    tree = build_tree(object_lo, object_hi, triangles)
    old = tree.leaf[tree.leaf >= 0]
    leaf = np.full(len(tree.leaf), -1, np.int64)
    leaf[tree.leaf >= 0] = np.arange(objects)
    sizes = np.diff(start)[old]
    ends = np.cumsum(sizes)
    members = order[np.repeat(start[old] - (ends - sizes), sizes) + np.arange(len(order))]
    starts = np.concatenate([[0], ends]).astype(np.int64)
    root = np.zeros(1, np.int64)
    return Hierarchy(tree._replace(leaf=leaf), root, own[members], starts, shared[members[starts[:-1]]], clusters)


def _beside(left: Hierarchy, right: Hierarchy) -> Hierarchy:
    """Two hierarchies as one, the trees of the second behind those of the first."""
    nodes, objects = len(left.tree.end), len(left.shared)
    leaf = np.where(right.tree.leaf >= 0, right.tree.leaf + objects, -1)
    moved = right.tree._replace(end=right.tree.end + nodes, leaf=leaf)
    return Hierarchy(
        Tree(*(np.concatenate(pair) for pair in zip(left.tree, moved, strict=True))),
        np.concatenate([left.roots, right.roots + nodes]),
        np.concatenate([left.members, right.members]),
        np.concatenate([left.start, right.start[1:] + len(left.members)]),
        np.concatenate([left.shared, right.shared]),
        left.clusters + right.clusters,
    )


def _divided(
    order: np.ndarray,
    start: np.ndarray,
    lo: np.ndarray,
    hi: np.ndarray,
    triangles: np.ndarray,
    limits: Limits,
    diagonal: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Partition II: groups of pieces that are too much are divided; see `divide`."""
    bounds = (limits.triangles, limits.size * diagonal, limits.ratio, limits.most)
    totals = np.add.reduceat(triangles[order], start[:-1])
    cuts = [start[:-1]]
    for group in np.flatnonzero((totals > limits.triangles) & (np.diff(start) > 1)).tolist():
        run = slice(int(start[group]), int(start[group + 1]))
        own = order[run]
        items, inner = divide(lo[own], hi[own], triangles[own], bounds)
        order[run] = own[items]
        cuts.append(run.start + inner[1:-1])
    return order, np.append(np.sort(np.concatenate(cuts)), len(order))
