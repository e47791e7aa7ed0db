"""Threads that load things in the order in which they will be needed, and that no failure stops.

The player keeps one wish list, most urgent first, and replaces it whenever the view changes: what is no longer wished
is not begun any more, what has begun is finished and handed over. What cannot be read stays on the list with its error,
and is begun again after a pause that doubles each time; all else goes on meanwhile. (Whether a single request is
repeated at once is decided where it is made: storage.shards.files.)
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from threading import Condition, Thread
from typing import Generic, NamedTuple, TypeVar

from storage.base.errors import CorruptStoreError, StoreError, StoreUnreachableError

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")

#: The pause before what failed is begun again, in seconds: after the first failure, and at most.
FIRST_PAUSE = 1.0
LONGEST_PAUSE = 30.0

#: How many keys are fetched together at most.
TOGETHER = 16

#: So many keys that are out of reach, one after the other, mean that the place is, and nothing is waited for any more.
OUT_OF_REACH = 4

#: How long closing waits for reads that have begun, in seconds; what hangs longer ends by itself.
CLOSING_TIME = 2.0


class _Failure(NamedTuple):
    """The last attempt at a key."""

    error: StoreError
    pause: float  # before the next attempt, in seconds
    again: float  # when it may begin: time.monotonic


class Loader(Generic[Key, Value]):
    """Loads values by key on threads, in the order of a wish list that may change at any time.

    Use it as a context manager, or call `close`. A StoreError in `load` is kept as the key's failure until the key
    arrives. Any other error is a fault of the program: the next `collect` or `wait_for` raises it.
    """

    def __init__(
        self, load: Callable[[Key], Value], threads: int, *, fetch: Callable[[Sequence[Key]], None] | None = None
    ) -> None:
        """fetch: brings near what several keys need, at most TOGETHER, before each is loaded; raises no StoreError."""
        self._load = load
        self._fetch = fetch
        self._wishes: dict[Key, None] = {}  # in order; what is being loaded stays until it has arrived
        self._loading: set[Key] = set()
        self._done: dict[Key, Value] = {}
        self._failures: dict[Key, _Failure] = {}
        self._out_of_reach: dict[Key, StoreError] = {}  # since the last arrival
        self._fault: Exception | None = None
        self._closed = False
        self._changed = Condition()
        self._threads = [Thread(target=self._work, name=f"vlod-load-{n}", daemon=True) for n in range(threads)]
        for thread in self._threads:
            thread.start()

    def wish(self, keys: Iterable[Key]) -> None:
        """Replaces the wish list: `keys`, the most urgent first."""
        with self._changed:
            self._wishes = {key: None for key in keys if key not in self._done}
            self._changed.notify_all()

    def collect(self) -> dict[Key, Value]:
        """What has been loaded since the last call; never waits."""
        if not self._done and self._fault is None:  # most often: not worth a lock, the next call looks again
            return {}
        with self._changed:
            return self._take()

    def wait_for(self, keys: Iterable[Key], seconds: float | None = None) -> dict[Key, Value]:
        """Waits until all `keys`, which must have been wished, are loaded; returns everything loaded so far.

        seconds: waits no longer than so. Does not wait for what has failed, nor for anything while the place is out of
        reach: `failures` says what is missing and why.
        """
        wanted = list(keys)
        with self._changed:
            missing = [k for k in wanted if k not in self._wishes and k not in self._loading and k not in self._done]
            if missing:
                raise ValueError(f"{missing[0]!r} was not wished for")
            self._changed.wait_for(
                lambda: (
                    self._fault is not None
                    or self._outage is not None
                    or all(key in self._done or key in self._failures for key in wanted)
                ),
                seconds,
            )
            return self._take()

    def failures(self, keys: Iterable[Key]) -> dict[Key, StoreError]:
        """Why those of `keys`, which have not arrived, cannot be had for now: their own error, or the place's."""
        if not self._failures:
            return {}
        with self._changed:
            found = {key: self._failures[key].error if key in self._failures else self._outage for key in keys}
            return {key: error for key, error in found.items() if error is not None}

    @property
    def damage(self) -> CorruptStoreError | None:
        """Some damage that was met and is there still; None if there is none."""
        if not self._failures:
            return None
        with self._changed:
            errors = (failure.error for failure in self._failures.values())
            return next((error for error in errors if isinstance(error, CorruptStoreError)), None)

    @property
    def pending(self) -> int:
        """How many values are wished or being loaded."""
        with self._changed:
            return len(self._wishes.keys() | self._loading)

    def close(self) -> None:
        """Stops the threads once they have finished what they are loading, but for reads that hang."""
        with self._changed:
            self._closed = True
            self._wishes.clear()
            self._changed.notify_all()
        deadline = time.monotonic() + CLOSING_TIME
        for thread in self._threads:
            thread.join(max(0.0, deadline - time.monotonic()))

    def __enter__(self) -> Loader[Key, Value]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _outage(self) -> StoreError | None:
        """Why nothing can be had, where it seems so."""
        return next(reversed(self._out_of_reach.values())) if len(self._out_of_reach) >= OUT_OF_REACH else None

    def _take(self) -> dict[Key, Value]:
        if self._fault is not None:
            fault, self._fault = self._fault, None
            raise fault
        done, self._done = self._done, {}
        return done

    def _work(self) -> None:
        while keys := self._next():
            if self._fetch is not None and len(keys) > 1:
                try:
                    self._fetch(keys)
                except Exception as fault:
                    with self._changed:
                        self._fault = fault
                        self._changed.notify_all()
            for key in keys:
                self._attempt(key)

    def _next(self) -> list[Key]:
        """The most urgent wish that may be begun, which is waited for; none once the loader is closed.

        With what follows it, where things are fetched together and nothing is out of reach.

        While nothing arrives, what was not tried yet comes before what has failed: else that would hold up all others.
        """
        with self._changed:
            while not self._closed:
                now, soonest = time.monotonic(), math.inf
                again: list[Key] = []
                for key in self._wishes:
                    if key in self._loading:
                        continue
                    failure = self._failures.get(key)
                    if failure is None:
                        return self._begun(*self._together(key))
                    soonest = min(soonest, failure.again)
                    if failure.again <= now and not again:
                        again = [key]
                        if not self._out_of_reach:
                            break
                if again:
                    return self._begun(*again)
                self._changed.wait(None if soonest == math.inf else soonest - now)
            return []

    def _together(self, first: Key) -> list[Key]:
        """`first` and the wishes after it that were not tried yet."""
        if self._fetch is None or self._out_of_reach:
            return [first]
        fresh = (key for key in self._wishes if key not in self._loading and key not in self._failures)
        return list(islice(fresh, TOGETHER))

    def _begun(self, *keys: Key) -> list[Key]:
        self._loading.update(keys)
        return list(keys)

    def _attempt(self, key: Key) -> None:
        try:
            value = self._load(key)
        except StoreError as error:
            with self._ended(key):
                former = self._failures.get(key)
                pause = FIRST_PAUSE if former is None else min(2 * former.pause, LONGEST_PAUSE)
                self._failures[key] = _Failure(error.with_traceback(None), pause, time.monotonic() + pause)
                if isinstance(error, StoreUnreachableError):
                    self._out_of_reach[key] = error
        except Exception as fault:
            with self._ended(key):
                self._wishes.pop(key, None)
                self._fault = fault
        else:
            with self._ended(key):
                self._wishes.pop(key, None)
                self._failures.pop(key, None)
                self._done[key] = value
                self._out_of_reach.clear()

    @contextmanager
    def _ended(self, key: Key) -> Iterator[None]:
        """Everybody hears of what the block does with a key that is not being loaded any more."""
        with self._changed:
            self._loading.discard(key)
            yield
            self._changed.notify_all()
