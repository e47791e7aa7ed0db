"""The vLOD paper's own way to a tour: the nearest of one sample, and from each column on to the nearest that is left.

A baseline. One sample of the size of a logarithm is the thinner the more columns there are, and the tour the longer.

Based on: vLOD (see `columns`), section 6: a sample of 16 log2 n for all columns, all of which are kept in the order of
their distance; the tour goes on at any column where none of those near is left.
"""

from __future__ import annotations

import numpy as np

from jobs.ordering.signatures import mixed
from storage.base.kernels import allocating_kernel


def sample(members: np.ndarray) -> np.ndarray:
    """16 log2 n of n columns (n,), drawn at random, the same on every machine."""
    size = min(len(members), 16 * max(len(members).bit_length(), 1))
    drawn = np.argsort(mixed(np.arange(len(members), dtype=np.uint64)), kind="stable")[:size]
    return np.asarray(members[np.sort(drawn)])


@allocating_kernel()
def nearest_unvisited(members: np.ndarray, near: np.ndarray, count: int) -> np.ndarray:
    """A path (m,) int64 through all members (m,) int64, from the first on.

    near: (count, k) int32 for each column the nearest of the sample, -1 for none; count: of all columns.
    """
    path = np.empty(len(members), np.int64)
    visited = np.zeros(count, np.bool_)
    left = 0
    current = members[0]
    for at in range(len(members)):
        path[at] = current
        visited[current] = True
        following = -1
        for other in near[current]:
            if other >= 0 and not visited[other]:
                following = other
                break
        while following < 0 and left < len(members):
            if not visited[members[left]]:
                following = members[left]
            else:
                left += 1
        current = following
    return path
