"""Every byte of a store against the checksums that name its shards."""

from __future__ import annotations

from jobs.checking.workers import Place
from storage.base.errors import CorruptStoreError, StoreError, StoreNotFoundError
from storage.shards.shards import ShardReader, ShardRecord, shard_path


def check_shard(place: Place, record: ShardRecord) -> list[str]:
    """Reads the whole shard and says what is wrong with it, one line each. Holds one shard in memory."""
    path = shard_path(record.name)

    def read(start: int, end: int) -> bytes:
        try:
            return place.files.read(path, start, end)
        except StoreNotFoundError as error:
            raise CorruptStoreError(f"{place.url}/{path} is missing; copy it again or run the build again") from error

    try:
        size = place.files.size(path)
        if size is not None and size != record.bytes:
            return [f"{path} has {size} bytes, not {record.bytes}; copy it again or run the build again"]
        return list(ShardReader(record, read).problems())
    except StoreError as error:
        return [str(error)]
