"""Amounts of memory as people write them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.base.amounts import format_size, parse_size
from storage.base.errors import ParameterError


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("2GiB", 2 << 30),
        ("1500MB", 1_500_000_000),
        ("1.5 gib", 3 << 29),
        ("800k", 800_000),
        ("4Ki", 4096),
        ("123", 123),
        ("123B", 123),
        (" 1T ", 10**12),
    ],
)
def test_sizes_are_read(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize(
    "text", ["", "lots", "0", "0GiB", "-1GiB", "2 G i B", "1e9", "GiB", "1PB", "0.1B", "nan", "²GiB"]
)
def test_what_is_no_size_is_refused(text):
    with pytest.raises(ParameterError, match="2GiB"):
        parse_size(text)


@given(st.integers(1, 1 << 50))
def test_a_size_that_is_named_suffices_and_is_not_far_off(size):
    assert size <= parse_size(format_size(size)) <= 1.1 * size + (1 << 20)


@pytest.mark.parametrize(
    ("size", "named"),
    [(1, "1B"), (1023, "1023B"), (1024, "1KiB"), (1025, "2KiB"), (1 << 20, "1MiB"), ((1 << 20) + 1, "2MiB")],
)
def test_small_sizes_are_not_blown_up(size, named):
    assert format_size(size) == named
