"""Which packs stay on the GPU: the ones used last, within a budget of bytes; what is drawn is locked.

Based on: Chhugani et al., vLOD: High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005,
section 6 (locked least-recently-used cache).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class PackCache:
    """Book-keeping of resident packs. Holds no data itself: the arena does.

    Numbers of packs are indices into arrays, so that thousands of packs are touched in one step per frame.
    """

    def __init__(self, sizes: NDArray[np.int64], budget: int) -> None:
        """Sizes (packs,): bytes of each pack on the GPU; budget: in bytes."""
        self._sizes = sizes
        self._budget = budget
        self._resident = np.zeros(len(sizes), np.bool_)
        self._locked = np.zeros(len(sizes), np.bool_)
        self._kept = np.zeros(len(sizes), np.bool_)
        self._last_used = np.zeros(len(sizes), np.int64)
        self._clock = 0
        self._bytes = 0

    @property
    def bytes(self) -> int:
        """Bytes of the resident packs; above the budget only while locked ones alone exceed it."""
        return self._bytes

    @property
    def budget(self) -> int:
        """In bytes."""
        return self._budget

    @property
    def resident(self) -> NDArray[np.bool_]:
        """Which packs are resident (packs,). Not a copy: do not write to it."""
        return self._resident

    def lock(self, packs: NDArray[np.int64]) -> None:
        """Locks these packs (resident or about to be) and unlocks all others; marks them as used now."""
        self._clock += 1
        self._locked[:] = False
        self._locked[packs] = True
        self._last_used[packs] = self._clock

    def touch(self, packs: NDArray[np.int64]) -> None:
        """Marks these packs as used now without locking them."""
        self._last_used[packs] = self._clock

    def keep(self, packs: NDArray[np.int64]) -> None:
        """These packs are never evicted, drawn or not."""
        self._kept[packs] = True

    def add(self, pack: int) -> None:
        """The pack has become resident; counts as used now."""
        if not self._resident[pack]:
            self._resident[pack] = True
            self._last_used[pack] = max(self._last_used[pack], self._clock)
            self._bytes += int(self._sizes[pack])

    def evict(self) -> NDArray[np.int64]:
        """Drops packs until the budget holds, the longest unused first, never a locked one; returns them (n,)."""
        if self._bytes <= self._budget:
            return np.zeros(0, np.int64)
        candidates = np.flatnonzero(self._resident & ~self._locked & ~self._kept)
        oldest = candidates[np.lexsort((candidates, self._last_used[candidates]))]
        freed = np.cumsum(self._sizes[oldest])
        enough = int(np.searchsorted(freed, self._bytes - self._budget)) + 1
        dropped = oldest[:enough]
        self._resident[dropped] = False
        self._bytes -= int(self._sizes[dropped].sum())
        return dropped

    def room(self) -> int:
        """Bytes that could hold packs that are not drawn now."""
        held = self._resident & (self._locked | self._kept)
        return max(0, self._budget - int(self._sizes[held].sum()))
