import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError, StoreFormatError
from storage.cells.codecs import DEFAULT, Codec, codec_named, codecs
from storage.cells.codecs.varint import decode_varints, encode_varints
from tests.storage.strategies import id_sets

EVERY = pytest.mark.parametrize("codec", codecs().values(), ids=lambda codec: codec.name)


@EVERY
@given(st.lists(id_sets(), max_size=8))
def test_lists_come_back(codec: Codec, lists: list[np.ndarray]) -> None:
    decoded = codec.decode(codec.encode(lists))
    assert len(decoded) == len(lists)
    for ids, expected in zip(decoded, lists, strict=True):
        assert ids.dtype == np.uint32
        assert np.array_equal(ids, expected)


@EVERY
def test_runs_cost_next_to_nothing(codec: Codec) -> None:
    assert len(codec.encode([np.arange(1000, 101_000, dtype=np.uint32)])) < 100


@EVERY
@given(st.binary(max_size=60))
def test_senseless_bytes_are_refused_and_never_crash(codec: Codec, data: bytes) -> None:
    for block in (data, data[:8] + zstandard.ZstdCompressor().compress(data[8:])):
        try:
            lists = codec.decode(block)
        except CorruptStoreError:
            continue
        assert all(ids.dtype == np.uint32 for ids in lists)


def test_codecs_by_name() -> None:
    assert codec_named(DEFAULT).name == DEFAULT
    with pytest.raises(StoreFormatError, match="uses the code 'unheard of'"):
        codec_named("unheard of")


@given(st.lists(st.integers(0, 2**32 - 1), max_size=50))
def test_varints_come_back(numbers: list[int]) -> None:
    array = np.array(numbers, np.uint32)
    assert np.array_equal(decode_varints(encode_varints(array), len(array)), array)


@pytest.mark.parametrize("data", [[128], [128, 128, 128, 128, 128, 0], [255, 255, 255, 255, 127], [0, 0]])
def test_varints_that_make_no_sense(data: list[int]) -> None:
    with pytest.raises(ValueError, match=r"number|left over"):
        decode_varints(np.array(data, np.uint8), 1)
