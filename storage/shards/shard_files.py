"""The shards of a store where its files are: readers on demand, and several shards at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar

from storage.base.errors import CURE, CorruptStoreError, StoreError, StoreNotFoundError
from storage.shards.cache import ByteCache
from storage.shards.files import AT_ONCE, Files, Range
from storage.shards.shards import Kind, ShardReader, ShardRecord, shard_path

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
                raise _missing(error, path) from error

        return ShardReader(record, read, self._cache, self.files.url, doubt=partial(self.files.forget, path))

    def fetched(self, records: Sequence[ShardRecord]) -> list[ShardReader]:
        """Readers of shards that are read whole, all of them at once, and kept for as long as their readers are.

        Their methods raise what those of `reader` do.
        """
        with ThreadPoolExecutor(AT_ONCE) as pool:
            return list(pool.map(self._fetched, records))

    def _fetched(self, record: ShardRecord) -> ShardReader:
        path = shard_path(record.name)
        try:
            content: bytes | StoreError = self.files.read(path)
        except StoreNotFoundError as error:
            content = _missing(error, path)
        except StoreError as error:
            content = error

        def read(start: int, end: int) -> bytes:
            if isinstance(content, StoreError):
                raise content
            return content[start:end]

        return ShardReader(record, read, ByteCache(0), self.files.url, doubt=partial(self.files.forget, path))

    def frames(self, wanted: Sequence[tuple[ShardRecord, int, Kind]]) -> list[bytes | None]:
        """The bytes of many frames (shard, number, kind), checked, in as few requests as may be, made at once.

        None for each that is missing, damaged or out of reach: reading it alone says why.
        """

        def span(frame: tuple[ShardRecord, int, Kind]) -> tuple[int, int] | None:
            try:
                return self.reader(frame[0]).span(*frame[1:])
            except StoreError:
                return None

        with ThreadPoolExecutor(AT_ONCE) as pool:
            spans = list(pool.map(span, wanted))
        found: list[bytes | None] = [None] * len(wanted)
        apart: dict[int, Range] = {}
        for at, ((record, number, kind), place) in enumerate(zip(wanted, spans, strict=True)):
            if place is None:
                continue
            reader = self.reader(record)
            if reader.whole:
                with suppress(StoreError):
                    found[at] = reader.frame(number, kind)
            else:
                apart[at] = Range(shard_path(record.name), *place)
        for at, data in zip(apart, self.files.read_many(list(apart.values())), strict=True):
            if isinstance(data, bytes):
                with suppress(StoreError):
                    found[at] = self.reader(wanted[at][0]).checked(wanted[at][1], data)
        return found

    def of_each(self, records: Iterable[ShardRecord], read: Callable[[ShardReader], Value]) -> list[Value]:
        """What `read` gives of each shard, in the order of `records`; AT_ONCE of them are read at a time."""
        with ThreadPoolExecutor(AT_ONCE) as pool:
            return list(pool.map(lambda record: read(self.reader(record)), records))


def _missing(error: StoreNotFoundError, path: str) -> CorruptStoreError:
    return CorruptStoreError(f"{error}; {CURE}", path)
