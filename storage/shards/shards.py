r"""Shards: immutable, content-addressed files of checksummed frames.

Layout of a shard (all numbers little-endian):

    magic      8 bytes   b"vLODshd\x01"
    frames     the frames' bytes, one after the other
    index      one FRAME record for each frame
    tail       32 bytes: length of the index in bytes (u8), its checksum (16 bytes), b"\x01dhsDOLv"

A shard's name is the first 32 hex digits of the SHA-256 of its whole content, so any changed byte is found by hashing
the file; a frame's own checksum finds a changed byte when only that frame is read. Reading a frame of a shard whose
index is known is one range request. Shards lie in the folder `shards/` of a store.

A shard appears under its name only once it is complete and on disk: it is written to a temporary name and then
renamed. A reader can never observe a part of one. Temporary files left behind by a killed writer start with `.tmp-`,
are never read, and may be deleted at any time when nothing writes.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple, TypeVar

import numpy as np

from storage.base.errors import CURE, CorruptStoreError
from storage.base.temporary import temporary_path
from storage.shards.cache import ByteCache

Value = TypeVar("Value")

MAGIC = b"vLODshd\x01"
TAIL_MAGIC = b"\x01dhsDOLv"
TAIL_BYTES = 32

#: Folder of a store that holds its shards.
FOLDER = "shards"

#: One frame of a shard as its index lists it.
FRAME = np.dtype(
    [
        ("kind", "<u4"),  # a Kind
        ("offset", "<u8"),  # of the first byte, from the shard's start, in bytes
        ("bytes", "<u8"),
        ("checksum", "<u8"),  # BLAKE2b, 8 bytes
    ]
)

#: What the first request for a shard's end asks for, in bytes: holds the index of all but the largest shards.
TAIL_READ = 1 << 15


class Kind(IntEnum):
    """What a frame holds."""

    TABLE = 1  # a structured array: storage.shards.columns
    NAMES = 2  # a list of strings: storage.shards.columns
    GEOMETRY = 3  # a pack of meshes: storage.meshes.pack
    SOURCE_FACES = 4  # the faces that the meshes of a pack come from: storage.meshes.pack
    CELLS = 5  # what can be seen from the cells of a group: storage.cells.codecs


@dataclass(frozen=True)
class ShardRecord:
    """A finished shard."""

    name: str  # see the top of this file
    bytes: int  # length of the file


def shard_path(name: str) -> str:
    """Path of a shard inside a store."""
    return f"{FOLDER}/{name}"


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Opens a new file for writing that appears at `path`, whole and on disk, when the block ends without an error.

    It replaces what was there. No reader can observe a partly written file; after an error nothing is left behind.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_path(path.parent)
    try:
        with temporary.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


class ShardWriter:
    """Writes one shard, frame by frame, holding none of them in memory. Use as a context manager.

    After the block ended without an error, `record` is the finished shard; after an error nothing is left on disk.
    """

    record: ShardRecord

    def __init__(self, root: Path) -> None:
        self._folder = root / FOLDER
        self._index: list[tuple[int, int, int, int]] = []

    def __enter__(self) -> ShardWriter:
        self._folder.mkdir(parents=True, exist_ok=True)
        self._temporary = temporary_path(self._folder)
        self._file = self._temporary.open("wb")
        self._digest = hashlib.sha256()
        self._bytes = 0
        self._write(MAGIC)
        return self

    def add(self, kind: Kind, payload: bytes) -> int:
        """Appends a frame; returns its index in the shard."""
        self._index.append((int(kind), self._bytes, len(payload), checksum(payload)))
        self._write(payload)
        return len(self._index) - 1

    def _write(self, data: bytes) -> None:
        self._file.write(data)
        self._digest.update(data)
        self._bytes += len(data)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                index = np.array(self._index, FRAME).tobytes()
                self._write(index)
                self._write(len(index).to_bytes(8, "little") + _index_checksum(index) + TAIL_MAGIC)
                self._file.flush()
                os.fsync(self._file.fileno())
                name = self._digest.hexdigest()[:32]
                self._temporary.replace(self._folder / name)
                _sync_folder(self._folder)
                self.record = ShardRecord(name, self._bytes)
        finally:
            self._file.close()
            with suppress(FileNotFoundError):
                self._temporary.unlink()


def write_shard(root: Path, frames: Iterable[tuple[Kind, bytes]]) -> ShardRecord:
    """Writes a shard of the given frames into the store at `root`; the same frames give the same name."""
    with ShardWriter(root) as shard:
        for kind, payload in frames:
            shard.add(kind, payload)
    return shard.record


class _End(NamedTuple):
    """What a shard's end says."""

    frames: np.ndarray  # FRAME
    whole: bytes | None  # the shard, if it is so small that it came with its end


class ShardReader:
    """Reads the frames of one shard. Safe to use from several threads.

    read: gives the bytes from start to end of the shard's file; cache: keeps what was read of the shard's end, for as
    long as it likes; store: path or URL of the store, for errors; doubt: is called at every damage that is found. Every
    method raises CorruptStoreError, which names the shard, when bytes are missing or changed.
    """

    def __init__(
        self,
        record: ShardRecord,
        read: Callable[[int, int], bytes],
        cache: ByteCache[Any],
        store: str,
        *,
        doubt: Callable[[], None] | None = None,
    ) -> None:
        self.record = record
        self._store = store
        self._read = read
        self._cache = cache
        self._doubt = doubt

    @property
    def index(self) -> np.ndarray:
        """The shard's FRAME records; read in one or two requests. A small shard comes whole with it."""
        return self._end.frames

    @property
    def _end(self) -> _End:
        end: _End = self._cache.get(("end", self.record.name), self._read_end)
        return end

    def _read_end(self) -> tuple[_End, int]:
        size = self.record.bytes
        start = max(0, size - TAIL_READ)
        end = self._range(start, size)
        if len(end) < TAIL_BYTES + len(MAGIC) or end[-8:] != TAIL_MAGIC:
            raise self.corrupt("its end is not a shard's")
        length = int.from_bytes(end[-32:-24], "little")
        if length % FRAME.itemsize or length > size - TAIL_BYTES - len(MAGIC):
            raise self.corrupt("its index has an impossible length")
        missing = length + TAIL_BYTES - len(end)
        if missing > 0:
            end = self._range(start - missing, start) + end
        index = end[len(end) - TAIL_BYTES - length : -TAIL_BYTES]
        if _index_checksum(index) != end[-24:-8]:
            raise self.corrupt("its index does not match its checksum")
        frames = np.frombuffer(index, FRAME)
        whole = end if start == 0 else None
        if whole is not None:
            self._check_name(whole, frames)
        return _End(frames, whole), len(index) + len(whole or b"")

    def _check_name(self, content: bytes, frames: np.ndarray) -> None:
        """Raises CorruptStoreError if the whole shard is another one: sound in itself, but not what the name says."""
        digest = hashlib.sha256(content).hexdigest()[:32]
        places = zip(*(frames[field].tolist() for field in ("offset", "bytes", "checksum")), strict=True)
        if digest != self.record.name and all(
            checksum(content[start : start + size]) == expected for start, size, expected in places
        ):
            raise self.corrupt(f"its content hashes to {digest}")

    def frame(self, number: int, kind: Kind) -> bytes:
        """The bytes of frame `number`, checked against its checksum and kind."""
        start, end = self.span(number, kind)
        if (whole := self._end.whole) is not None:
            with suppress(CorruptStoreError):  # what came with the end may have been spoilt on its way
                return self.checked(number, whole[start:end])
        return self.checked(number, self._range(start, end))

    @property
    def whole(self) -> bool:
        """Whether the shard came whole with its end, so that its frames need no more requests."""
        return self._end.whole is not None

    def span(self, number: int, kind: Kind) -> tuple[int, int]:
        """Where the bytes of frame `number` begin and end in the file; its kind is checked."""
        frames = self.index
        if not 0 <= number < len(frames):
            raise self.corrupt(f"it has {len(frames)} frames, so no frame {number}")
        entry = frames[number]
        if entry["kind"] != kind:
            raise self.corrupt(f"frame {number} is of kind {entry['kind']}, not {kind.value} ({kind.name.lower()})")
        return int(entry["offset"]), int(entry["offset"]) + int(entry["bytes"])

    def checked(self, number: int, payload: bytes) -> bytes:
        """The bytes of frame `number` as they are, once they match its checksum."""
        if checksum(payload) != int(self.index[number]["checksum"]):
            raise self.corrupt(f"frame {number} does not match its checksum")
        return payload

    def decoded(self, number: int, kind: Kind, decode: Callable[[bytes], Value], payload: bytes | None = None) -> Value:
        """What `decode` makes of frame `number`; it may raise CorruptStoreError without a file.

        payload: the frame, checked, where it was read already.
        """
        payload = self.frame(number, kind) if payload is None else payload
        try:
            return decode(payload)
        except CorruptStoreError as error:
            raise self.corrupt(f"frame {number}: {error}") from error

    def problems(self) -> Iterator[str]:
        """Reads the whole shard and says what is wrong with it, if anything: every byte is covered.

        Names the frames that are damaged; where none is, what is wrong with the shard as a whole.
        """
        try:
            content = self._range(0, self.record.bytes)
        except CorruptStoreError as error:
            yield str(error)
            return
        digest = hashlib.sha256(content).hexdigest()[:32]
        if digest == self.record.name:
            return
        whole = ShardReader(self.record, lambda start, end: content[start:end], ByteCache(0), self._store)
        try:
            frames = whole.index
        except CorruptStoreError as error:
            yield str(error)
            return
        named = False
        for number, kind in enumerate(frames["kind"].tolist()):
            try:
                whole.frame(number, kind)
            except CorruptStoreError as error:
                named = True
                yield str(error)
        if not named:
            yield str(self.corrupt(f"its content hashes to {digest}"))

    def _range(self, start: int, end: int) -> bytes:
        data = self._read(start, end)
        if len(data) != end - start:
            raise self.corrupt(f"it should be {self.record.bytes} bytes long but ends before byte {end}")
        return data

    def corrupt(self, what: str) -> CorruptStoreError:
        """The error that says what is wrong with this shard."""
        if self._doubt is not None:
            self._doubt()
        path = shard_path(self.record.name)
        return CorruptStoreError(f"{self._store}/{path} is damaged: {what}; {CURE}", path)


def checksum(payload: bytes) -> int:
    """BLAKE2b of a frame's bytes, as a number of 64 bits."""
    return int.from_bytes(hashlib.blake2b(payload, digest_size=8).digest(), "little")


def _index_checksum(index: bytes) -> bytes:
    return hashlib.blake2b(index, digest_size=16).digest()


def _sync_folder(folder: Path) -> None:
    """Makes a rename in `folder` durable, where the file system can."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
