"""The delimiter code against vectors worked out by hand, and by round trips."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError
from storage.cells.codecs.delimiter import CODEC
from storage.cells.codecs.offsets_and_runs import (
    LARGEST,
    LONGEST,
    decode_numbers,
    encode_numbers,
    ids_of,
    offsets_and_runs,
)

#: Numbers, and their code by the three rules of appendix A.1: a space stands where a number or a delimiter ends.
BY_HAND = [
    ([1], "11"),  # 1 is 01 without its zero: rule 3
    ([2], "10"),
    ([3], "110"),  # rule 2
    ([4], "100"),
    ([5], "1011"),  # rule 3
    ([6], "1100"),  # 11 becomes 110, then 0
    ([7], "11011"),  # 11 becomes 110, then 1; that ends in 01
    ([13], "11001 1".replace(" ", "")),  # 1101: 110 0 1, which ends in 01
    ([15], "110110"),  # two pairs
    ([2, 2], "10 11 10"),
    ([5, 2], "1011 11 10"),  # 11111: the end in 1 is the right guess
    ([2, 1, 2], "10 11 11 11 10"),  # 1111111: it is the wrong one
    ([2, 1, 3], "10 11 11 11 110"),
    ([1, 1, 1], "11 11 11 11 11"),
    ([5, 1], "1011 11 11"),
    ([4, 3, 5], "100 11 110 11 1011"),
    ([1, 7], "11 11 11011"),
]


@pytest.mark.parametrize(("numbers", "code"), BY_HAND)
def test_the_code_is_as_worked_out_by_hand(numbers: list[int], code: str) -> None:
    bits = code.replace(" ", "")
    data = encode_numbers(np.array(numbers, np.int64))
    assert int.from_bytes(data[:4], "little") == len(bits)
    assert "".join(f"{byte:08b}" for byte in data[4:]).rstrip("0") == bits.rstrip("0")
    assert decode_numbers(data).tolist() == numbers


@given(st.lists(st.one_of(st.integers(1, 9), st.integers(1, LARGEST))))
def test_numbers_come_back(numbers: list[int]) -> None:
    assert decode_numbers(encode_numbers(np.array(numbers, np.int64))).tolist() == numbers


@given(st.lists(st.booleans(), max_size=40))
def test_bits_are_refused_or_are_the_code_of_what_they_give(bits: list[bool]) -> None:
    data = len(bits).to_bytes(4, "little") + np.packbits(np.array(bits, np.uint8)).tobytes()
    try:
        numbers = decode_numbers(data)
    except CorruptStoreError:
        return
    assert (numbers >= 1).all()
    assert encode_numbers(numbers) == data


def test_numbers_that_have_no_code_are_refused() -> None:
    for number in (0, -1, LARGEST + 1):
        with pytest.raises(ValueError, match="holds numbers from 1"):
            encode_numbers(np.array([number], np.int64))
    with pytest.raises(CorruptStoreError, match="do not lie in"):
        decode_numbers(b"\1\0\0\0")


@given(st.sets(st.integers(0, 300)))
def test_ids_come_back_from_offsets_and_runs(ids: set[int]) -> None:
    numbers = offsets_and_runs(np.array(sorted(ids), np.int64))
    assert (numbers >= 1).all()
    assert ids_of(numbers, 301).tolist() == sorted(ids)


def test_runs_beyond_the_last_id_are_refused() -> None:
    with pytest.raises(CorruptStoreError, match="beyond the last id"):
        ids_of(np.array([1, 10**12]), 100)
    with pytest.raises(CorruptStoreError, match="more than"):
        ids_of(np.array([1, LONGEST + 1]), 1 << 32)
    with pytest.raises(CorruptStoreError, match="before its last one"):
        CODEC.lists.decode_lists(encode_numbers(np.array([2, 1])))
    with pytest.raises(ValueError, match="at most"):
        CODEC.lists.encode_lists([np.arange(LONGEST + 1, dtype=np.uint32)])
    with pytest.raises(CorruptStoreError, match="before the length"):
        ids_of(np.array([1]), 100)
    assert offsets_and_runs(np.array([0, 1, 2, 7, 9])).tolist() == [1, 3, 4, 1, 1, 1]
