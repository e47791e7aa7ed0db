"""Reading cell shards: what can be seen from each cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import CURE, CorruptStoreError
from storage.cells.codecs import codec_named
from storage.known_cells import KnownCells
from storage.shards.cache import ByteCache
from storage.shards.sections import CellShardRecord
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import Kind


class VlodReader:
    """The vLODs of a store's cells. Safe to use from several threads.

    shards: in the order of their cells; cells, groups: CELL and GROUP of the whole store; known: of the hierarchy;
    cache: keeps what was decoded.
    Raises StoreFormatError if one of the shards is in a codec that is not known here, CorruptStoreError where groups
    and shards do not hold the same cells.
    """

    def __init__(
        self,
        files: ShardFiles,
        shards: Sequence[CellShardRecord],
        cells: np.ndarray,
        groups: np.ndarray,
        known: KnownCells,
        cache: ByteCache[Any],
    ) -> None:
        self._files = files
        self._shards = shards
        self._cells = cells
        self._known = known
        self._codecs = {name: codec_named(name) for name in sorted({shard.codec for shard in shards})}
        self._cache = cache
        self._starts = np.cumsum([0, *groups["cells"].tolist()], dtype=np.int64)  # of groups, in cells
        ends = np.cumsum([0, *(shard.cells for shard in shards)], dtype=np.int64)
        self._first_groups = np.searchsorted(self._starts, ends)  # of shards
        whole = self._starts[-1] == ends[-1] == len(cells) and np.array_equal(self._starts[self._first_groups], ends)
        if not whole or (groups["cells"] == 0).any():
            raise CorruptStoreError(f"{files.files.url}: the groups of cells are not those of the shards; {CURE}")

    def vlod(self, cell: int, count: int) -> NDArray[np.int64]:
        """The ids (n,) of the drawables that can be seen from a cell that was computed, strictly increasing.

        count: how many they are. Reads the cell's group, not the whole shard. Raises CorruptStoreError where bytes are
        missing or changed, StoreUnreachableError where they cannot be read.
        """
        group = int(np.searchsorted(self._starts, cell, side="right")) - 1
        first = int(self._starts[group])
        ids = self._group(group)[int(self._cells["computed"][first:cell].sum())]
        if len(ids) != count:
            raise self._files.reader(self._shards[self._shard(group)]).corrupt(
                f"cell {cell} has {len(ids)} drawables, not {count}"
            )
        return ids

    def _shard(self, group: int) -> int:
        """The shard that holds a group."""
        return int(np.searchsorted(self._first_groups, group, side="right")) - 1

    def _group(self, group: int) -> list[NDArray[np.int64]]:
        """The sets of a group's computed cells."""

        def load() -> tuple[list[NDArray[np.int64]], int]:
            number = self._shard(group)
            shard = self._shards[number]
            known = self._known.group(self._cells[self._starts[group] : self._starts[group + 1]])
            decode = self._codecs[shard.codec].decode
            frame = group - int(self._first_groups[number])
            sets = self._files.reader(shard).decoded(frame, Kind.CELLS, lambda data: decode(data, known))
            for ids in sets:
                ids.flags.writeable = False
            return sets, sum(ids.nbytes for ids in sets)

        sets: list[NDArray[np.int64]] = self._cache.get(("group", group), load)
        return sets
