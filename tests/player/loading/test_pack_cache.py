"""The cache of packs: within its budget, never dropping what is drawn, the longest unused first."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from player.loading.pack_cache import PackCache


def _ids(*numbers: int) -> np.ndarray:
    return np.array(numbers, np.int64)


def test_the_longest_unused_goes_first() -> None:
    cache = PackCache(np.full(5, 10), budget=30)
    for number in (0, 1, 2):
        cache.lock(_ids(number))
        cache.add(number)
    cache.lock(_ids(0))  # 0 is used again
    cache.add(3)
    assert cache.evict().tolist() == [1]
    assert cache.bytes == 30


def test_what_is_drawn_stays_even_above_the_budget() -> None:
    cache = PackCache(np.full(4, 10), budget=15)
    cache.lock(_ids(0, 1, 2))
    for number in range(4):
        cache.add(number)
    assert cache.evict().tolist() == [3]
    assert cache.bytes == 30
    assert cache.room() == 0


def test_kept_packs_are_never_dropped() -> None:
    cache = PackCache(np.full(4, 10), budget=10)
    cache.keep(_ids(2))
    for number in range(4):
        cache.add(number)
    cache.lock(_ids())
    assert sorted(cache.evict().tolist()) == [0, 1, 3]


@given(st.lists(st.lists(st.integers(0, 19), max_size=6, unique=True), max_size=40), st.integers(0, 2**16))
def test_budget_and_locks_hold_whatever_happens(frames: list[list[int]], seed: int) -> None:
    sizes = np.random.default_rng(seed).integers(1, 30, 20)
    cache = PackCache(sizes, budget=80)
    resident: set[int] = set()
    for packs in frames:
        cache.lock(_ids(*packs))
        for number in packs:
            cache.add(number)
            resident.add(number)
        dropped = set(cache.evict().tolist())
        assert not dropped & set(packs)
        resident -= dropped
        assert set(np.flatnonzero(cache.resident).tolist()) == resident
        assert cache.bytes == sizes[list(resident)].sum()
        assert cache.bytes <= max(80, sizes[packs].sum())
