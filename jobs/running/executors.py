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


class Workers(Protocol):
    """Where `run_backlog` has tasks done."""

    def has_room(self) -> bool:
        """Whether another task may begin."""
        ...

    def begin(self, task: Task) -> None:
        """Begins a task that is not finished."""
        ...

    def is_busy(self) -> bool:
        """Whether a task has begun whose result was not given yet."""
        ...

    def next_result(self) -> TaskResult | None:
        """Waits for one of the tasks that have begun; None where it has begun anew. Raises the task's own error."""
        ...


def run_backlog(backlog: Backlog, place: Workplace, workers: Workers) -> Generator[TaskResult]:
    """The loop of all executors: yields results as they come, until nothing waits or the workers take no more."""
    while True:
        while workers.has_room() and (task := backlog.next()) is not None:
            if (finished := find_finished(task, place)) is None:
                workers.begin(task)
            else:
                backlog.add_followers(finished)
                yield finished
        if not workers.is_busy():
            return
        if (result := workers.next_result()) is not None:
            backlog.add_followers(result)
            yield result


class _ThisProcess:
    """One task at a time, done when its result is asked for."""

    def __init__(self, place: Workplace) -> None:
        self._place = place
        self._begun: Task | None = None

    def has_room(self) -> bool:
        """See `Workers`."""
        return self._begun is None

    def begin(self, task: Task) -> None:
        """See `Workers`."""
        self._begun = task

    def is_busy(self) -> bool:
        """See `Workers`."""
        return self._begun is not None

    def next_result(self) -> TaskResult:
        """See `Workers`."""
        assert self._begun is not None, "a result is asked for when a task has begun"
        task, self._begun = self._begun, None
        try:
            return run_task(task, self._place)
        except SystemError as error:
            # An interrupt that comes while a compiled kernel runs leaves it in this disguise.
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise KeyboardInterrupt from None
            raise


class SerialExecutor:
    """Runs tasks one by one in this process."""

    name = "serial"
    workers = 1

    def run(
        self, tasks: Iterable[Task], place: Workplace, followers_of: FollowersOf = no_followers
    ) -> Generator[TaskResult]:
        """See `Executor.run`."""
        return run_backlog(Backlog(tasks, followers_of), place, _ThisProcess(place))

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
        yield from run_backlog(backlog, place, _Patient(place, self))
        yield from self._larger.run(iter(backlog.next, None), place, followers_of)

    def is_patient(self) -> bool:
        """Whether tasks still run in this process."""
        return self._patience > 0

    def wait_for(self, seconds: float) -> None:
        """Takes what a task took off the patience."""
        self._patience -= seconds

    def close(self) -> None:
        """See `Executor.close`."""
        self._larger.close()


class _Patient(_ThisProcess):
    """The same as long as a growing executor's patience lasts."""

    def __init__(self, place: Workplace, executor: GrowingExecutor) -> None:
        super().__init__(place)
        self._executor = executor

    def has_room(self) -> bool:
        """See `Workers`."""
        return self._executor.is_patient() and super().has_room()

    def next_result(self) -> TaskResult:
        """See `Workers`."""
        began, compiling = time.perf_counter(), Stopwatch()
        with listening(compiling):
            result = super().next_result()
        self._executor.wait_for(time.perf_counter() - began - compiling.seconds)
        return result
