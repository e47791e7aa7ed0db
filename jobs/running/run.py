"""Running stages one after the other, each as a set of tasks, and noting what they took."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Sequence

from jobs.report.build_report import StageReport
from jobs.running.errors import MemoryLimitError
from jobs.running.executors import Executor, FollowersOf, no_followers
from jobs.running.memory import TASK_MEMORY, MemoryWatch
from jobs.running.tasks import Stage, Task, TaskResult, find_finished
from jobs.running.workplace import Workplace
from storage.base.amounts import format_size
from storage.base.progress import Progress


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

    def all(self, stage: Stage, tasks: Iterable[Task], followers_of: FollowersOf = no_followers) -> list[TaskResult]:
        """The results of a stage's tasks: first those of `tasks` in their order, then those that followed, by key.

        Tasks of one key are run once, and each gets the result. Raises MemoryLimitError for a task that would need too
        much memory, before it begins.
        """
        given = list(tasks)
        known: set[str] = set()

        def unknown(more: Iterable[Task]) -> list[Task]:
            new = list({task.key: task for task in more if task.key not in known}.values())
            self._check(new)
            known.update(task.key for task in new)
            return new

        first = unknown(given)
        began = time.perf_counter()
        self.watch.restart()
        self.progress.start(stage.name)
        self.progress.update(0, len(known))
        results: dict[str, TaskResult] = {}
        running = self.executor.run(first, self.place, lambda result: unknown(followers_of(result)))
        with contextlib.closing(running) as finished:
            for result in finished:
                results[result.key] = result
                self.progress.update(len(results), len(known))
        report = _stage_report(stage, list(results.values()), time.perf_counter() - began, self.watch.restart())
        self.reports.append(report)
        reused = f", {report.reused} finished before" if report.reused else ""
        self.progress.finish(f"{len(results)} task{'s' if len(results) != 1 else ''}{reused}")
        followed = sorted(results.keys() - {task.key for task in given})
        return [results[task.key] for task in given] + [results[key] for key in followed]

    def _check(self, tasks: Iterable[Task]) -> None:
        for task in tasks:
            if task.memory > self.memory and find_finished(task, self.place) is None:
                raise _too_large(task, self.memory)


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
