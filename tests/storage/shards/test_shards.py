import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError
from storage.shards.cache import ByteCache
from storage.shards.shards import (
    FRAME,
    MAGIC,
    TAIL_READ,
    Kind,
    ShardReader,
    ShardRecord,
    ShardWriter,
    atomic_file,
    write_shard,
)

FRAMES = [(Kind.GEOMETRY, b"hello"), (Kind.TABLE, b""), (Kind.CELLS, bytes(range(256)) * 3)]


def _reader(content: bytes, record: ShardRecord) -> ShardReader:
    return ShardReader(record, lambda start, end: content[start:end], ByteCache(1 << 20), "here")


def _read(root: Path, record: ShardRecord) -> ShardReader:
    return _reader((root / "shards" / record.name).read_bytes(), record)


def test_frames_come_back(tmp_path: Path) -> None:
    record = write_shard(tmp_path, FRAMES)
    reader = _read(tmp_path, record)
    assert [reader.frame(i, kind) for i, (kind, _) in enumerate(FRAMES)] == [payload for _, payload in FRAMES]
    assert (tmp_path / "shards" / record.name).stat().st_size == record.bytes
    assert not list(reader.problems())


def test_the_same_frames_have_the_same_name(tmp_path: Path) -> None:
    assert write_shard(tmp_path / "a", FRAMES) == write_shard(tmp_path / "b", FRAMES)
    assert write_shard(tmp_path / "a", FRAMES).name != write_shard(tmp_path / "a", FRAMES[:2]).name


def test_writing_again_heals_a_damaged_shard(tmp_path: Path) -> None:
    record = write_shard(tmp_path, FRAMES)
    (tmp_path / "shards" / record.name).write_bytes(b"broken")
    write_shard(tmp_path, FRAMES)
    assert not list(_read(tmp_path, record).problems())


def test_one_frame_is_one_request_after_the_index(tmp_path: Path) -> None:
    record = write_shard(tmp_path, [(Kind.GEOMETRY, os.urandom(50_000)) for _ in range(4)])
    content = (tmp_path / "shards" / record.name).read_bytes()
    asked: list[int] = []

    def read(start: int, end: int) -> bytes:
        asked.append(end - start)
        return content[start:end]

    reader = ShardReader(record, read, ByteCache(1 << 20), "here")
    reader.frame(2, Kind.GEOMETRY)
    reader.frame(1, Kind.GEOMETRY)
    assert asked == [TAIL_READ, 50_000, 50_000]


def test_a_small_shard_is_one_request(tmp_path: Path) -> None:
    record = write_shard(tmp_path, FRAMES)
    content = (tmp_path / "shards" / record.name).read_bytes()
    asked: list[int] = []

    def read(start: int, end: int) -> bytes:
        asked.append(end - start)
        return content[start:end]

    reader = ShardReader(record, read, ByteCache(1 << 20), "here")
    assert [reader.frame(i, kind) for i, (kind, _) in enumerate(FRAMES)] == [payload for _, payload in FRAMES]
    assert asked == [record.bytes]


def test_an_index_larger_than_the_first_request(tmp_path: Path) -> None:
    count = 2 * TAIL_READ // FRAME.itemsize
    record = write_shard(tmp_path, ((Kind.TABLE, b"%d" % i) for i in range(count)))
    reader = _read(tmp_path, record)
    assert reader.frame(count - 1, Kind.TABLE) == b"%d" % (count - 1)
    assert reader.frame(0, Kind.TABLE) == b"0"


def test_no_frames(tmp_path: Path) -> None:
    assert len(_read(tmp_path, write_shard(tmp_path, [])).index) == 0


@settings(max_examples=200)
@given(st.data())
def test_every_changed_byte_is_found_on_checking_and_no_wrong_frame_is_read(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    root = tmp_path_factory.mktemp("store")
    record = write_shard(root, FRAMES)
    content = bytearray((root / "shards" / record.name).read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    reader = _reader(bytes(content), record)
    problems = list(reader.problems())
    assert problems
    assert all(record.name in problem for problem in problems)
    for number, (kind, payload) in enumerate(FRAMES):
        try:
            found = reader.frame(number, kind)
        except CorruptStoreError:
            continue
        assert found == payload


def test_a_changed_byte_is_told_once_by_its_frame_where_it_has_one(tmp_path: Path) -> None:
    record = write_shard(tmp_path, FRAMES)
    content = (tmp_path / "shards" / record.name).read_bytes()
    for at, what in ((len(MAGIC), "frame 0 does not match"), (0, "its content hashes to")):
        changed = bytearray(content)
        changed[at] ^= 1
        (problem,) = _reader(bytes(changed), record).problems()
        assert problem.startswith(f"here/shards/{record.name} is damaged: {what}")


def test_another_shard_of_the_same_length_is_not_read(tmp_path: Path) -> None:
    """All its checksums are right: only its name is not."""
    mine, other = (write_shard(tmp_path, [(Kind.CELLS, text)]) for text in (b"what is asked for", b"what came at last"))
    assert mine.bytes == other.bytes
    content = (tmp_path / "shards" / other.name).read_bytes()
    assert _reader(content, other).frame(0, Kind.CELLS) == b"what came at last"
    with pytest.raises(CorruptStoreError, match=f"{mine.name} is damaged: its content hashes to {other.name}"):
        _reader(content, mine).frame(0, Kind.CELLS)
    assert len(list(_reader(content, mine).problems())) == 1


@given(st.integers(0, 900))
def test_a_shard_cut_short_is_found(tmp_path_factory: pytest.TempPathFactory, length: int) -> None:
    root = tmp_path_factory.mktemp("store")
    record = write_shard(root, FRAMES)
    content = (root / "shards" / record.name).read_bytes()
    if length < len(content):
        assert list(_reader(content[:length], record).problems())
        with pytest.raises(CorruptStoreError, match=record.name):
            _ = _reader(content[:length], record).index


def test_wrong_kinds_and_numbers(tmp_path: Path) -> None:
    reader = _read(tmp_path, write_shard(tmp_path, FRAMES))
    with pytest.raises(CorruptStoreError, match="of kind 3, not 1"):
        reader.frame(0, Kind.TABLE)
    with pytest.raises(CorruptStoreError, match="no frame 3"):
        reader.frame(3, Kind.TABLE)


def test_a_file_that_is_no_shard() -> None:
    content = os.urandom(1000)
    with pytest.raises(CorruptStoreError, match="end is not a shard's"):
        _ = _reader(content, ShardRecord("name", len(content))).index
    lengthy = content + (10**9).to_bytes(8, "little") + bytes(16) + b"\x01dhsDOLv"
    with pytest.raises(CorruptStoreError, match="impossible length"):
        _ = _reader(lengthy, ShardRecord("name", len(lengthy))).index


def test_an_error_while_writing_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(TypeError), ShardWriter(tmp_path) as shard:
        shard.add(Kind.TABLE, "no bytes")  # type: ignore[arg-type]
    with pytest.raises(TypeError), atomic_file(tmp_path / "file") as file:
        file.write("no bytes")  # type: ignore[arg-type]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_an_atomic_file_replaces_the_former(tmp_path: Path) -> None:
    for content in (b"one", b"two"):
        with atomic_file(tmp_path / "file") as file:
            file.write(content)
        assert (tmp_path / "file").read_bytes() == content
    assert np.array_equal([path.name for path in tmp_path.iterdir()], ["file"])
