"""A cache of decoded things within a budget of bytes, shared by threads."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Event, Lock
from typing import Generic, TypeVar

Value = TypeVar("Value")


class ByteCache(Generic[Value]):
    """Keeps the values used last, up to `budget` bytes. Safe to use from several threads.

    Two threads that ask for the same missing value load it once: the second waits for the first.
    """

    def __init__(self, budget: int) -> None:
        self.budget = budget
        self.bytes = 0
        self._values: OrderedDict[Hashable, tuple[Value, int]] = OrderedDict()
        self._loading: dict[Hashable, Event] = {}
        self._lock = Lock()

    def get(self, key: Hashable, load: Callable[[], tuple[Value, int]]) -> Value:
        """The value under `key`; `load` makes it and says its size in bytes where it is not there.

        An error in `load` reaches the thread that called it; threads that waited try for themselves.
        """
        while True:
            with self._lock:
                if key in self._values:
                    self._values.move_to_end(key)
                    return self._values[key][0]
                other = self._loading.get(key)
                if other is None:
                    mine = self._loading[key] = Event()
                    break
            other.wait()
        try:
            value, size = load()
            with self._lock:
                self._values[key] = (value, size)
                self.bytes += size
                while self.bytes > self.budget and len(self._values) > 1:
                    self.bytes -= self._values.popitem(last=False)[1][1]
            return value
        finally:
            with self._lock:
                del self._loading[key]
            mine.set()
