"""Building a tiny store: what is in it, what is repeated, and that nothing but its input decides its bytes."""

from __future__ import annotations

import dataclasses
import json
import re
from typing import ClassVar

import numpy as np
import pytest

import jobs.pipeline
import jobs.stages.cells
from jobs.cells.cuts import Leaves
from jobs.checking.verify import verify
from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.errors import MemoryLimitError, WorkInUseError
from jobs.running.executors import SerialExecutor, no_followers
from jobs.running.memory import PROCESS
from jobs.running.workplace import Workplace
from jobs.visibility.settings import QUALITIES
from storage import open_store
from storage.base.errors import (
    CURE,
    CorruptStoreError,
    ModelError,
    ParameterError,
    StoreFormatError,
)
from storage.base.progress import Silent
from storage.shards.manifest import FORMAT, to_bytes
from tests.jobs.tiny_model import write_rooms

PARAMETERS = BuildParameters(triangles_per_cell=150, max_depth=3)

#: Triangles: cuts of the model at 60 pixels have 312 to 348.
ROOM = 330


@pytest.fixture(scope="session")
def model(tmp_path_factory):
    return write_rooms(tmp_path_factory.mktemp("model") / "rooms.obj", rooms=2)


@pytest.fixture(scope="session")
def built(model, tmp_path_factory):
    """A finished store and its report."""
    store = tmp_path_factory.mktemp("built") / "store"
    return store, build([model], store, PARAMETERS, SerialExecutor())


def shards(store):
    return {path.name: path.read_bytes() for path in (store / "shards").iterdir()}


def test_the_report_agrees_with_the_store(built):
    path, report = built
    store = open_store(path)
    assert report.version == store.manifest.version == 1
    assert report.counts == store.manifest.counts
    assert report.counts["computed_cells"] == len(store.cells) > 20
    assert report.counts["finest_triangles"] == report.model["triangles"]
    assert report.bytes["total"] == sum(len(content) for content in shards(path).values())
    assert [stage.name for stage in report.stages] == [
        "import",
        "pieces",
        "hierarchy",
        "shared",
        "nodes",
        "tables",
        "cells",
        "layout",
        "shards",
        "order",
        "packs",
        "index",
    ]
    assert report.tasks_run == sum(stage.run for stage in report.stages) > 6
    assert report.tasks_reused == 0
    assert all(stage.peak_memory >= stage.peak_task_memory * 0.9 > 0 for stage in report.stages)
    assert json.loads(report.to_text())["tasks_run"] == report.tasks_run
    assert list(store.check()) == []


def test_the_words_on_the_pipeline_list_its_stages():
    listed = re.findall(r"^    (\w+)  +\S.*  +\S", jobs.pipeline.__doc__, re.MULTILINE)
    assert listed == [file.STAGE.name for file in jobs.pipeline.STAGES]


def test_cells_tile_the_view_space(built):
    path, _ = built
    store = open_store(path)
    model = store.manifest.model
    rng = np.random.default_rng(1)
    points = rng.uniform(model.lo, model.hi, (500, 3))
    cells = store.cell_at(points)
    assert (cells >= 0).all()
    assert (store.cells["lo"][cells] <= points).all()
    assert (points <= store.cells["hi"][cells]).all()


def test_every_vlod_is_part_of_its_cut(built):
    store = open_store(built[0])
    for cell in range(len(store.cells)):
        assert np.isin(store.vlod(cell), store.cut(cell)).all()


def test_boxes_and_errors_hold_what_they_claim(built):
    store = open_store(built[0])
    for number, row in enumerate(store.drawables):
        positions = store.mesh(number).positions
        assert np.array_equal(positions.min(axis=0), row["lo"])
        assert np.array_equal(positions.max(axis=0), row["hi"])
        node = store.nodes[row["node"]]
        assert (node["lo"] <= row["lo"]).all()
        assert (node["hi"] >= row["hi"]).all()
    for number, node in enumerate(store.nodes):
        below = store.nodes[number + 1 : node["end"]]
        assert (node["lo"] <= below["lo"]).all()
        assert (node["hi"] >= below["hi"]).all()
        levels = store.drawables[node["first_drawable"] : node["first_drawable"] + node["levels"]]
        assert (np.diff(levels["error"]) > 0).all()


def test_building_again_repeats_nothing_and_changes_nothing(model, built, tmp_path):
    store, first = built
    before, manifest = shards(store), (store / "manifest.json").read_bytes()
    again = build([model], store, PARAMETERS, SerialExecutor())
    assert again.tasks_run == 0
    assert again.tasks_reused == first.tasks_run
    assert again.version == 1
    assert shards(store) == before
    assert (store / "manifest.json").read_bytes() == manifest


def test_a_task_that_would_need_too_much_memory_is_refused_before_it_begins(model, tmp_path):
    store = tmp_path / "store"
    with pytest.raises(MemoryLimitError, match=r"'import' needs about \S+ of memory, and 64MiB .* --memory \d+MiB, or"):
        build([model], store, PARAMETERS, SerialExecutor(), memory=64 << 20)
    assert not any((store / "work").glob("import/*"))


def test_memory_changes_no_byte_and_what_is_finished_needs_none(model, built, tmp_path):
    store = tmp_path / "store"
    build([model], store, PARAMETERS, SerialExecutor(), memory=8 << 30)
    assert shards(store) == shards(built[0])
    assert (store / "manifest.json").read_bytes() == (built[0] / "manifest.json").read_bytes()
    assert build([model], store, PARAMETERS, SerialExecutor(), memory=1).tasks_run == 0


def test_cells_that_are_known_to_be_crowded_are_split_without_a_look_at_their_triangles(
    model, built, tmp_path, monkeypatch
):
    crowded = Leaves.crowd
    seen = []

    def noted(*arguments):
        seen.append(crowded(*arguments))
        return False

    monkeypatch.setattr(Leaves, "crowd", noted)
    build([model], tmp_path / "store", PARAMETERS, SerialExecutor())
    assert any(seen)
    assert shards(tmp_path / "store") == shards(built[0])


@pytest.mark.parametrize("max_triangles", [None, 200])
def test_what_is_too_large_to_look_at_is_split_unseen_or_gets_a_coarser_cut(
    model, built, tmp_path, monkeypatch, max_triangles
):
    """Room for some cells' cuts and not for others', twice, and to the same bytes."""
    asked: list[int] = []

    class Noting(SerialExecutor):
        def run(self, tasks, place, followers_of=no_followers):
            def noted(more):
                for task in more:
                    asked.append(task.memory)
                    yield task

            return super().run(noted(tasks), place, lambda result: list(noted(followers_of(result))))

    monkeypatch.setattr(jobs.stages.cells, "PER_TRIANGLE", 1 << 20)
    parameters = dataclasses.replace(PARAMETERS, pixel_error=60.0, max_triangles=max_triangles)
    reached = []
    for name, triangles in (("ample", 1 << 20), ("scarce", ROOM), ("again", ROOM)):
        asked.clear()
        memory = PROCESS + jobs.stages.cells.REST + QUALITIES[parameters.quality].image_bytes + (triangles << 20)
        build([model], tmp_path / name, parameters, Noting(), memory=memory)
        assert 0 < max(asked) <= memory
        reached.append(open_store(tmp_path / name).cells)
    ample, scarce = reached[:2]
    assert shards(tmp_path / "scarce") == shards(tmp_path / "again")
    assert scarce["cut_triangles"].max() <= ROOM < ample["cut_triangles"].max()
    raised = scarce["pixel_error"] > parameters.pixel_error
    assert raised.any()
    assert (scarce["depth"][raised] == parameters.max_depth).all()
    volume = [float((cells["hi"] - cells["lo"]).prod(axis=1).sum()) for cells in (ample, scarce)]
    assert np.isclose(*volume)
    if max_triangles is not None:
        assert scarce["triangles"].max() <= max_triangles
    assert verify(str(tmp_path / "scarce"), samples=300).problems == []


def test_another_place_gives_the_same_bytes(model, built, tmp_path):
    moved = tmp_path / "elsewhere" / "rooms.obj"
    moved.parent.mkdir()
    moved.write_bytes(model.read_bytes())
    build([moved], tmp_path / "store", PARAMETERS, SerialExecutor(), work=tmp_path / "work")
    assert shards(tmp_path / "store") == shards(built[0])
    assert (tmp_path / "store" / "manifest.json").read_bytes() == (built[0] / "manifest.json").read_bytes()
    assert not (tmp_path / "store" / "work").exists()


def test_other_parameters_repeat_only_what_depends_on_them(model, tmp_path):
    store = tmp_path / "store"
    build([model], store, PARAMETERS, SerialExecutor())
    old = open_store(store)
    report = build([model], store, dataclasses.replace(PARAMETERS, max_depth=1), SerialExecutor())
    run = {stage.name: stage.run for stage in report.stages}
    assert not any(run[name] for name in ("import", "pieces", "hierarchy", "shared", "nodes", "tables"))
    assert run["cells"] > 0
    assert report.version == 2
    assert open_store(store).cells["depth"].max() == 1
    # The former version stays readable, and so does a store that was opened before.
    assert len(open_store(store, version=1).cells) == len(old.cells)
    assert list(old.check()) == []
    assert all(len(old.vlod(cell)) == old.cells["drawables"][cell] for cell in range(len(old.cells)))


@pytest.mark.parametrize("most", [1, 10**9])
def test_cells_are_of_the_size_asked_for_and_as_many_as_told(model, tmp_path, most):
    told = []

    class Heard(Silent):
        def start(self, step):
            told.append([step])

        def finish(self, note):
            told[-1].append(note)

    parameters = BuildParameters(triangles_per_cell=most, cell_size=3.0, quality="draft")
    build([model], tmp_path / "store", parameters, SerialExecutor(), Heard())
    cells = open_store(tmp_path / "store").cells
    assert cells["hi"] - cells["lo"] == pytest.approx(3.0)
    assert ["view space", f"{len(cells)} cells of 3"] in told
    assert len(cells) > 8


def test_cells_too_small_for_an_octree_are_refused_with_a_size_that_is_not(model, tmp_path):
    with pytest.raises(ParameterError, match=r"choose --cell-size \S+ or more"):
        build([model], tmp_path / "s", BuildParameters(cell_size=1e-9), SerialExecutor())
    assert not (tmp_path / "s").exists()


def test_another_visibility_engine_is_written_down_and_works_out_the_cells_anew(model, tmp_path):
    store = tmp_path / "store"
    parameters = dataclasses.replace(PARAMETERS, max_depth=2)
    build([model], store, parameters, SerialExecutor())
    shrunk = dataclasses.replace(parameters, visibility_engine="shrunk-occluders")
    report = build([model], store, shrunk, SerialExecutor())
    run = {stage.name: stage.run for stage in report.stages}
    assert run["cells"] > 0
    assert not run["tables"]
    engines = [open_store(store, version=k).manifest.parameters["visibility_engine"] for k in (1, 2)]
    assert engines == ["flooded-occluders", "shrunk-occluders"]
    assert verify(str(store), samples=2000).problems == []


def test_a_region_computes_only_cells_that_touch_it(model, built, tmp_path):
    region = (0.5, 0.5, 0.5, 3.0, 3.0, 1.5)
    view = tuple(open_store(built[0]).manifest.model.lo + open_store(built[0]).manifest.model.hi)
    parameters = dataclasses.replace(PARAMETERS, region=region, view_box=view)
    build([model], tmp_path / "store", parameters, SerialExecutor())
    cells = open_store(tmp_path / "store").cells
    assert 0 < len(cells) < len(open_store(built[0]).cells)
    assert (cells["lo"] <= region[3:]).all()
    assert (cells["hi"] >= region[:3]).all()


def test_cells_are_not_split_below_the_cell_size(model, tmp_path):
    parameters = BuildParameters(triangles_per_cell=1, cell_size=3.0)
    build([model], tmp_path / "store", parameters, SerialExecutor())
    cells = open_store(tmp_path / "store").cells
    edges = cells["hi"] - cells["lo"]
    assert (edges >= 3.0).all()
    assert (edges < 6.5).all()
    assert (cells["triangles"] > 1).any()


def test_a_lost_shard_is_made_again(model, tmp_path):
    store = tmp_path / "store"
    build([model], store, PARAMETERS, SerialExecutor())
    whole = shards(store)
    for name in sorted(whole)[::3]:
        (store / "shards" / name).unlink()
    report = build([model], store, PARAMETERS, SerialExecutor())
    assert report.tasks_run > 0
    assert shards(store) == whole


def test_the_cure_that_damage_is_reported_with_helps(model, tmp_path):
    store = tmp_path / "store"
    build([model], store, PARAMETERS, SerialExecutor())
    damaged = [store / "manifest.json", *sorted((store / "shards").iterdir())[::3]]
    for path in damaged:
        whole = path.read_bytes()
        path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 4]))
        try:
            said = [problem.what for problem in open_store(store).check()]
        except CorruptStoreError as error:
            said = [str(error)]
        assert any(path.name in line and line.endswith(CURE) for line in said)
        path.unlink()
        build([model], store, PARAMETERS, SerialExecutor())
        assert path.read_bytes() == whole
        assert not list(open_store(store).check())


def test_an_edited_model_is_built_anew(tmp_path):
    model = write_rooms(tmp_path / "rooms.obj", rooms=1)
    store = tmp_path / "store"
    build([model], store, BuildParameters(), SerialExecutor())
    write_rooms(model, rooms=2)
    report = build([model], store, BuildParameters(), SerialExecutor())
    assert report.version == 2
    assert open_store(store).manifest.model.triangles == report.model["triangles"]


@pytest.mark.parametrize(
    "wrong",
    [
        {"view_box": (0, 0, 0, 0, 1, 1)},
        {"view_box": (0, 0, 0, float("nan"), 1, 1)},
        {"region": (1, 1, 1, 0, 2, 2)},
        {"triangles_per_cell": 0},
        {"max_triangles": 0},
        {"quality": "best"},
        {"max_depth": -1},
        {"max_depth": 99},
        {"cell_size": 0.0},
        {"pixel_error": -1.0},
        {"up": "w"},
        {"visibility_engine": "magic"},
    ],
)
def test_parameters_out_of_range(wrong):
    with pytest.raises(ParameterError):
        BuildParameters(**wrong)


def test_a_region_outside_the_view_space_is_told_after_the_import_and_leaves_nothing(model, tmp_path):
    class Heard(Silent):
        said: ClassVar[list[str]] = []

        def start(self, step):
            self.said.append(step)

    outside = BuildParameters(region=(99, 99, 99, 100, 100, 100), view_box=(-1, -2, -3, 4, 5, 6))
    with pytest.raises(ParameterError, match=r"region .* which is \[-1\.0, -2\.0, -3\.0, 4\.0, 5\.0, 6\.0\]: choose"):
        build([model], tmp_path / "s", outside, SerialExecutor(), Heard())
    assert Heard.said == ["import"]
    assert not (tmp_path / "s").exists()


def test_a_refused_region_leaves_a_former_build_as_it_was(built, model):
    store, _ = built

    def files():
        return {path: path.stat().st_mtime_ns for path in store.rglob("*") if path.is_file()}

    before = files()
    with pytest.raises(ParameterError, match="region"):
        build([model], store, dataclasses.replace(PARAMETERS, region=(99, 99, 99, 100, 100, 100)), SerialExecutor())
    assert files() == before


def test_inputs_that_are_no_models(tmp_path):
    with pytest.raises(ModelError, match=r"absent\.glb"):
        build([tmp_path / "absent.glb"], tmp_path / "s", BuildParameters(), SerialExecutor())
    (tmp_path / "text.obj").write_text("this is not a model\n")
    with pytest.raises(ModelError, match=r"text\.obj"):
        build([tmp_path / "text.obj"], tmp_path / "s", BuildParameters(), SerialExecutor())
    (tmp_path / "empty").mkdir()
    with pytest.raises(ModelError, match="empty"):
        build([tmp_path / "empty"], tmp_path / "s", BuildParameters(), SerialExecutor())


def test_two_builds_in_one_work_directory(model, tmp_path):
    place = Workplace(tmp_path / "store" / "work", tmp_path / "store")
    with place.locked(), pytest.raises(WorkInUseError, match="process"):
        build([model], tmp_path / "store", PARAMETERS, SerialExecutor())


def test_a_store_cannot_replace_a_file(model, tmp_path):
    (tmp_path / "store").write_text("something of the user's")
    with pytest.raises(ParameterError, match="is a file"):
        build([model], tmp_path / "store", PARAMETERS, SerialExecutor())
    assert (tmp_path / "store").read_text() == "something of the user's"


def test_a_store_of_another_format_is_told_before_any_work(model, tmp_path):
    store = tmp_path / "store"
    build([model], store, PARAMETERS, SerialExecutor())
    manifest = store / "manifest.json"
    former = to_bytes(dataclasses.replace(open_store(store).manifest, format=FORMAT - 1))
    manifest.write_bytes(former)
    before = shards(store)
    with pytest.raises(StoreFormatError, match=rf"of format {FORMAT - 1}, .* in another place or after it is removed"):
        build([model], store, dataclasses.replace(PARAMETERS, max_depth=1), SerialExecutor())
    assert shards(store) == before
    assert manifest.read_bytes() == former
