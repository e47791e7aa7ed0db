"""A codec of ids that no store is written in: numbers one after the other, four bytes each."""

from __future__ import annotations

import numpy as np


class Plain:
    """Lengths of the lists, then the ids."""

    block_ids = 64

    def encode(self, lists):
        """See `storage.cells.codecs.Codec`."""
        lengths = [len(lists), *(len(ids) for ids in lists)]
        return np.concatenate([np.array(lengths, "<u4"), *lists]).astype("<u4").tobytes()

    def decode(self, data):
        """See `storage.cells.codecs.Codec`."""
        numbers = np.frombuffer(data, "<u4")
        ends = 1 + int(numbers[0]) + np.cumsum(numbers[1 : 1 + int(numbers[0])])
        return np.split(numbers[: ends[-1]], [1 + int(numbers[0]), *ends[:-1]])[1:] if len(ends) else []


CODEC = Plain()
