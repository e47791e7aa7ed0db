"""The trees in fragments: subtrees, and subtrees above these, each of about as much work as a task should have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: What a node offers its parent, as a part of what it is made from.
OFFERED = 0.5


@dataclass(frozen=True)
class Fragment:
    """A connected part of a tree."""

    root: int  # node
    stops: list[int]  # nodes below it that are roots of fragments of their own, increasing
    triangles: int  # that are worked on, about


def plan_fragments(end: np.ndarray, roots: np.ndarray, triangles: np.ndarray, most: int) -> list[Fragment]:
    """Part trees into fragments of about `most` triangles of work each; those below others come first.

    end (n,) int64, roots (trees,) int64: the trees, see jobs.objects.hierarchy; triangles (n,) int64: of each leaf,
    0 of inner nodes. No fragment is of two trees.
    """
    n = len(end)
    work = triangles.astype(np.float64)
    offer = work * OFFERED
    stops: list[list[int]] = [[] for _ in range(n)]
    found: list[Fragment] = []

    def close(node: int) -> None:
        found.append(Fragment(node, sorted(stops[node]), int(work[node])))
        work[node] = offer[node]
        stops[node] = [node]

    for node in range(n - 1, -1, -1):
        if end[node] == node + 1:
            continue
        pair = [node + 1, int(end[node + 1])]
        own = float(offer[pair].sum())
        for child in sorted(pair, key=lambda child: -work[child]):
            if work[pair].sum() + own > most and end[child] > child + 1 and stops[child] != [child]:
                close(child)
        work[node] = work[pair].sum() + own
        offer[node] = own * OFFERED
        stops[node] = stops[pair[0]] + stops[pair[1]]
        for child in pair:
            stops[child] = []
    for root in roots.tolist():
        close(root)
    return found
