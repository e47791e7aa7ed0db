"""The bytes of a file, read as they are asked for: a model file may be far larger than memory."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

#: Bytes that are hashed at once.
_BLOCK = 1 << 22


class Content(Protocol):
    """Some bytes that lie somewhere."""

    @property
    def size(self) -> int:
        """How many there are."""
        ...

    def part(self, start: int, end: int) -> bytes:
        """Bytes start ... end - 1; fewer where there are fewer. Raises OSError."""
        ...


def whole(content: Content) -> bytes:
    """All of it, for readers that hold a whole file."""
    return content.part(0, content.size)


@dataclass(frozen=True)
class HeldContent:
    """Bytes in memory."""

    data: bytes

    @property
    def size(self) -> int:
        """See `Content`."""
        return len(self.data)

    def part(self, start: int, end: int) -> bytes:
        """See `Content`."""
        return self.data[start:end]


@dataclass(frozen=True)
class FileContent:
    """The bytes of a file, none of which are kept."""

    path: Path

    @cached_property
    def size(self) -> int:
        """See `Content`. Raises OSError."""
        return self.path.stat().st_size

    def part(self, start: int, end: int) -> bytes:
        """See `Content`."""
        with self.path.open("rb") as file:
            file.seek(start)
            return file.read(end - start)


@dataclass(frozen=True)
class ContentPart:
    """A stretch of other bytes."""

    whole: Content
    start: int
    size: int

    def part(self, start: int, end: int) -> bytes:
        """See `Content`."""
        return self.whole.part(self.start + start, self.start + min(end, self.size))


class HashedContent:
    """Other bytes, hashed as they are read from their start on: one pass over a file for its hash and what it names."""

    def __init__(self, content: Content) -> None:
        self._content = content
        self._hash = hashlib.blake2b(digest_size=16)
        self._hashed = 0  # bytes from the start

    @property
    def size(self) -> int:
        """See `Content`."""
        return self._content.size

    def part(self, start: int, end: int) -> bytes:
        """See `Content`."""
        data = self._content.part(start, end)
        if start <= self._hashed < start + len(data):
            self._hash.update(memoryview(data)[self._hashed - start :])
            self._hashed = start + len(data)
        return data

    def digest(self) -> str:
        """The hash of all bytes, in hexadecimal; reads those that nobody has read yet. Raises OSError."""
        while self.part(self._hashed, self._hashed + _BLOCK):
            pass
        return self._hash.hexdigest()
