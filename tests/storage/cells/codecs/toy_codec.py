"""A codec as simple as can be: what a new codec needs, and no more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from storage.base.errors import CorruptStoreError
from storage.cells.deltas import Ids


class Plain:
    """Counts and ids as they are, four bytes each."""

    block_ids = 100

    def encode(self, lists: Sequence[Ids]) -> bytes:
        """See `storage.cells.codecs.Codec.encode`."""
        return b"".join(np.array([len(ids), *ids], "<u4").tobytes() for ids in lists)

    def decode(self, data: bytes) -> list[Ids]:
        """See `storage.cells.codecs.Codec.decode`."""
        if len(data) % 4:
            raise CorruptStoreError("a plain block has no whole number of numbers")
        numbers, lists = np.frombuffer(data, "<u4"), []
        while len(numbers):
            if numbers[0] >= len(numbers):
                raise CorruptStoreError("a plain block ends before its ids")
            lists.append(numbers[1 : 1 + int(numbers[0])])
            numbers = numbers[1 + int(numbers[0]) :]
        return lists


CODEC = Plain()
