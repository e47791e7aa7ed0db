"""The loader: everything wished arrives once, the most urgent first; what is no longer wished is not begun."""

from __future__ import annotations

import threading
import time

import pytest

from player.loading.prefetch import Loader


def test_values_arrive() -> None:
    with Loader(lambda key: key * key, threads=3) as loader:
        loader.wish(range(20))
        found = loader.wait_for([3, 7])
        while len(found) < 20:
            found |= loader.collect()
        assert found == {key: key * key for key in range(20)}
        assert loader.pending == 0


def test_the_most_urgent_comes_first_and_wishes_can_change() -> None:
    begun: list[int] = []
    gate = threading.Event()

    def load(key: int) -> int:
        begun.append(key)
        gate.wait(10)
        return key

    with Loader(load, threads=1) as loader:
        loader.wish([1, 2, 3])
        while not begun:
            time.sleep(0.001)
        loader.wish([9, 2])
        gate.set()
        loader.wait_for([9, 2])
    assert begun == [1, 9, 2]


def test_an_error_reaches_who_asks() -> None:
    def load(key: int) -> int:
        raise ValueError(f"no {key}")

    with Loader(load, threads=1) as loader:
        loader.wish([5])
        with pytest.raises(ValueError, match="no 5"):
            loader.wait_for([5])


def test_waiting_for_what_was_not_wished_is_refused() -> None:
    with Loader(lambda key: key, threads=1) as loader, pytest.raises(ValueError, match="was not wished"):
        loader.wait_for([1])


def test_closing_does_not_wait_for_wishes() -> None:
    loader = Loader(lambda key: time.sleep(0.01) or key, threads=1)
    loader.wish(range(10_000))
    started = time.monotonic()
    loader.close()
    assert time.monotonic() - started < 5
