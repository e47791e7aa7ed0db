"""The loader: everything wished arrives once, the most urgent first; what is no longer wished is not begun."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from itertools import pairwise

import pytest

from player.loading import prefetch
from player.loading.prefetch import Loader
from storage.base.errors import CorruptStoreError, StoreUnreachableError


def _soon(holds: Callable[[], bool]) -> None:
    """Waits until something holds that must come to hold."""
    deadline = time.monotonic() + 30
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def test_values_arrive() -> None:
    with Loader(lambda key: key * key, threads=3) as loader:
        loader.wish(range(20))
        found = loader.wait_for([3, 7])
        while len(found) < 20:
            found |= loader.collect()
        assert found == {key: key * key for key in range(20)}
        assert loader.pending == 0


def test_what_is_wished_together_is_fetched_together() -> None:
    fetched: list[list[int]] = []
    with Loader(lambda key: -key, threads=1, fetch=lambda keys: fetched.append(list(keys))) as loader:
        count = 2 * prefetch.TOGETHER + 1
        loader.wish(range(count))
        assert loader.wait_for(range(count)) == {key: -key for key in range(count)}
    assert fetched == [list(range(16)), list(range(16, 32))]


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


def test_a_fault_of_the_program_reaches_who_asks() -> None:
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


def test_what_fails_keeps_its_own_error_and_comes_later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prefetch, "FIRST_PAUSE", 0.02)
    sound = threading.Event()
    attempts: list[int] = []

    def load(key: int) -> int:
        attempts.append(key)
        if key % 2 and not sound.is_set():
            raise CorruptStoreError(f"no {key}")
        return key

    with Loader(load, threads=2) as loader:
        loader.wish(range(6))
        assert loader.wait_for(range(6)).keys() >= {0}
        _soon(lambda: len(loader.failures(range(6))) == 3)
        assert {key: str(error) for key, error in loader.failures([1, 2, 5]).items()} == {1: "no 1", 5: "no 5"}
        assert str(loader.damage).startswith("no ")
        _soon(lambda: attempts.count(1) > 2)  # without being wished again
        sound.set()
        found: dict[int, int] = {}
        _soon(lambda: bool(found.update(loader.collect())) or found.keys() >= {1, 3, 5})
        assert loader.failures(range(6)) == {}
        assert loader.damage is None
        assert loader.pending == 0


def test_pauses_double_and_what_is_not_wished_any_more_is_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prefetch, "FIRST_PAUSE", 0.05)
    monkeypatch.setattr(prefetch, "LONGEST_PAUSE", 0.2)
    begun: list[float] = []

    def load(key: int) -> int:
        begun.append(time.monotonic())
        raise StoreUnreachableError("away")

    with Loader(load, threads=3) as loader:
        loader.wish([1])
        _soon(lambda: len(begun) == 5)
        loader.wish([])
        time.sleep(0.3)
        assert len(begun) == 5
        pauses = [later - earlier for earlier, later in pairwise(begun)]
        assert all(pause >= least for pause, least in zip(pauses, (0.05, 0.1, 0.2, 0.2), strict=True))


def test_nothing_is_waited_for_while_all_is_out_of_reach() -> None:
    def load(key: int) -> int:
        raise StoreUnreachableError(f"{key} is away")

    with Loader(load, threads=1) as loader:
        loader.wish(range(1000))
        began = time.monotonic()
        assert loader.wait_for(range(1000)) == {}
        assert time.monotonic() - began < 5
        failures = loader.failures(range(1000))
        assert len(failures) == 1000
        assert str(failures[0]) == "0 is away"  # its own
        assert "is away" in str(failures[999])  # the place's


def test_what_fails_slowly_does_not_hold_up_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prefetch, "FIRST_PAUSE", 0.001)
    monkeypatch.setattr(prefetch, "LONGEST_PAUSE", 0.001)

    def load(key: int) -> int:
        if key < 3:
            time.sleep(0.02)
            raise StoreUnreachableError("away")
        return key

    with Loader(load, threads=1) as loader:
        loader.wish(range(8))
        assert loader.wait_for(range(8)).keys() == {3, 4, 5, 6, 7}


def test_closing_does_not_wait_for_reads_that_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prefetch, "CLOSING_TIME", 0.05)
    gate = threading.Event()
    begun = threading.Event()
    loader = Loader(lambda key: begun.set() or gate.wait(30), threads=2)
    loader.wish([1])
    begun.wait(30)
    started = time.monotonic()
    loader.close()
    assert time.monotonic() - started < 5
    gate.set()
