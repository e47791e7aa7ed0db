"""A codec that no store is written in: numbers one after the other, four bytes each."""

from __future__ import annotations

import numpy as np


class Plain:
    """Lengths of the sets, then the ids."""

    def encode(self, sets, group):
        """See `storage.cells.codecs.Codec`."""
        lengths = [len(sets), *(len(ids) for ids in sets)]
        return np.concatenate([np.array(lengths, "<u4"), *sets]).astype("<u4").tobytes()

    def decode(self, data, group):
        """See `storage.cells.codecs.Codec`."""
        numbers = np.frombuffer(data, "<u4").astype(np.int64)
        ends = 1 + int(numbers[0]) + np.cumsum(numbers[1 : 1 + int(numbers[0])])
        return np.split(numbers[: ends[-1]], [1 + int(numbers[0]), *ends[:-1]])[1:] if len(ends) else []


CODEC = Plain()
