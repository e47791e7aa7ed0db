from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError, StoreFormatError
from storage.cells.codecs import CODECS, DEFAULT, Codec, codec_named
from storage.cells.codecs.changes import ListCodec
from storage.cells.codecs.delimiter import CODEC as DELIMITER
from storage.cells.codecs.gap_varint import CODEC as GAPS
from storage.cells.codecs.varint import decode_varints, encode_varints
from storage.cells.group import Group, Tree
from storage.model.tables import DRAWABLE, NODE
from storage.store import open_store
from tests.storage.cells.codecs.toy_codec import CODEC
from tests.storage.strategies import id_sets
from tests.storage.tiny_store import make_store, room_parts

TOY = "tests.storage.cells.codecs.toy_codec"
EVERY = pytest.mark.parametrize("codec", [*map(codec_named, CODECS), CODEC], ids=[*CODECS, "plain"])
LISTS = pytest.mark.parametrize("codec", [GAPS.lists, DELIMITER.lists], ids=["gap-varint-zstd", "delimiter"])

FLAT = 40


def flat_group(count: int) -> Group:
    """Cells in a row, each with the whole of a flat hierarchy as its cut."""
    nodes, drawables = np.zeros(FLAT, NODE), np.zeros(FLAT, DRAWABLE)
    nodes["end"], nodes["hi"] = np.arange(FLAT) + 1, 1
    drawables["node"] = np.arange(FLAT)
    at = np.arange(count)
    boxes = np.stack([np.stack([at + low, 0 * at, 0 * at], axis=1) for low in (0, 1)], axis=1).astype(float)
    centres = np.stack([2 * at + 1, 0 * at, 0 * at], axis=1)
    return Group(Tree(nodes, drawables), centres, boxes, tuple(np.arange(FLAT) for _ in range(count)))


SETS = st.lists(st.sets(st.integers(0, FLAT - 1)).map(lambda ids: np.array(sorted(ids), np.int64)), max_size=8)


@EVERY
@given(SETS)
def test_sets_come_back(codec: Codec, sets: list[np.ndarray]) -> None:
    group = flat_group(len(sets))
    decoded = codec.decode(codec.encode(sets, group), group)
    assert len(decoded) == len(sets)
    for ids, expected in zip(decoded, sets, strict=True):
        assert ids.dtype == np.int64
        assert np.array_equal(ids, expected)


@EVERY
@given(st.binary(max_size=60), st.integers(0, 5))
def test_senseless_bytes_give_a_clear_error_or_some_sets(codec: Codec, data: bytes, count: int) -> None:
    try:
        sets = codec.decode(data, flat_group(count))
    except CorruptStoreError:
        return
    assert len(sets) == count
    assert all((np.diff(ids) > 0).all() for ids in sets)


@LISTS
@given(st.lists(id_sets(), max_size=8))
def test_lists_come_back(codec: ListCodec, lists: list[np.ndarray]) -> None:
    decoded = codec.decode_lists(codec.encode_lists(lists))
    assert len(decoded) == len(lists)
    for ids, expected in zip(decoded, lists, strict=True):
        assert ids.dtype == np.uint32
        assert np.array_equal(ids, expected)


def test_runs_cost_next_to_nothing() -> None:
    assert len(GAPS.lists.encode_lists([np.arange(1000, 101_000, dtype=np.uint32)])) < 100


@LISTS
@given(st.binary(max_size=60))
def test_senseless_bytes_are_refused_and_never_crash(codec: ListCodec, data: bytes) -> None:
    for block in (data, data[:8] + zstandard.ZstdCompressor().compress(data[8:])):
        try:
            lists = codec.decode_lists(block)
        except CorruptStoreError:
            continue
        assert all(ids.dtype == np.uint32 for ids in lists)


def test_codecs_by_name() -> None:
    assert DEFAULT in CODECS
    with pytest.raises(StoreFormatError, match=f"uses the codec 'unheard of'; this vLOD knows {', '.join(CODECS)}"):
        codec_named("unheard of")


@given(st.lists(st.integers(0, 2**32 - 1), max_size=50))
def test_varints_come_back(numbers: list[int]) -> None:
    array = np.array(numbers, np.uint32)
    assert np.array_equal(decode_varints(encode_varints(array), len(array)), array)


@pytest.mark.parametrize("data", [[128], [128, 128, 128, 128, 128, 0], [255, 255, 255, 255, 127], [0, 0]])
def test_varints_that_make_no_sense(data: list[int]) -> None:
    with pytest.raises(ValueError, match=r"number|left over"):
        decode_varints(np.array(data, np.uint8), 1)


def _some(geometry: object, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
    return cut[np.random.default_rng(int(cell["key"])).random(len(cut)) < 0.6]


@pytest.fixture
def with_toy(monkeypatch: pytest.MonkeyPatch) -> None:
    """One more line in the list of codecs."""
    monkeypatch.setitem(CODECS, "plain", TOY)


@pytest.mark.parametrize("used", [["plain"], ["plain", DEFAULT]])
def test_a_new_codec_is_a_file_and_a_line(tmp_path: Path, with_toy: None, used: list[str]) -> None:
    """Shards of different codecs lie side by side in a store, and read the same."""
    store = make_store(tmp_path / "new", room_parts(), visible=_some, codecs=used)
    usual = make_store(tmp_path / "usual", room_parts(), visible=_some)
    assert store.manifest.cells is not None
    assert [shard.codec for shard in store.manifest.cells.shards] == (used * 4)[:4]
    for cell in range(len(usual.cells)):
        assert np.array_equal(store.vlod(cell), usual.vlod(cell))
        for other in usual.neighbours(cell):
            for mine, theirs in zip(store.delta(cell, other), usual.delta(cell, other), strict=True):
                assert np.array_equal(mine, theirs)
    assert not list(store.check())


def test_a_store_in_an_unknown_codec_is_refused_when_it_is_opened(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(CODECS, "plain", TOY)
        make_store(tmp_path, room_parts(), codecs=[DEFAULT, "plain"])
    with pytest.raises(StoreFormatError, match=f"uses the codec 'plain'; this vLOD knows {', '.join(CODECS)}"):
        open_store(tmp_path)


def test_a_block_that_cannot_be_decoded_is_named_with_its_file(tmp_path: Path, with_toy: None) -> None:
    store = make_store(tmp_path, room_parts(), codecs=["plain"])
    assert store.manifest.cells is not None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(CODEC), "decode", lambda *_: (_ for _ in ()).throw(CorruptStoreError("no sense in it")))
        with pytest.raises(CorruptStoreError, match=r"/shards/\w+ is damaged: frame \d+: no sense in it") as caught:
            open_store(tmp_path).vlod(0)
    assert caught.value.file == f"shards/{store.manifest.cells.shards[0].name}"
