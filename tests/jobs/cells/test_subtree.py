"""Which cells there are, what their tasks need, and how much time they may take."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import jobs.cells.subtree
from jobs.cells.cuts import Leaves
from jobs.cells.gather import gather
from jobs.cells.needs import triangles_needed
from jobs.cells.parameters import CellParameters, Visibility
from jobs.cells.subtree import compute_subtree
from jobs.parameters import BuildParameters, view_space
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from jobs.visibility.settings import QUALITIES, EngineSettings
from storage import open_store
from storage.base.typed_json import from_json, to_json
from storage.cells import octree
from storage.cells.octree import Octree
from storage.geometry_reader import Geometry, open_geometry
from storage.store import Store
from tests.jobs.built_geometry import build_geometry
from tests.storage.tiny_store import box_part, make_geometry

PARAMETERS = BuildParameters(triangles_per_cell=2000, max_depth=3, quality="draft")
SMALL = (-20.0, -20.0, 0.0, 20.0, 20.0, 3.0)


@pytest.fixture(scope="module")
def geometry(small_plant, tmp_path_factory) -> Geometry:
    return build_geometry([small_plant], tmp_path_factory.mktemp("geometry")).geometry


@pytest.fixture(scope="module")
def default(small_plant, tmp_path_factory) -> Store:
    return built(small_plant, tmp_path_factory.mktemp("default"), PARAMETERS)


def built(model, folder, parameters: BuildParameters) -> Store:
    build([model], folder / "store", parameters, SerialExecutor())
    return open_store(folder / "store")


def of_cells(geometry: Geometry, parameters: BuildParameters) -> CellParameters:
    lo, hi = (geometry.nodes[name][0].astype(np.float64) for name in ("lo", "hi"))
    space = view_space(parameters, lo, hi, np.zeros(3))
    return from_json(CellParameters, to_json(parameters.cells(space)), "parameters")


def test_what_splits_save_little_stays_whole(small_plant, default, tmp_path, monkeypatch):
    monkeypatch.setattr(jobs.cells.subtree, "LEAST_SAVED", -np.inf)
    split = built(small_plant, tmp_path, PARAMETERS)
    place = {int(key): cell for cell, key in enumerate(split.cells["key"])}
    whole = [cell for cell, key in enumerate(default.cells["key"]) if int(key) not in place]
    assert 0 < len(whole) < len(default.cells) < len(split.cells)
    covered = 0
    for cell, row in enumerate(default.cells):
        if cell not in whole:
            covered += 1
            assert row == split.cells[place[int(row["key"])]]
            continue
        children = [place[int(key)] for key in octree.children(int(row["key"])) if int(key) in place]
        covered += len(children)
        mean = split.cells["triangles"][children].mean()
        assert PARAMETERS.triangles_per_cell < row["triangles"] <= mean / 0.9
    assert covered == len(split.cells)


@pytest.mark.parametrize("bound", [{}, {"max_triangles": 1500, "view_box": SMALL}, {"view_box": SMALL}])
def test_a_task_needs_no_more_than_was_foretold(geometry, monkeypatch, bound):
    parameters = of_cells(geometry, dataclasses.replace(PARAMETERS, **bound))
    counts = geometry.drawables["triangles"]
    held: list[list[int]] = []

    def noted(store, ids, settings):
        held[-1].append(int(counts[ids].sum()))
        return gather(store, ids, settings)

    monkeypatch.setattr("jobs.cells.subtree.gather", noted)
    around = Leaves.of(geometry, parameters)
    pending, foretold = [octree.ROOT], []
    while pending:
        root = pending.pop()
        foretold.append(triangles_needed(geometry, root, parameters, around))
        held.append([])
        pending.extend(compute_subtree(geometry, root, parameters, around).open_keys)
    assert len(foretold) > 3
    for need, parts in zip(foretold, held, strict=True):
        coarser = max(parts[1:], default=0)  # one at a time, beside what all cells share
        assert parts[0] + coarser <= need <= 2 * (parts[0] + max(parts)) + 1
    assert any(len(parts) > 1 for parts in held) == ("max_triangles" in bound)


@pytest.mark.parametrize("alpha", [255, 254, 26])
def test_what_stands_behind_glass_is_in_the_cell(tmp_path, monkeypatch, alpha):
    """A cupboard whose door is of glass, or not, and a vase in it: seen from one cell before it, and from eight."""
    monkeypatch.setattr(jobs.cells.subtree, "LEAST_SAVED", -np.inf)
    parts = [
        box_part("wall", (-20, 5, -20), (20, 5.5, 20), segments=(6,)),
        box_part("door", (-20, 2, -20), (20, 2.1, 20), segments=(5,), colour=(150, 180, 200, alpha)),
        box_part("vase", (-0.3, 3, -0.3), (0.3, 4, 0.3), segments=(2,)),
        box_part("cellar", (-0.3, 6, -0.3), (0.3, 7, 0.3), segments=(2,)),
    ]
    section, _, _ = make_geometry(tmp_path, parts)
    geometry = open_geometry(tmp_path, section)
    clear = gather(geometry, np.arange(4), EngineSettings()).see_through
    assert clear.tolist() == [False, alpha < 255, False, False]
    around = np.full(3, 1.9)
    for most, cells in ((1, 8), (10_000, 1)):
        parameters = CellParameters(
            Octree.around(-around, around), (-1.9,) * 3, (1.9,) * 3, 1, most, None, 1e-3, 1.0, Visibility()
        )
        result = compute_subtree(geometry, octree.ROOT, parameters, Leaves.of(geometry, parameters))
        assert len(result.cells) == cells
        assert (result.cells["hi"][:, 1] < 2).all()  # before the door
        for first, end in zip(result.offsets[:-1], result.offsets[1:], strict=True):
            assert result.ids[first:end].tolist() == ([0, 1, 2] if alpha < 255 else [1])


def test_the_usual_quality_is_the_engines_usual_settings():
    assert QUALITIES["normal"] == EngineSettings()
    assert BuildParameters().quality == "normal"


def test_the_quality_decides_the_engines_settings_and_stands_in_the_manifest(small_plant, default):
    assert default.manifest.parameters["quality"] == "draft"
    for quality, settings in QUALITIES.items():
        assert of_cells(default, dataclasses.replace(PARAMETERS, quality=quality)).engine == settings


def test_an_engines_images_take_what_the_plan_sets_aside(geometry):
    for settings in QUALITIES.values():
        r = settings.resolution
        assert settings.image_bytes >= np.empty((6, r, r, settings.layers, 2), np.float32).nbytes
