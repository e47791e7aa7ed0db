"""A codec of lists of ids as one of groups: the first cell's set whole, then what each further one adds and drops.

Each cell is told by its difference from the nearest of the cells before it.

Based on: vLOD (see `storage.cells.deltas`), section 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import CorruptStoreError
from storage.cells.codecs.context_mixing import NEAREST, nearest_before
from storage.cells.deltas import Delta, apply, difference
from storage.cells.group import Group, Ids


class ListCodec(Protocol):
    """Turns lists of ids into bytes and back."""

    def encode_lists(self, lists: Sequence[NDArray[np.uint32]]) -> bytes:
        """Bytes of lists of strictly increasing ids, uint32 (n,) each; lists may be empty."""
        ...

    def decode_lists(self, data: bytes) -> list[NDArray[np.uint32]]:
        """The lists again. Raises CorruptStoreError if the bytes make no sense."""
        ...


class Changes:
    """Codes groups in a codec of lists."""

    def __init__(self, lists: ListCodec) -> None:
        self.lists = lists

    def encode(self, sets: Sequence[Ids], group: Group) -> bytes:
        """See `storage.cells.codecs.Codec`."""
        lists: list[NDArray[np.uint32]] = []
        for cell, before in enumerate(_before(group)):
            own = np.asarray(sets[cell], np.uint32)
            lists += [own] if before < 0 else difference(np.asarray(sets[before], np.uint32), own)
        return self.lists.encode_lists(lists)

    def decode(self, data: bytes, group: Group) -> list[Ids]:
        """See `storage.cells.codecs.Codec`."""
        lists = self.lists.decode_lists(data)
        if len(lists) != max(2 * group.count - 1, 0):
            raise CorruptStoreError(f"a group of {group.count} cells holds {len(lists)} lists")
        sets: list[NDArray[np.uint32]] = []
        try:
            for cell, before in enumerate(_before(group)):
                if before < 0:
                    sets.append(lists[0])
                else:
                    sets.append(apply(sets[before], Delta(lists[2 * cell - 1], lists[2 * cell])))
        except ValueError as error:
            raise CorruptStoreError(f"a group of cells cannot be decoded: {error}") from error
        return [ids.astype(np.int64) for ids in sets]


def _before(group: Group) -> list[int]:
    """For each cell the nearest before it; -1 for the first."""
    nearest = np.empty((group.count, NEAREST), np.int64)
    nearest_before(group.centres, nearest)
    found: list[int] = nearest[:, 0].tolist()
    return found
