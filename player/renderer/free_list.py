"""Which parts of a buffer are free: ranges out of it, given and taken back.

The smallest range that is large enough is given, the first of several: found by bisection, however many there are.
"""

from __future__ import annotations

from bisect import bisect_left, insort


class FreeList:
    """Best-fit allocation of ranges [start, start + size) out of [0, capacity), merging freed neighbours."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.free = 0  # units that are not allocated
        self._starts: list[int] = []  # of the free ranges, increasing
        self._sizes: dict[int, int] = {}  # by start
        self._by_size: list[tuple[int, int]] = []  # (size, start), increasing
        self.release(0, capacity)

    def allocate(self, size: int) -> int | None:
        """Start of a free range of `size` units, or None if there is none."""
        at = bisect_left(self._by_size, (size, 0))
        if at == len(self._by_size):
            return None
        available, start = self._by_size[at]
        self._take(start)
        self._add(start + size, available - size)
        return start

    def release(self, start: int, size: int) -> None:
        """Gives back a range that `allocate` returned."""
        at = bisect_left(self._starts, start)
        after = self._starts[at] if at < len(self._starts) else None
        before = self._starts[at - 1] if at > 0 else None
        if after == start + size:
            size += self._take(after)
        if before is not None and before + self._sizes[before] == start:
            start, size = before, size + self._take(before)
        self._add(start, size)

    def grow(self, capacity: int) -> None:
        """Adds the units from the present capacity up to `capacity`."""
        added, start = capacity - self.capacity, self.capacity
        self.capacity = capacity
        self.release(start, added)

    def _add(self, start: int, size: int) -> None:
        if size:
            insort(self._starts, start)
            insort(self._by_size, (size, start))
            self._sizes[start] = size
            self.free += size

    def _take(self, start: int) -> int:
        """Takes a whole free range out; returns its size."""
        size = self._sizes.pop(start)
        del self._starts[bisect_left(self._starts, start)]
        del self._by_size[bisect_left(self._by_size, (size, start))]
        self.free -= size
        return size
