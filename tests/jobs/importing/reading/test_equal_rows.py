"""Equal rows, against brute force."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.importing.reading.equal_rows import first_equal


@given(st.lists(st.lists(st.integers(0, 2), min_size=2, max_size=2), max_size=30))
@settings(deadline=None)
def test_first_equal_finds_the_first(rows):
    array = np.array(rows, np.int64).reshape(-1, 2)
    assert first_equal(array).tolist() == [rows.index(row) for row in rows]


def test_first_equal_survives_equal_hashes():
    def mix(word):
        word = word * 0x9E3779B97F4A7C15 % 2**64
        return word ^ word >> 29

    a, b, c = 5, 6, 7
    d = mix(a) ^ mix(c) ^ b  # the rows (a, b) and (c, d) have the same hash
    rows = np.array([[a, b], [c, d], [a, b], [c, d], [1, 1]], np.uint64).view(np.int64)
    assert first_equal(rows).tolist() == [0, 1, 0, 1, 4]
