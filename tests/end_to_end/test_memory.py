"""No task of a build takes more memory than was estimated for it before it began."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

#: Builds in a process of its own, whose memory is that of a build alone: estimate and peak of every task, in bytes.
BUILD = """
import json, sys
from pathlib import Path
from jobs.running.executors import SerialExecutor
from jobs.parameters import BuildParameters
from jobs.pipeline import build

tasks = []

class Noting(SerialExecutor):
    def run(self, *arguments):
        for result in super().run(*arguments):
            tasks.append((result.task.stage.name, result.task.memory, result.peak_memory))
            yield result

parameters = BuildParameters(max_depth=1)
build([Path(sys.argv[1])], Path(sys.argv[2]), parameters, Noting(), memory=int(sys.argv[3]))
print(json.dumps(tasks))
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["city", "plant"])
def test_every_task_stays_below_its_estimate(kind, tmp_path):
    from jobs.scenes import write_scene

    write_scene(kind, tmp_path / "model.glb", 100_000, 0)
    command = [sys.executable, "-c", BUILD, str(tmp_path / "model.glb"), str(tmp_path / "store"), str(1 << 30)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=600)
    tasks = json.loads(done.stdout)
    assert {stage for stage, _, _ in tasks} >= {
        "import",
        "pieces",
        "hierarchy",
        "nodes",
        "tables",
        "cells",
        "layout",
        "shards",
        "order",
        "packs",
        "index",
    }
    for stage, estimate, peak in tasks:
        assert 0 < peak < estimate <= 1 << 30, (stage, estimate, peak)
