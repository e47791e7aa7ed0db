"""Running stages one after the other, each as a set of tasks, and noting what they took."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from jobs.report.build_report import StageReport
from jobs.running.errors import MemoryLimitError
from jobs.running.executors import Executor, FollowersOf, no_followers
from jobs.running.memory import TASK_MEMORY, MemoryWatch
from jobs.running.tasks import Stage, Task, TaskResult, find_finished
from jobs.running.workplace import Workplace
from storage.base.amounts import format_size
from storage.base.progress import Progress

#: How many waves of tasks may follow from a task, one after the other.
WavesAfter = Callable[[Task], int]

#: Tasks that follow from one, before any has told.
FOLLOWERS = 8.0


def no_waves(_task: Task) -> int:
    """Nothing follows from a task."""
    return 0


class Run:
    """Runs stages one after the other and notes what they took."""

    def __init__(
        self, place: Workplace, executor: Executor, progress: Progress, watch: MemoryWatch, memory: int = TASK_MEMORY
    ) -> None:
        """memory: that a task may need, in bytes."""
        self.memory = memory
        self.place = place
        self.executor = executor
        self.progress = progress
        self.watch = watch
        self.reports: list[StageReport] = []

    def all(
        self,
        stage: Stage,
        tasks: Iterable[Task],
        followers_of: FollowersOf = no_followers,
        waves_after: WavesAfter = no_waves,
    ) -> list[TaskResult]:
        """The results of a stage's tasks: first those of `tasks` in their order, then those that followed, by key.

        Tasks of one key are run once, and each gets the result. waves_after: for telling how many there may be in the
        end. Raises MemoryLimitError for a task that would need too much memory, before it begins.
        """
        given = list(tasks)
        known: set[str] = set()
        expected = Expected(waves_after)

        def unknown(more: Iterable[Task]) -> list[Task]:
            new = list({task.key: task for task in more if task.key not in known}.values())
            self._check(new)
            known.update(task.key for task in new)
            expected.begin(new)
            return new

        def follow(result: TaskResult) -> list[Task]:
            new = unknown(followers_of(result))
            expected.finish(result.task, len(new))
            return new

        first = unknown(given)
        began = time.perf_counter()
        self.watch.restart()
        self.progress.start(stage.name)
        self.progress.update(0, expected.total)
        results: dict[str, TaskResult] = {}
        reused = 0
        running = self.executor.run(first, self.place, follow)
        with contextlib.closing(running) as finished:
            for result in finished:
                results[result.key] = result
                reused += result.reused
                self.progress.update(len(results), expected.total, reused)
        report = _stage_report(stage, list(results.values()), time.perf_counter() - began, self.watch.restart())
        self.reports.append(report)
        before = f", {report.reused} finished before" if report.reused else ""
        self.progress.finish(f"{len(results)} task{'s' if len(results) != 1 else ''}{before}")
        followed = sorted(results.keys() - {task.key for task in given})
        return [results[task.key] for task in given] + [results[key] for key in followed]

    def _check(self, tasks: Iterable[Task]) -> None:
        for task in tasks:
            if task.memory > self.memory and find_finished(task, self.place) is None:
                raise _too_large(task, self.memory)


class Expected:
    """Counts the tasks of a stage that have begun, and guesses how many will follow.

    A task after which w waves may come is taken to have as many followers as those like it had that are done; where
    none is done, as those one wave earlier.
    """

    def __init__(self, waves_after: WavesAfter) -> None:
        self._waves_after = waves_after
        self._known = 0
        self._open: Counter[int] = Counter()  # tasks that are not done, by the waves that may follow
        self._done: Counter[int] = Counter()
        self._followers: Counter[int] = Counter()  # of those that are done

    def begin(self, tasks: Iterable[Task]) -> None:
        """These tasks wait or run."""
        for task in tasks:
            self._known += 1
            self._open[self._waves_after(task)] += 1

    def finish(self, task: Task, followers: int) -> None:
        """A task is done, and so many follow from it."""
        waves = self._waves_after(task)
        self._open[waves] -= 1
        self._done[waves] += 1
        self._followers[waves] += followers

    @property
    def total(self) -> int:
        """Tasks in all: those that are known, and those that are expected to follow from them."""
        last = max(self._open, default=0)
        each = [FOLLOWERS] * (last + 1)  # followers of a task, by the waves after it
        for waves in range(last, -1, -1):
            if self._done[waves]:
                each[waves] = self._followers[waves] / self._done[waves]
            elif waves < last:
                each[waves] = each[waves + 1]
        below = [0.0] * (last + 1)
        for waves in range(1, last + 1):
            below[waves] = each[waves] * (1 + below[waves - 1])
        return self._known + round(sum(count * below[waves] for waves, count in self._open.items()))


def _too_large(task: Task, most: int) -> MemoryLimitError:
    """The error for a task that needs more than the `most` bytes that are allowed."""
    need, cure = format_size(task.memory), task.stage.cure
    return MemoryLimitError(
        f"a task of stage {task.stage.name!r} needs about {need} of memory, and {format_size(most)} are allowed: "
        f"allow --memory {need}" + (f", or {cure}" if cure is not None else "")
    )


def _stage_report(stage: Stage, results: Sequence[TaskResult], seconds: float, peak: int) -> StageReport:
    return StageReport(
        name=stage.name,
        run=sum(not result.reused for result in results),
        reused=sum(result.reused for result in results),
        seconds=round(seconds, 3),
        core_seconds=round(sum(result.core_seconds for result in results), 3),
        peak_memory=peak,
        peak_task_memory=max((result.peak_memory for result in results), default=0),
        shard_bytes=sum(size for result in results for _, size in result.record.get("shards", ())),
    )
