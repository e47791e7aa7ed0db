"""What a build was asked for and what it has made so far: all that a stage's tasks are made from.

Each file of a stage is a `StageFile`; `jobs.pipeline` lists them in their order.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from jobs.parameters import BuildParameters, ViewSpace, view_space
from jobs.running.executors import FollowersOf, no_followers
from jobs.running.memory import TASK_MEMORY
from jobs.running.run import WavesAfter, no_waves
from jobs.running.tasks import Stage, Task, TaskResult
from jobs.running.workplace import Workplace


@dataclass
class BuildState:
    """A build under way."""

    place: Workplace
    inputs: Sequence[Path]  # files or folders of the model
    parameters: BuildParameters
    memory: int = TASK_MEMORY  # that a task may need, in bytes
    results: dict[str, list[TaskResult]] = field(default_factory=dict)  # of the stages that are done, by name

    def all(self, stage: Stage) -> list[TaskResult]:
        """The results of a stage that is done."""
        return self.results[stage.name]

    def one(self, stage: Stage) -> TaskResult:
        """The result of a stage of one task that is done."""
        (result,) = self.results[stage.name]
        return result

    def view_space(self, imported: TaskResult) -> ViewSpace:
        """Where cells are computed, given the import's result. Raises ParameterError where that is nowhere."""
        model = imported.record["model"]
        lo, hi, origin = (np.asarray(model[name], np.float64) for name in ("lo", "hi", "origin"))
        return view_space(self.parameters, lo, hi, origin)


class Tasks(NamedTuple):
    """The tasks of a stage."""

    first: Iterable[Task]
    followers_of: FollowersOf = no_followers  # tasks that can be made once a result is there
    waves_after: WavesAfter = no_waves  # how many waves of tasks may follow from one


class StageFile(Protocol):
    """What the pipeline knows of a stage: the rest of its file is its own."""

    STAGE: Stage

    def tasks(self, state: BuildState) -> Tasks:
        """The stage's tasks, once all stages before it are done."""
        ...
