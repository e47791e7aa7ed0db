"""Every byte of a store against the checksums that name its shards."""

from __future__ import annotations

from jobs.checking.workers import Place
from storage.check import problems_of_shard
from storage.shards.cache import ByteCache
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import ShardRecord


def check_shard(place: Place, record: ShardRecord) -> list[str]:
    """Reads the whole shard and says what is wrong with it, one line each. Holds one shard in memory."""
    return [problem.what for problem in problems_of_shard(ShardFiles(place.files, ByteCache(0)), record)]
