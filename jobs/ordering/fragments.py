"""Fragments of a path: the shortest edges first, then the ends of what came about, until all is one path.

Edges between near columns are taken in the order of their length, where neither end has two already and no ring
closes. Then only the ends of fragments are compared, with the nearest ends of others, and so on: each round joins most
of them, so that no step looks at all pairs.

Based on: J. L. Bentley, Fast Algorithms for Geometric Traveling Salesman Problems, ORSA Journal on Computing 4(4),
1992 (greedy); the rounds are our own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from storage.base.kernels import allocating_kernel, kernel


@dataclass(frozen=True)
class Fragments:
    """Paths through columns that are not yet one."""

    links: np.ndarray  # (count, 2) int64 columns beside each, -1 for none
    roots: np.ndarray  # (count,) int64: a forest; columns of one fragment have one root

    @staticmethod
    def single(count: int) -> Fragments:
        """Every column a fragment of its own."""
        return Fragments(np.full((count, 2), -1, np.int64), np.arange(count))

    def join(self, members: np.ndarray, near: np.ndarray, apart: np.ndarray) -> None:
        """Joins fragments by edges from members (m,) to those near (m, k) int32, `apart` (m, k): the shortest first."""
        one = np.repeat(members, near.shape[1])
        there = near.ravel() >= 0
        one, other, far = one[there], near.ravel()[there].astype(np.int64), apart.ravel()[there]
        _join(one, other, np.argsort(far, kind="stable"), self.links, self.roots)

    def groups(self, members: np.ndarray) -> np.ndarray:
        """The fragment of each of members (m,): (m,) int64."""
        return _roots_of(self.roots, members)

    def path(self, members: np.ndarray) -> np.ndarray:
        """All members (m,) int64 as one path, when they are one fragment; from the end with the lower number on."""
        return _walked(self.links, members)


@kernel()
def _root(roots: np.ndarray, column: int) -> int:
    while roots[column] != column:
        roots[column] = roots[roots[column]]
        column = roots[column]
    return column


@kernel()
def _join(one: np.ndarray, other: np.ndarray, order: np.ndarray, links: np.ndarray, roots: np.ndarray) -> None:
    for edge in order:
        a, b = one[edge], other[edge]
        if links[a, 1] >= 0 or links[b, 1] >= 0:
            continue
        root_a, root_b = _root(roots, a), _root(roots, b)
        if root_a != root_b:
            roots[max(root_a, root_b)] = min(root_a, root_b)
            links[a, 0 if links[a, 0] < 0 else 1] = b
            links[b, 0 if links[b, 0] < 0 else 1] = a


@allocating_kernel()
def _roots_of(roots: np.ndarray, members: np.ndarray) -> np.ndarray:
    found = np.empty(len(members), np.int64)
    for at in range(len(members)):
        found[at] = _root(roots, members[at])
    return found


@allocating_kernel()
def _walked(links: np.ndarray, members: np.ndarray) -> np.ndarray:
    path = np.empty(len(members), np.int64)
    current = -1
    for column in members:
        if links[column, 1] < 0 and (current < 0 or column < current):
            current = column
    before = -1
    for at in range(len(members)):
        path[at] = current
        following = links[current, 0] if links[current, 0] != before else links[current, 1]
        before, current = current, following
    return path
