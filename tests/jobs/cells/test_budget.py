"""The budget of triangles: no cell reports more, those that had to be coarser say so, and the rest is as without it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jobs.cells.budget import coarsen, raised_error
from jobs.checking.verify import verify
from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from jobs.visibility.engine import CellVisibility
from storage import open_store
from storage.base.errors import ParameterError, StoreNotFoundError
from storage.model.cut import choose_cut, coarsest_triangles
from storage.store import Store

PARAMETERS = BuildParameters(triangles_per_cell=3000, max_depth=2, quality="draft")


@pytest.fixture(scope="module")
def free(small_plant, tmp_path_factory) -> Store:
    """Without a budget."""
    return built(small_plant, tmp_path_factory.mktemp("free"), None)


def built(model, folder, most) -> Store:
    build([model], folder / "store", dataclasses.replace(PARAMETERS, max_triangles=most), SerialExecutor())
    return open_store(folder / "store")


def raised(store: Store) -> np.ndarray:
    return np.flatnonzero(store.cells["pixel_error"] > 1)


@pytest.mark.parametrize("most", [2500, 800, 60])
def test_no_cell_reports_more_than_the_budget(small_plant, free, tmp_path, most):
    store = built(small_plant, tmp_path, most)
    counts = store.drawables["triangles"].astype(np.int64)
    assert free.cells["triangles"].max() > most
    assert store.manifest.parameters["max_triangles"] == most
    for cell, row in enumerate(store.cells):
        assert counts[store.vlod(cell)].sum() == row["triangles"] <= most
    dearer = raised(store)
    assert len(dearer)
    assert (store.cells["depth"][dearer] == PARAMETERS.max_depth).all()
    angle = store.manifest.pixel_angle
    for cell in dearer.tolist():
        row = store.cells[cell]
        cut = choose_cut(store.nodes, store.drawables, row["lo"], row["hi"], angle, float(row["pixel_error"]))
        assert np.array_equal(store.cut(cell), cut)
        assert len(cut) == row["cut_drawables"]
        assert np.isin(store.vlod(cell), cut).all()
    assert verify(str(tmp_path / "store"), samples=300, cells=12, workers=1).problems == []


def test_cells_within_the_budget_are_as_without_it(small_plant, free, tmp_path):
    most = int(np.quantile(free.cells["triangles"], 0.8))
    store = built(small_plant, tmp_path, most)
    place = {int(key): cell for cell, key in enumerate(free.cells["key"])}
    same = [(cell, place.get(int(row["key"]))) for cell, row in enumerate(store.cells) if row["pixel_error"] == 1]
    kept = [(a, b) for a, b in same if b is not None]
    assert len(kept) > len(free.cells) // 2
    for a, b in kept:
        assert store.cells[a] == free.cells[b]
        assert np.array_equal(store.vlod(a), free.vlod(b))


def test_a_budget_that_all_cells_keep_changes_no_cell(small_plant, free, tmp_path):
    store = built(small_plant, tmp_path, int(free.cells["triangles"].max()))
    assert np.array_equal(store.cells, free.cells)
    assert store.manifest.cells == free.manifest.cells


def test_the_target_is_never_above_the_budget(small_plant, tmp_path):
    # without a budget, the whole model in one cell would be within the target
    parameters = dataclasses.replace(PARAMETERS, triangles_per_cell=10**9, max_triangles=3000)
    build([small_plant], tmp_path / "store", parameters, SerialExecutor())
    cells = open_store(tmp_path / "store").cells
    assert cells["depth"].max() > 0
    assert (cells["triangles"] <= 3000).all()


def test_less_than_the_coarsest_model_is_refused_before_any_cell(small_plant, free, tmp_path):
    least = coarsest_triangles(free.nodes, free.drawables)
    with pytest.raises(ParameterError, match=f"--max-triangles {least} or more"):
        built(small_plant, tmp_path, least - 1)
    with pytest.raises(StoreNotFoundError):
        open_store(tmp_path / "store")
    assert not any((tmp_path / "store" / "work").glob("cells/*"))
    store = built(small_plant, tmp_path, least)
    assert (store.cells["triangles"] <= least).all()


@given(st.floats(0.01, 100, allow_nan=False), st.integers(0, 40))
def test_steps_of_the_ladder_are_a_third_to_a_half_apart_and_survive_the_store(first, step):
    low, high = raised_error(first, step), raised_error(first, step + 1)
    assert 1.33 < high / low < 1.51
    assert float(np.float32(low)) == low
    assert raised_error(first, 0) == float(np.float32(first))


@given(
    st.lists(st.integers(0, 1000), min_size=2, max_size=30), st.floats(0, 1), st.integers(0, 1000), st.integers(1, 40)
)
def test_the_step_holds_and_the_one_below_it_does_not(sizes, share, most, expected):
    """Cuts of any sizes, of which any part is seen, as long as the last one is small enough, whatever was expected."""
    sizes = [most + 1, *sizes, most]
    tried: dict[int, int] = {}
    steps = {raised_error(1.0, step): step for step in range(len(sizes))}

    def look(cut):
        seen = int(share * len(cut))
        tried[len(tried)] = int(cut[0])
        empty = np.zeros(0, np.int64)
        return None if seen > most else CellVisibility(np.arange(seen), empty)

    def cut_at(error):
        return np.full(max(1, sizes[steps[error]]), steps[error])

    most = max(most, 1)
    sizes[-1] = most
    found = coarsen(cut_at, len, look, 1.0, most, expected)
    step = steps[found.pixel_error]
    assert step == found.step
    assert (found.cut == step).all()
    assert step >= 1
    assert len(found.found.visible) <= most
    assert int(share * sizes[step]) <= most
    if step > 1:
        assert step - 1 in tried.values()
        assert int(share * max(1, sizes[step - 1])) > most
