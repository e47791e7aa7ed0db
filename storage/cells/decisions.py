"""How many decisions it takes to tell what of a cell's cut is seen, going down the hierarchy: its cost.

One at each node that has more than one node of the cut below it, "is anything below seen?", and one at each node of the
cut that is come to.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel


@allocating_kernel()
def decisions(end: NDArray[np.int64], cut: NDArray[np.int64], seen: NDArray[np.bool_]) -> int:
    """How many decisions a cell takes.

    end (n,): see NODE; cut (c,): the nodes of its cut, increasing; seen (c,): which of them are seen.
    """
    below = np.zeros(len(end) + 1, np.int32)
    visible = np.zeros(len(end) + 1, np.int32)
    for k in range(len(cut)):
        below[cut[k] + 1] = 1
        visible[cut[k] + 1] = seen[k]
    at_cut = below[1:].copy()
    for n in range(len(end)):
        below[n + 1] += below[n]
        visible[n + 1] += visible[n]
    count = 0
    node = np.int64(0)
    while node < len(end):
        if at_cut[node]:
            count += 1
            node = end[node]
        elif below[end[node]] - below[node] <= 1:
            node += 1
        else:
            count += 1
            node = node + 1 if visible[end[node]] > visible[node] else end[node]
    return count
