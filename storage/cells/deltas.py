"""What changes from one cell's vLOD to a neighbour's: the drawables added and dropped across a boundary.

Based on: Chhugani et al., vLOD: High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005,
section 6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Ids = NDArray[np.uint32]


class Delta(NamedTuple):
    """A change of a set of drawables: ids strictly increasing, uint32 (n,) each."""

    added: Ids
    dropped: Ids

    def reversed(self) -> Delta:
        """The change the other way."""
        return Delta(self.dropped, self.added)


def difference(before: Ids, after: Ids) -> Delta:
    """The change from one set to another, both strictly increasing ids (n,)."""
    return Delta(
        np.setdiff1d(after, before, assume_unique=True).astype(np.uint32),
        np.setdiff1d(before, after, assume_unique=True).astype(np.uint32),
    )


def apply(ids: Ids, delta: Delta) -> Ids:
    """The set after the change, strictly increasing.

    Raises ValueError if the change does not fit: it adds what is there, or drops what is not.
    """
    kept = np.setdiff1d(ids, delta.dropped, assume_unique=True)
    if len(kept) + len(delta.dropped) != len(ids):
        raise ValueError("a delta drops ids that are not there")
    joined = np.sort(np.concatenate([kept, delta.added])).astype(np.uint32)
    if (joined[1:] == joined[:-1]).any():
        raise ValueError("a delta adds ids that are there already")
    return joined
