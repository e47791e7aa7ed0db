"""Threads that load things in the order in which they will be needed.

The player keeps one wish list, most urgent first, and replaces it whenever the view changes: what is no longer wished
is not begun any more, what has begun is finished and handed over.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from threading import Condition, Thread
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class Loader(Generic[Key, Value]):
    """Loads values by key on threads, in the order of a wish list that may change at any time.

    Use it as a context manager, or call `close`. An error in `load` is raised by the next `collect` or `wait_for`.
    """

    def __init__(self, load: Callable[[Key], Value], threads: int) -> None:
        self._load = load
        self._wishes: OrderedDict[Key, None] = OrderedDict()
        self._loading: set[Key] = set()
        self._done: dict[Key, Value] = {}
        self._error: Exception | None = None
        self._closed = False
        self._changed = Condition()
        self._threads = [Thread(target=self._work, name=f"vlod-load-{n}", daemon=True) for n in range(threads)]
        for thread in self._threads:
            thread.start()

    def wish(self, keys: Iterable[Key]) -> None:
        """Replaces the wish list: `keys`, the most urgent first."""
        with self._changed:
            self._wishes = OrderedDict(
                (key, None) for key in keys if key not in self._loading and key not in self._done
            )
            self._changed.notify_all()

    def collect(self) -> dict[Key, Value]:
        """What has been loaded since the last call; never waits."""
        with self._changed:
            return self._take()

    def wait_for(self, keys: Iterable[Key]) -> dict[Key, Value]:
        """Waits until all `keys`, which must have been wished, are loaded; returns everything loaded so far."""
        wanted = list(keys)
        with self._changed:
            missing = [k for k in wanted if k not in self._wishes and k not in self._loading and k not in self._done]
            if missing:
                raise ValueError(f"{missing[0]!r} was not wished for")
            self._changed.wait_for(lambda: self._error is not None or all(key in self._done for key in wanted))
            return self._take()

    @property
    def pending(self) -> int:
        """How many values are wished or being loaded."""
        with self._changed:
            return len(self._wishes) + len(self._loading)

    def close(self) -> None:
        """Stops the threads once they have finished what they are loading."""
        with self._changed:
            self._closed = True
            self._wishes.clear()
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()

    def __enter__(self) -> Loader[Key, Value]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take(self) -> dict[Key, Value]:
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        done, self._done = self._done, {}
        return done

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or bool(self._wishes))
                if self._closed:
                    return
                key, _ = self._wishes.popitem(last=False)
                self._loading.add(key)
            try:
                value = self._load(key)
            except Exception as error:
                with self._changed:
                    self._loading.discard(key)
                    self._error = error
                    self._changed.notify_all()
                continue
            with self._changed:
                self._loading.discard(key)
                self._done[key] = value
                self._changed.notify_all()
