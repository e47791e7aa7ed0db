"""Who hears that kernels are compiled: at a first run that takes minutes, and would be a riddle without a word."""

from __future__ import annotations

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
