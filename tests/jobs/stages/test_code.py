"""Keys know the code that decides a result, and no other: what changes beside it throws nothing away."""

from __future__ import annotations

from pathlib import Path

import pytest

from jobs.pipeline import STAGES
from jobs.running.tasks import _sources
from jobs.stages.support.code import with_imports

ROOT = Path(__file__).parents[3]


def sources(stage):
    return {path.relative_to(ROOT).as_posix() for module in stage.code for path in _sources(module)}


@pytest.mark.parametrize("stage", [file.STAGE for file in STAGES], ids=lambda stage: stage.name)
def test_what_decides_nothing_is_in_no_key(stage):
    own = sources(stage)
    assert stage.function.partition(":")[0].replace(".", "/") + ".py" in own
    for apart in (
        "jobs/pipeline.py",
        "jobs/running/",
        "jobs/report/",
        "storage/base/progress.py",
        "storage/cells/codecs/",
        "storage/cli/",
        "storage/shards/cache.py",
        "storage/shards/files.py",
    ):
        assert not [path for path in own if path.startswith(apart) and path != "jobs/running/arrays.py"], apart


def test_a_new_importer_throws_only_imports_away():
    having = [file.STAGE.name for file in STAGES if "jobs/importing/formats/ply_file.py" in sources(file.STAGE)]
    assert having == ["import"]


def test_visibility_and_levels_know_nothing_of_each_other():
    of = {file.STAGE.name: sources(file.STAGE) for file in STAGES}
    assert not any(path.startswith("jobs/visibility/") for path in of["nodes"])
    assert not any(path.startswith("jobs/detail/") for path in of["cells"])
    assert of["layout"].isdisjoint(of["nodes"] - of["import"])


def test_imports_are_followed_within_a_room():
    found = with_imports("jobs.cells.needs", "jobs.cells")
    assert found == ("jobs.cells.cuts", "jobs.cells.needs", "jobs.cells.parameters", "jobs.cells.task_keys")
