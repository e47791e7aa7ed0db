import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError, StoreFormatError
from storage.model import tables
from storage.shards.columns import pack_names, pack_table, unpack_names, unpack_table

DTYPES = [dtype for name, dtype in vars(tables).items() if name.isupper() and isinstance(dtype, np.dtype)]


@given(st.sampled_from(DTYPES), st.integers(0, 20), st.integers(0, 2**32 - 1))
def test_tables_come_back(dtype: np.dtype, rows: int, seed: int) -> None:
    content = np.random.default_rng(seed).integers(0, 256, rows * dtype.itemsize, dtype=np.uint8)
    table = content.view(dtype)
    found = unpack_table(pack_table(table), dtype)
    assert found.dtype == dtype
    assert found.tobytes() == table.tobytes()
    assert not found.flags.writeable


@given(st.lists(st.text()))
def test_names_come_back(names: list[str]) -> None:
    plain = [name.encode("utf-8", "replace").decode() for name in names]
    assert unpack_names(pack_names(plain)) == tuple(plain)


def test_dtypes_are_the_same_on_every_machine() -> None:
    for dtype in DTYPES:
        assert not dtype.isalignedstruct
        assert all(dtype[name].base.str[0] in "<|" for name in dtype.names)


def test_other_fields_are_refused() -> None:
    with pytest.raises(StoreFormatError, match="a table has the fields"):
        unpack_table(pack_table(np.zeros(2, tables.PART)), tables.NODE)


@pytest.mark.parametrize("data", [b"", b"\0\0\0\0", b"\x02\0\0\0{}rest", b"\xff\xff\xff\xff", b"\x04\0\0\0nullxx"])
def test_senseless_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(CorruptStoreError, match="cannot be decoded"):
        unpack_table(data, tables.PART)
    with pytest.raises(CorruptStoreError, match="cannot be decoded"):
        unpack_names(data)


def test_a_table_of_another_length_is_refused() -> None:
    packed = pack_table(np.zeros(3, tables.PART))
    head = 4 + int.from_bytes(packed[:4], "little")
    short = packed[:head] + zstandard.ZstdCompressor().compress(bytes(5))
    with pytest.raises(CorruptStoreError, match="has 5 bytes, not 3 rows of 8"):
        unpack_table(short, tables.PART)
    with pytest.raises(CorruptStoreError, match="cannot be decoded"):
        unpack_names(zstandard.ZstdCompressor().compress(b"7"))
