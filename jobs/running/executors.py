"""Running tasks: the protocol, the executor that runs them in this process, and one that hands them on in time.

An executor yields results as they come, in no promised order; whoever needs an order sorts by key. `followers_of`
may name new tasks for a result, which join the same run: this is how waves of cells grow. Finished tasks are not run
again.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterable
from typing import Protocol

from jobs.running.tasks import Task, TaskResult, find_finished, run_task
from jobs.running.workplace import Workplace
from storage.base.compiling import Stopwatch, listening

#: Seconds of work in this process before a `GrowingExecutor` grows.
PATIENCE = 10.0

#: The tasks that can be made once a result is there.
FollowersOf = Callable[[TaskResult], Iterable[Task]]


def no_followers(_result: TaskResult) -> Iterable[Task]:
    """Nothing follows from a result."""
    return ()


class Executor(Protocol):
    """Runs tasks somewhere."""

    @property
    def name(self) -> str:
        """What users call it."""
        ...

    @property
    def workers(self) -> int:
        """Tasks at once."""
        ...

    def run(
        self, tasks: Iterable[Task], place: Workplace, followers_of: FollowersOf = no_followers
    ) -> Generator[TaskResult]:
        """Runs tasks, and those that `followers_of` names for each result; yields the results in order of completion.

        `tasks` is read only as far ahead as the workers need. Errors of tasks are raised as they are; JobError is
        raised for lost workers and exhausted memory. Closing the iterator, or an interrupt, stops what is running;
        what is finished stays.
        """
        ...

    def close(self) -> None:
        """Gives back what the executor holds. It may be called twice."""
        ...


class Backlog:
    """Tasks that wait: those that followed from results first, then the rest."""

    def __init__(self, tasks: Iterable[Task], followers_of: FollowersOf) -> None:
        self._source = iter(tasks)
        self._followers: deque[Task] = deque()
        self._followers_of = followers_of

    def next(self) -> Task | None:
        """The next task, None if nothing waits now."""
        return self._followers.popleft() if self._followers else next(self._source, None)

    def add_followers(self, result: TaskResult) -> None:
        """Queues what follows from a result."""
        self._followers.extend(self._followers_of(result))


class SerialExecutor:
    """Runs tasks one by one in this process."""

    name = "serial"
    workers = 1

    def run(
        self, tasks: Iterable[Task], place: Workplace, followers_of: FollowersOf = no_followers
    ) -> Generator[TaskResult]:
        """See `Executor.run`."""
        backlog = Backlog(tasks, followers_of)
        while (task := backlog.next()) is not None:
            result = find_finished(task, place) or _run_here(task, place)
            backlog.add_followers(result)
            yield result

    def close(self) -> None:
        """Nothing to give back."""


class GrowingExecutor:
    """Runs tasks in this process at first, and on another executor once they have taken a while.

    For work that nothing tells the length of: starting workers takes seconds that short work never earns back. What
    compiling takes does not count: each worker would compile the same again.
    """

    def __init__(self, larger: Executor, patience: float = PATIENCE) -> None:
        """larger: where tasks go after `patience` seconds of work."""
        self._larger = larger
        self._patience = patience

    @property
    def name(self) -> str:
        """That of the executor which runs tasks now."""
        return self._larger.name if self._patience <= 0 else SerialExecutor.name

    @property
    def workers(self) -> int:
        """Tasks at once, now."""
        return self._larger.workers if self._patience <= 0 else SerialExecutor.workers

    def run(
        self, tasks: Iterable[Task], place: Workplace, followers_of: FollowersOf = no_followers
    ) -> Generator[TaskResult]:
        """See `Executor.run`."""
        backlog = Backlog(tasks, followers_of)
        while self._patience > 0 and (task := backlog.next()) is not None:
            result = find_finished(task, place)
            if result is None:
                began, compiling = time.perf_counter(), Stopwatch()
                with listening(compiling):
                    result = _run_here(task, place)
                self._patience -= time.perf_counter() - began - compiling.seconds
            backlog.add_followers(result)
            yield result
        yield from self._larger.run(iter(backlog.next, None), place, followers_of)

    def close(self) -> None:
        """See `Executor.close`."""
        self._larger.close()


def _run_here(task: Task, place: Workplace) -> TaskResult:
    try:
        return run_task(task, place)
    except SystemError as error:
        # An interrupt that comes while a compiled kernel runs leaves it in this disguise.
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise KeyboardInterrupt from None
        raise
