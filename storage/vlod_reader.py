"""Reading cell shards: what can be seen from each cell, and what changes between neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import ParameterError
from storage.cells.codecs import codec_named
from storage.cells.deltas import Delta, Ids, apply_chain
from storage.model.tables import BOUNDARY, CELL_LINK
from storage.shards.cache import ByteCache
from storage.shards.columns import unpack_table
from storage.shards.sections import CellShardRecord
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import Kind


class _Boundaries(NamedTuple):
    """The boundaries of the cells of one shard."""

    table: np.ndarray  # BOUNDARY, sorted by first, second
    keys: NDArray[np.int64]  # (k, 2), first and second of each boundary, cells of the store


class VlodReader:
    """The vLODs of a store's cells and the changes between them. Safe to use from several threads.

    shards: in the order of their cells; cache: keeps what was decoded.
    Raises StoreFormatError if one of the shards is in a codec that is not known here. The methods raise
    CorruptStoreError where bytes are missing or changed, StoreUnreachableError where they cannot be read.
    """

    def __init__(self, files: ShardFiles, shards: Sequence[CellShardRecord], cache: ByteCache[Any]) -> None:
        self._files = files
        self._shards = shards
        self._codecs = {name: codec_named(name) for name in sorted({shard.codec for shard in shards})}
        self._starts = np.cumsum([0, *(shard.cells for shard in shards)], dtype=np.int64)
        self._cache = cache

    def vlod(self, cell: int, count: int) -> NDArray[np.int64]:
        """The ids (n,) of the drawables that can be seen from a cell that was computed, strictly increasing.

        count: how many they are. Reads the cell's key set and the deltas on the way to it, not the whole shard.
        """

        def load() -> tuple[NDArray[np.int64], int]:
            number, at = self._place(cell)
            links = self._links(number)
            lists: list[Ids] = []
            while (parent := int(links[at]["parent"])) >= 0:
                lists.extend(self._change(number, int(links[at]["frame"]), int(links[at]["slot"])))
                at = parent
            lists.extend(self._block(number, int(links[at]["frame"]), Kind.KEY_SET))
            ids = apply_chain(lists).astype(np.int64)
            if len(ids) != count:
                raise self._files.reader(self._shards[number]).corrupt(f"cell {cell} has {len(ids)} drawables")
            ids.flags.writeable = False
            return ids, ids.nbytes

        ids: NDArray[np.int64] = self._cache.get(("vlod", int(cell)), load)
        return ids

    def delta(self, a: int, b: int) -> Delta:
        """What changes from cell a to cell b > a, both computed. Raises ParameterError if they share no face."""
        number, _ = self._place(a)
        table, keys = self._boundaries(number)
        run = slice(*np.searchsorted(keys[:, 0], [a, a + 1]).tolist())
        at = run.start + int(np.searchsorted(keys[run, 1], b))
        if at >= run.stop or keys[at, 1] != b:
            raise ParameterError(f"cells {a} and {b} share no face")
        row = table[at]
        return self._change(number, int(row["frame"]), int(row["slot"]))

    def _place(self, cell: int) -> tuple[int, int]:
        """The shard that holds a cell, and the cell's index in it."""
        number = int(np.searchsorted(self._starts, cell, side="right")) - 1
        return number, cell - int(self._starts[number])

    def _links(self, number: int) -> np.ndarray:
        """CELL_LINK of a shard."""

        def load() -> tuple[np.ndarray, int]:
            reader = self._files.reader(self._shards[number])
            links = reader.decoded(1, Kind.TABLE, lambda data: unpack_table(data, CELL_LINK))
            return links, links.nbytes

        links: np.ndarray = self._cache.get(("links", number), load)
        return links

    def _boundaries(self, number: int) -> _Boundaries:
        def load() -> tuple[_Boundaries, int]:
            reader = self._files.reader(self._shards[number])
            table = reader.decoded(2, Kind.TABLE, lambda data: unpack_table(data, BOUNDARY))
            keys = np.stack([table["first"] + self._starts[number], table["second"]], axis=1).astype(np.int64)
            return _Boundaries(table, keys), table.nbytes + keys.nbytes

        boundaries: _Boundaries = self._cache.get(("boundaries", number), load)
        return boundaries

    def _block(self, number: int, frame: int, kind: Kind) -> list[Ids]:
        """A decoded frame of key sets or deltas."""

        def load() -> tuple[list[Ids], int]:
            shard = self._shards[number]
            lists = self._files.reader(shard).decoded(frame, kind, self._codecs[shard.codec].decode)
            return lists, sum(ids.nbytes for ids in lists)

        lists: list[Ids] = self._cache.get(("block", number, frame), load)
        return lists

    def _change(self, number: int, frame: int, slot: int) -> Delta:
        lists = self._block(number, frame, Kind.DELTAS)
        return Delta(lists[2 * slot], lists[2 * slot + 1])
