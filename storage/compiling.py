"""Who hears that kernels are compiled: at a first run that takes minutes, and would be a riddle without a word."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Told with True when compiling begins, with False when it ends.
Hearer = Callable[[bool], None]

_hearers: list[Hearer] = []


@contextmanager
def heard_by(hearer: Hearer) -> Iterator[None]:
    """Within the context, `hearer` is told of what this process compiles."""
    _hearers.append(hearer)
    try:
        yield
    finally:
        _hearers.remove(hearer)


def tell(active: bool) -> None:
    """Tells all hearers."""
    for hearer in _hearers:
        hearer(active)


class Stopwatch:
    """A hearer that adds up the seconds of compiling."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._began = 0.0

    def __call__(self, active: bool) -> None:
        """See `Hearer`."""
        if active:
            self._began = time.perf_counter()
        else:
            self.seconds += time.perf_counter() - self._began
