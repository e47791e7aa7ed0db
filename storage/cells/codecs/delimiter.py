"""Lists of ids in the vLOD paper's own code: see `storage.cells.codecs.offsets_and_runs`.

Based on: Chhugani et al., vLOD: High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005,
section 6 and appendix A.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import CorruptStoreError
from storage.cells.codecs.changes import Changes
from storage.cells.codecs.offsets_and_runs import LONGEST, decode_numbers, encode_numbers, ids_of, offsets_and_runs

#: No list holds ids from here on; larger ones mean damage.
MOST_IDS = 1 << 32


class Delimiter:
    """Lists of ids one after the other, each as how many runs it has, plus 1, and these."""

    def encode_lists(self, lists: Sequence[NDArray[np.uint32]]) -> bytes:
        """Bytes of lists of strictly increasing uint32 ids. Raises ValueError for one of more than LONGEST."""
        if any(len(ids) > LONGEST for ids in lists):
            raise ValueError(f"the delimiter code holds at most {LONGEST} ids in a list")
        parts = [np.zeros(0, np.int64)]
        for ids in lists:
            own = offsets_and_runs(ids)
            parts += [np.array([len(own) // 2 + 1]), own]
        return encode_numbers(np.concatenate(parts))

    def decode_lists(self, data: bytes) -> list[NDArray[np.uint32]]:
        """The lists again. Raises CorruptStoreError if the bytes make no sense."""
        numbers, lists, at = decode_numbers(data), [], 0
        while at < len(numbers):
            end = at + 2 * int(numbers[at]) - 1
            if end > len(numbers):
                raise CorruptStoreError("a list of runs ends before its last one")
            lists.append(ids_of(numbers[at + 1 : end], MOST_IDS).astype(np.uint32))
            at = end
        return lists


CODEC = Changes(Delimiter())
