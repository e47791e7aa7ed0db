"""Running tasks: the protocol, and the executor that runs them in this process.

An executor yields results as they come, in no promised order; whoever needs an order sorts by key. `then` may name new
tasks for a result, which join the same run: this is how waves of cells grow. Finished tasks are not run again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from typing import Protocol

from jobs.tasks import Task, TaskResult, find_finished, run_task
from jobs.workplace import Workplace

Then = Callable[[TaskResult], Iterable[Task]]


def no_more(_result: TaskResult) -> Iterable[Task]:
    """Nothing follows from a result."""
    return ()


class Executor(Protocol):
    """Runs tasks somewhere."""

    name: str
    workers: int  # tasks at once

    def run(self, tasks: Iterable[Task], place: Workplace, then: Then = no_more) -> Generator[TaskResult]:
        """Runs tasks, and those that `then` names for each result, and yields the results in order of completion.

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

    def __init__(self, tasks: Iterable[Task], then: Then) -> None:
        self._source = iter(tasks)
        self._followers: deque[Task] = deque()
        self._then = then

    def next(self) -> Task | None:
        """The next task, None if nothing waits now."""
        return self._followers.popleft() if self._followers else next(self._source, None)

    def add_followers(self, result: TaskResult) -> None:
        """Queues what follows from a result."""
        self._followers.extend(self._then(result))


class SerialExecutor:
    """Runs tasks one by one in this process."""

    name = "serial"
    workers = 1

    def run(self, tasks: Iterable[Task], place: Workplace, then: Then = no_more) -> Generator[TaskResult]:
        """See `Executor.run`."""
        backlog = Backlog(tasks, then)
        while (task := backlog.next()) is not None:
            try:
                result = find_finished(task, place) or run_task(task, place)
            except SystemError as error:
                # An interrupt that comes while a compiled kernel runs leaves it in this disguise.
                if isinstance(error.__cause__, KeyboardInterrupt):
                    raise KeyboardInterrupt from None
                raise
            backlog.add_followers(result)
            yield result

    def close(self) -> None:
        """Nothing to give back."""
