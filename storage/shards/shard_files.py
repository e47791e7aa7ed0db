"""The shards of a store where its files are: readers on demand, and several shards at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from storage.base.errors import CURE, CorruptStoreError, StoreNotFoundError
from storage.shards.cache import ByteCache
from storage.shards.files import Files
from storage.shards.shards import ShardReader, ShardRecord, shard_path

#: How many shards are read at once where all of them are.
AT_ONCE = 16

Value = TypeVar("Value")


class ShardFiles:
    """The shards of a store, read within a budget of memory. Safe to use from several threads.

    cache: keeps the ends of shards, beside whatever else it is used for.
    """

    def __init__(self, files: Files, cache: ByteCache[Any]) -> None:
        self.files = files
        self._cache = cache

    def reader(self, record: ShardRecord) -> ShardReader:
        """Reads one shard. Nothing is read yet.

        Its methods raise CorruptStoreError where the shard is missing or damaged, StoreUnreachableError where it cannot
        be read.
        """
        path = shard_path(record.name)

        def read(start: int, end: int) -> bytes:
            try:
                return self.files.read(path, start, end)
            except StoreNotFoundError as error:
                raise CorruptStoreError(f"{error}; {CURE}", path) from error

        return ShardReader(record, read, self._cache, self.files.url)

    def of_each(self, records: Iterable[ShardRecord], read: Callable[[ShardReader], Value]) -> list[Value]:
        """What `read` gives of each shard, in the order of `records`; AT_ONCE of them are read at a time."""
        with ThreadPoolExecutor(AT_ONCE) as pool:
            return list(pool.map(lambda record: read(self.reader(record)), records))
