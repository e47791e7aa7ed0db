"""Every byte of a store against its shards' checksums, and what is said to be see-through against alpha."""

from __future__ import annotations

from jobs.checking.workers import Place
from storage.base.errors import StoreError
from storage.check import problems_of_alpha, problems_of_shard
from storage.shards.cache import ByteCache
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import ShardRecord


def check_shard(place: Place, record: ShardRecord) -> list[str]:
    """Reads the whole shard and says what is wrong with it, one line each. Holds one shard in memory.

    Where the tables cannot be read, which are checked as a shard of their own, nothing is said of alpha.
    """
    found = list(problems_of_shard(ShardFiles(place.files, ByteCache(0)), record))
    if not found:
        try:
            store = place.store
        except StoreError:
            return []
        found = list(problems_of_alpha(store, place.manifest, record))
    return [problem.what for problem in found]
