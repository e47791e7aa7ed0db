"""A stage and a codec are added by a file each, and a line in a list."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jobs import pipeline
from jobs.parameters import BuildParameters
from jobs.pipeline import STAGES, build
from jobs.running.errors import MemoryLimitError
from jobs.running.executors import SerialExecutor
from jobs.stages import cells, layout, shards
from storage import open_store
from storage.base.errors import ParameterError
from storage.cells import codecs
from tests.jobs.stages import toy_codec, toy_stage
from tests.jobs.tiny_model import write_rooms

PARAMETERS = BuildParameters(triangles_per_cell=150, max_depth=2, quality="draft")


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return write_rooms(tmp_path_factory.mktemp("model") / "rooms.obj", rooms=1)


def content(store):
    files = {path.name: path.read_bytes() for path in (store / "shards").iterdir()}
    return {**files, "manifest": (store / "manifest.json").read_bytes()}


def test_a_stage_is_a_file_and_a_line(model, tmp_path, monkeypatch):
    build([model], tmp_path / "without", PARAMETERS, SerialExecutor())
    at = STAGES.index(cells) + 1
    monkeypatch.setattr(pipeline, "STAGES", (*STAGES[:at], toy_stage, *STAGES[at:]))
    report = build([model], tmp_path / "with", PARAMETERS, SerialExecutor())
    names = [stage.name for stage in report.stages]
    assert names[names.index("cells") + 1] == "toy"
    assert content(tmp_path / "with") == content(tmp_path / "without")
    (shares,) = (tmp_path / "with" / "work" / "toy").glob("*/shares.npy")
    assert len(np.load(shares)) == len(open_store(tmp_path / "with").cells)
    assert build([model], tmp_path / "with", PARAMETERS, SerialExecutor()).tasks_run == 0


def test_what_a_new_stage_needs_is_asked_before_it_begins(model, tmp_path, monkeypatch):
    build([model], tmp_path / "store", PARAMETERS, SerialExecutor())
    at = STAGES.index(layout)
    monkeypatch.setattr(pipeline, "STAGES", (*STAGES[:at], toy_stage, *STAGES[at:]))
    with pytest.raises(MemoryLimitError, match=r"'toy' needs about 1MiB of memory.*, or look away"):
        build([model], tmp_path / "store", PARAMETERS, SerialExecutor(), memory=1000)  # all else is finished


def test_a_codec_is_a_file_and_a_line(model, tmp_path, monkeypatch):
    build([model], tmp_path / "store", PARAMETERS, SerialExecutor())
    usual = open_store(tmp_path / "store")
    with pytest.raises(ParameterError, match=f"^--codec must be {' or '.join(codecs.CODECS)}, not 'toy'"):
        dataclasses.replace(PARAMETERS, codec="toy")
    monkeypatch.setitem(codecs.CODECS, "toy", toy_codec.__name__)
    # a codec that is known and not used throws nothing away
    assert build([model], tmp_path / "store", PARAMETERS, SerialExecutor()).tasks_run == 0
    toy = dataclasses.replace(PARAMETERS, codec="toy")
    report = build([model], tmp_path / "store", toy, SerialExecutor())
    assert {stage.name for stage in report.stages if stage.run} == {"shards"}
    found = open_store(tmp_path / "store")
    assert {shard.codec for shard in found.manifest.cells.shards} == {"toy"}
    assert found.manifest.parameters["codec"] == "toy"
    assert not {shard.name for shard in found.manifest.cells.shards} & {
        shard.name for shard in usual.manifest.cells.shards
    }
    for cell in range(len(usual.cells)):
        assert (found.vlod(cell) == usual.vlod(cell)).all()
    assert list(found.check()) == []


def test_a_shard_is_keyed_by_the_codec_that_it_is_written_in_and_no_other(monkeypatch):
    rooms = ("storage.cells.codecs.context_mixing", "storage.cells.codecs.contexts")
    assert shards._code_of(codecs.DEFAULT) == rooms
    monkeypatch.setitem(codecs.CODECS, "toy", toy_codec.__name__)
    assert shards._code_of(codecs.DEFAULT) == rooms
    assert shards._code_of("toy") == (toy_codec.__name__,)
