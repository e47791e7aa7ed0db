"""Parts of immutable files from far away, kept on a disk of this machine within a budget of bytes.

Survives restarts and is shared by all processes that name the same folder. What it gives is checked against a checksum
of its own: what a disk has spoilt counts as not there. A cache that cannot be read or written, be its disk full, costs
time and nothing else. What was used least recently goes first.

Based on: diskcache, which keeps a table in SQLite and large values in files beside it.
"""

from __future__ import annotations

import hashlib
import sqlite3
from contextlib import suppress
from pathlib import Path
from typing import Any

from storage.base.errors import MissingDependencyError, ParameterError

try:
    import diskcache
except ImportError as error:
    raise MissingDependencyError(f"--cache-dir needs a package: {error}; pip install diskcache") from error

#: Bytes of the checksum (BLAKE2b) before each value.
CHECKSUM_BYTES = 16

_FAILURES = (OSError, sqlite3.Error, diskcache.Timeout)


class _BytesOnly(diskcache.Disk):
    """Reads values that are bytes and no others: a pickle that somebody put there is never opened."""

    def fetch(self, mode: int, filename: str | None, value: Any, read: bool) -> Any:
        """The value; None if it is not bytes."""
        if mode not in (diskcache.core.MODE_RAW, diskcache.core.MODE_BINARY):
            return None
        return super().fetch(mode, filename, value, read)


class DiskCache:
    """Values (bytes) by key, in `folder`, up to `budget` bytes. Safe to use from several threads and processes.

    Raises ParameterError if the folder cannot be used.
    """

    def __init__(self, folder: Path, budget: int) -> None:
        try:
            self._values = diskcache.Cache(
                str(folder), disk=_BytesOnly, size_limit=budget, eviction_policy="least-recently-used", timeout=5
            )
        except _FAILURES as error:
            raise ParameterError(f"{folder} cannot hold a cache: {error}; name another folder, or empty it") from error

    def get(self, key: str) -> bytes | None:
        """What was put under `key`; None if it is not there, any more or unspoilt."""
        try:
            kept = self._values.get(key)
        except _FAILURES:
            return None
        if not isinstance(kept, bytes):
            return None
        value = kept[CHECKSUM_BYTES:]
        return value if kept[:CHECKSUM_BYTES] == _checksum(key, value) else None

    def put(self, key: str, value: bytes, *, tag: str) -> None:
        """Keeps a value, if it can; `forget` knows it by its tag."""
        with suppress(*_FAILURES):
            self._values.set(key, _checksum(key, value) + value, tag=tag)

    def forget(self, tag: str) -> None:
        """Drops all values with this tag."""
        with suppress(*_FAILURES):
            self._values.evict(tag)


def _checksum(key: str, value: bytes) -> bytes:
    return hashlib.blake2b(key.encode() + b"\0" + value, digest_size=CHECKSUM_BYTES).digest()
