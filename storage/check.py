"""Checking a store: every byte of it against the checksums that it holds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from storage.base.errors import CURE, StoreError
from storage.shards.manifest import FILE, Manifest, from_bytes
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import ShardRecord, shard_path


class Problem(NamedTuple):
    """Something found wrong."""

    file: str  # path inside the store
    what: str  # one line

    def __str__(self) -> str:
        return self.what


def problems(shards: ShardFiles, manifest: Manifest) -> Iterator[Problem]:
    """Reads every byte of a store and yields what is wrong with it: nothing, for a sound store.

    manifest: as it was when the store was opened.
    """
    place = f"{shards.files.url}/{FILE}"
    try:
        read = from_bytes(shards.files.read(FILE), place)
        if read.version == manifest.version and read != manifest:
            yield Problem(FILE, f"{place} is not what it was when the store was opened")
    except StoreError as error:
        yield Problem(FILE, str(error))
    for _, record in manifest.shards():
        yield from problems_of_shard(shards, record)


def problems_of_shard(shards: ShardFiles, record: ShardRecord) -> Iterator[Problem]:
    """Reads every byte of one shard and yields what is wrong with it. Holds one shard in memory."""
    path = shard_path(record.name)
    try:
        size = shards.files.size(path)
        if size is not None and size != record.bytes:
            yield Problem(path, f"{shards.files.url}/{path} has {size} bytes, not {record.bytes}; {CURE}")
            return
        for what in shards.reader(record).problems():
            yield Problem(path, what)
    except StoreError as error:
        yield Problem(path, str(error))
