"""Functions on one store, item by item: in this process as long as that is quick, then on all cores.

The processes are ones of their own, begun afresh, not forked: compiled code and Embree have threads. Each opens the
store itself, so that what travels is an item and a small result. They leave interrupts to the process that began them,
and end with it, whatever ends it.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, NamedTuple, Self, TypeVar

from jobs.checking.turned import TurnedTriangles
from jobs.running.errors import WorkerLostError
from storage.base.compiling import Stopwatch, listening
from storage.shards.files import Files
from storage.shards.manifest import Manifest
from storage.store import Store

#: Seconds of work in this process from which on further ones are worth their start.
PATIENCE = 2.0

Item = TypeVar("Item")
Result = TypeVar("Result")


class Place:
    """The store that is checked, as one process sees it: opened when it is first asked for."""

    def __init__(self, url: str, manifest: Manifest, store: Store | None = None) -> None:
        """store: where it is open already."""
        self.url = url
        self.manifest = manifest
        self.files = Files(url) if store is None else store.files
        self._store = store

    @property
    def store(self) -> Store:
        """The store. Raises StoreError where its tables are damaged or cannot be read."""
        if self._store is None:
            self._store = Store(self.files, self.manifest)
        return self._store

    @cached_property
    def turned(self) -> TurnedTriangles:
        """Which of its triangles are turned away from a cell."""
        return TurnedTriangles(self.store)


class _Worker(NamedTuple):
    """A process that works, and the way to it."""

    process: BaseProcess
    connection: Connection


class Workers:
    """Works on one store, in this process or in several. Use as a context manager, which ends them all at once."""

    def __init__(self, place: Place, count: int | None = None) -> None:
        """count: processes that work; by default this one for as long as it is quick, then one for each core.

        A store in this process' memory is checked here alone.
        """
        self.place = place
        self._count = count or os.cpu_count() or 1
        self._patience = PATIENCE if count is None else 0.0
        if place.url.startswith("memory:"):
            self._count = 1
        self._workers: list[_Worker] = []

    def each(self, function: Callable[[Place, Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """What a function of a module gives for each item, in the items' order.

        Raises what the function raises; WorkerLostError where a process dies.
        """
        waiting = deque(items)
        while waiting and (self._count == 1 or self._patience > 0):
            yield self._here(function, waiting.popleft())
        if waiting:
            yield from self._shared(function, list(waiting))

    def _here(self, function: Callable[[Place, Item], Result], item: Item) -> Result:
        began, compiling = time.perf_counter(), Stopwatch()
        try:
            with listening(compiling):
                return function(self.place, item)
        except SystemError as error:
            # An interrupt that comes while a compiled kernel runs leaves it in this disguise.
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise KeyboardInterrupt from None
            raise
        finally:
            self._patience -= time.perf_counter() - began - compiling.seconds

    def _shared(self, function: Callable[[Place, Item], Result], items: list[Item]) -> Iterator[Result]:
        while len(self._workers) < min(self._count, len(items)):
            self._workers.append(_begun(self.place))
        idle = [worker.connection for worker in self._workers]
        running: dict[Connection, int] = {}
        found: dict[int, Result] = {}
        begun = 0
        for number in range(len(items)):
            while number not in found:
                while idle and begun < len(items):
                    connection = idle.pop()
                    _send(connection, (function, items[begun]))
                    running[connection] = begun
                    begun += 1
                ready = wait(list(running))
                for connection in [connection for connection in running if connection in ready]:
                    found[running.pop(connection)] = _received(connection)
                    idle.append(connection)
            yield found.pop(number)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for worker in self._workers:
            worker.process.terminate()
        for worker in self._workers:
            worker.process.join()
            worker.connection.close()
        self._workers.clear()


def _begun(place: Place) -> _Worker:
    """A new process that works on the store."""
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, place.url, place.manifest), daemon=True)
    with _uninterrupted():
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """An interrupt waits until the block is done; processes that are begun in it never hear of one.

    What is blocked here is blocked there from their first instruction on. Other threads of this process may take the
    signal all the same, and Python hands it to the main thread: so that one is told to wait, too. Half a start would
    leave a process that was never told what to do. The tracker of Python's multiprocessing comes first: where a process
    is the one that starts it, CPython 3.11 unblocks interrupts behind it, and that process would be born with them.
    """
    resource_tracker.ensure_running()
    caught: list[int] = []
    main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, lambda number, _: caught.append(number)) if main else None
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if main:
            signal.signal(signal.SIGINT, handler)
    if caught:
        raise KeyboardInterrupt


def _send(connection: Connection, task: tuple[Callable[..., Any], Any]) -> None:
    try:
        connection.send(task)
    except OSError:
        raise _lost() from None


def _received(connection: Connection) -> Any:
    try:
        result, error = connection.recv()
    except (EOFError, OSError):
        raise _lost() from None
    if error is not None:
        raise error
    return result


def _lost() -> WorkerLostError:
    return WorkerLostError("a process that checks the store died, for lack of memory most often: use fewer --workers")


def _work(connection: Connection, url: str, manifest: Manifest) -> None:
    """Works until nobody asks any more."""
    place = Place(url, manifest)
    while True:
        try:
            function, item = connection.recv()
        except (EOFError, OSError):
            return
        answer: tuple[Any, Exception | None]
        try:
            answer = (function(place, item), None)
        except Exception as error:  # raised again by who asked
            answer = (None, error)
        try:
            connection.send(answer)
        except OSError:
            return
