"""Listening to the compiling of kernels: a first run takes minutes, and would be a riddle without a word."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Compiling is told of in lines when it takes more than so many seconds.
LONG = 2.0

#: Told with True when compiling begins, with False when it ends.
Listener = Callable[[bool], None]

_listeners: list[Listener] = []


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Within the context, `listener` is told of what this process compiles."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def announce(active: bool) -> None:
    """Tells all listeners."""
    for listener in _listeners:
        listener(active)


class Stopwatch:
    """A listener that adds up the seconds of compiling."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._began = 0.0

    def __call__(self, active: bool) -> None:
        """See `Listener`."""
        if active:
            self._began = time.perf_counter()
        else:
            self.seconds += time.perf_counter() - self._began


class WhenLong(Stopwatch):
    """A listener that does something once, if compiling takes long."""

    def __init__(self, do: Callable[[], object]) -> None:
        super().__init__()
        self._do = do
        self._done = False

    def __call__(self, active: bool) -> None:
        """See `Listener`."""
        super().__call__(active)
        if active and self.seconds > LONG and not self._done:
            self._done = True
            self._do()


def notice(at_most: str) -> str:
    """A line for those who wait: what for, and for how long."""
    return f"compiling what runs often, once on a machine ({at_most} at most)"
