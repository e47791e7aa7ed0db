"""Free ranges: they never overlap what is taken, freed ones merge, and the smallest that fits is given."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from player.renderer.free_list import FreeList


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 40)), max_size=80))
def test_ranges_do_not_overlap_and_everything_comes_back(steps: list[tuple[bool, int]]) -> None:
    free = FreeList(200)
    taken: list[tuple[int, int]] = []
    for allocate, number in steps:
        if allocate:
            start = free.allocate(number)
            if start is not None:
                assert all(start + number <= a or a + n <= start for a, n in taken)
                assert 0 <= start <= 200 - number
                taken.append((start, number))
        elif taken:
            free.release(*taken.pop(number % len(taken)))
        assert free.free == 200 - sum(n for _, n in taken)
    for place in taken:
        free.release(*place)
    assert free.allocate(200) == 0  # all merged into one again


def test_growing_adds_room_at_the_end() -> None:
    free = FreeList(10)
    assert free.allocate(8) == 0
    free.grow(20)
    assert free.allocate(12) == 8
    assert free.allocate(1) is None


def test_the_smallest_range_that_fits_is_given() -> None:
    free = FreeList(100)
    for size in (30, 5, 10, 5, 50):
        free.allocate(size)
    free.release(0, 30)
    free.release(35, 10)
    assert free.allocate(8) == 35
    assert free.allocate(8) == 0
    assert free.allocate(2) == 43
