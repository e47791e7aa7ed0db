"""What a build did: counts, bytes, seconds and memory, stage by stage."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class StageReport:
    """One stage of a build."""

    name: str
    run: int  # tasks that were run
    reused: int  # tasks that were finished before
    seconds: float  # from the stage's start to its end
    core_seconds: float  # of processor time that all its tasks took when they ran, those finished before included
    peak_memory: int  # of this process and all its children on this machine together, in bytes
    peak_task_memory: int  # of the largest process that ran one of its tasks, in bytes
    shard_bytes: int  # of the shards that its tasks wrote, in bytes


@dataclass(frozen=True)
class BuildReport:
    """A whole build."""

    store: str
    version: int  # of the store's manifest
    model: dict[str, Any]  # digest, triangles, box and so on, as in the manifest
    repairs: dict[str, Any]  # what the import removed or repaired, by kind and part
    parameters: dict[str, Any]
    executor: str
    workers: int
    counts: dict[str, int]  # parts, nodes, drawables, cells and so on
    bytes: dict[str, int]  # of the store's shards: tables, geometry, cells, and their total
    seconds: float  # of the whole build
    peak_memory: int  # of this process and all its children on this machine together, in bytes
    stages: tuple[StageReport, ...]

    @property
    def tasks_run(self) -> int:
        """Tasks that this build ran."""
        return sum(stage.run for stage in self.stages)

    @property
    def tasks_reused(self) -> int:
        """Tasks that were finished before."""
        return sum(stage.reused for stage in self.stages)

    def left_out(self) -> list[str]:
        """What the import left out or repaired, for people: a line for each kind, the most frequent first."""
        lines = []
        for kind, found in sorted(self.repairs.items(), key=lambda item: (-item[1]["total"], item[0])):
            part, most = min(found["parts"].items(), key=lambda item: (-item[1], item[0]))
            where = f"in {part}" if len(found["parts"]) == 1 else f"{most:,} in {part}, {len(found['parts']):,} parts"
            lines.append(f"left out or repaired: {found['total']:,} {kind} ({where})")
        return lines

    def to_json(self) -> dict[str, Any]:
        """The report as JSON."""
        return {**dataclasses.asdict(self), "tasks_run": self.tasks_run, "tasks_reused": self.tasks_reused}

    def to_text(self) -> str:
        """The report as indented JSON text."""
        return json.dumps(self.to_json(), indent=1) + "\n"
