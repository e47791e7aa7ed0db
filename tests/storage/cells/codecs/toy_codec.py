"""A codec as simple as can be: what a new codec needs, and no more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from storage.base.errors import CorruptStoreError
from storage.cells.group import Group, Ids


class Plain:
    """Counts and ids as they are, four bytes each."""

    def encode(self, sets: Sequence[Ids], group: Group) -> bytes:
        """See `storage.cells.codecs.Codec.encode`."""
        return b"".join(np.array([len(ids), *ids], "<u4").tobytes() for ids in sets)

    def decode(self, data: bytes, group: Group) -> list[Ids]:
        """See `storage.cells.codecs.Codec.decode`."""
        if len(data) % 4:
            raise CorruptStoreError("a plain group has no whole number of numbers")
        numbers, sets = np.frombuffer(data, "<u4").astype(np.int64), []
        while len(numbers):
            if numbers[0] >= len(numbers) or (np.diff(numbers[1 : 1 + int(numbers[0])]) <= 0).any():
                raise CorruptStoreError("a plain group makes no sense")
            sets.append(numbers[1 : 1 + int(numbers[0])])
            numbers = numbers[1 + int(numbers[0]) :]
        if len(sets) != group.count:
            raise CorruptStoreError(f"a plain group holds {len(sets)} sets, not {group.count}")
        return sets


CODEC = Plain()
