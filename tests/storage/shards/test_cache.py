import threading
import time

import pytest

from storage.shards.cache import ByteCache


def test_the_values_used_last_are_kept() -> None:
    cache: ByteCache[str] = ByteCache(10)
    loaded: list[str] = []

    def get(key: str, size: int = 4) -> str:
        def load() -> tuple[str, int]:
            loaded.append(key)
            return key.upper(), size

        return cache.get(key, load)

    assert [get("a"), get("b"), get("a"), get("c"), get("a"), get("b")] == ["A", "B", "A", "C", "A", "B"]
    assert loaded == ["a", "b", "c", "b"]
    assert cache.bytes <= cache.budget
    assert get("huge", 100) == "HUGE"
    assert get("huge", 100) == "HUGE"
    assert loaded[-2:] == ["b", "huge"]


def test_threads_load_a_value_once() -> None:
    cache: ByteCache[int] = ByteCache(100)
    loads = []

    def load() -> tuple[int, int]:
        loads.append(1)
        time.sleep(0.05)
        return 7, 1

    found: list[int] = []
    threads = [threading.Thread(target=lambda: found.append(cache.get("key", load))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [7] * 8
    assert len(loads) == 1


def test_after_an_error_the_next_one_tries_again() -> None:
    cache: ByteCache[int] = ByteCache(100)

    def fail() -> tuple[int, int]:
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        cache.get("key", fail)
    assert cache.get("key", lambda: (5, 1)) == 5
