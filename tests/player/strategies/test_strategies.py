"""Strategies against their definitions: the cell's vLOD, the cut for the eye, everything."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from player.camera.view import boxes_between, boxes_in_frustum
from player.shown_model import shown_model
from player.strategies.frustum import Frustum
from player.strategies.none import NoCulling
from player.strategies.strategy import Strategy
from player.strategies.vlod import Vlod
from storage.model.cut import choose_cut
from storage.store import Store
from tests.player.conftest import inside_view, view_from
from tests.storage.tiny_store import make_store, room_parts


def _all_strategies(store: Store) -> list[Strategy]:
    model = shown_model(store)
    return [
        Vlod(model, pixel_error=1, wait=True),
        Frustum(model, pixel_error=1),
        NoCulling(model, pixel_error=1),
    ]


def test_every_strategy_gives_sorted_ids_of_one_level_a_node(odd_room: Store) -> None:
    rng = np.random.default_rng(0)
    for strategy in _all_strategies(odd_room):
        for _ in range(30):
            position = tuple(rng.uniform([-1, -1, -0.5], [9, 7, 4]))
            choice = strategy.choose(view_from(position, tuple(rng.normal(size=3))))
            assert np.all(np.diff(choice.drawables) > 0)
            nodes = odd_room.drawables["node"][choice.drawables]
            assert len(set(nodes.tolist())) == len(nodes)
            ahead = strategy.ahead(view_from(position, (1, 0, 0)), np.array([0.1, 0, 0]))
            assert ahead is None or len(set(ahead.tolist())) == len(ahead)
        strategy.close()


def test_vlod_is_the_cells_list_within_the_frustum(odd_room: Store) -> None:
    model = shown_model(odd_room)
    strategy = Vlod(model, pixel_error=1, wait=True)
    rng = np.random.default_rng(1)
    cells = set()
    for _ in range(60):
        position = rng.uniform([0, 0, 0], [8, 6, 3])
        view = view_from(tuple(position), tuple(rng.normal(size=3)))
        choice = strategy.choose(view)
        cell = int(odd_room.cell_at(position[None])[0])
        assert choice.cell == cell
        assert choice.computed == (cell >= 0)
        if cell >= 0:
            ids = odd_room.vlod(cell)
            box = odd_room.drawables[ids]
            assert np.array_equal(choice.drawables, ids[boxes_in_frustum(view, boxes_between(box["lo"], box["hi"]))])
        strategy.ahead(view, np.zeros(3))
        cells.add(cell)
    assert len(cells) > 10


def test_outside_computed_cells_vlod_falls_back_to_the_frustum(odd_room: Store) -> None:
    model = shown_model(odd_room)
    view = view_from((-40, -30, 2), (40, 30, 0))
    found = Vlod(model, pixel_error=1, wait=True).choose(view)
    assert not found.computed
    assert found.cell == -1
    assert np.array_equal(found.drawables, Frustum(model, pixel_error=1).choose(view).drawables)
    assert len(found.drawables)


def test_frustum_is_the_cut_for_the_eye(room: Store) -> None:
    view = inside_view()
    inside = boxes_in_frustum(view, boxes_between(room.nodes["lo"], room.nodes["hi"]))
    eye = view.position
    cut = choose_cut(room.nodes, room.drawables, eye, eye, room.manifest.pixel_angle, 2.0)
    expected = cut[inside[room.drawables["node"][cut]]]
    assert np.array_equal(Frustum(shown_model(room), pixel_error=2.0).choose(view).drawables, expected)


def test_none_is_the_finest_level_of_everything(room: Store) -> None:
    ids = NoCulling(shown_model(room), pixel_error=9).choose(inside_view()).drawables
    assert len(ids) == len(room.nodes)
    assert (room.drawables["level"][ids] == 0).all()


def test_more_allowed_error_means_fewer_triangles(room: Store) -> None:
    strategy = Vlod(shown_model(room), pixel_error=1, wait=True)
    view = inside_view()
    triangles = []
    for error in (0.01, 1.0, 64.0, 1000.0):
        strategy.pixel_error = error
        triangles.append(int(room.drawables["triangles"][strategy.choose(view).drawables].sum()))
    assert triangles == sorted(triangles, reverse=True)
    assert triangles[-1] < triangles[0]


@pytest.mark.parametrize("built_for", [1.0, 0.3])
def test_a_cell_with_a_raised_error_stays_coarser_by_as_much(tmp_path: Path, built_for: float) -> None:
    plain = make_store(tmp_path / "plain", room_parts(), depth=1, pixel_error=built_for)
    position = inside_view().position
    cell = int(plain.cell_at(position[None])[0])
    store = make_store(tmp_path / "raised", room_parts(), depth=1, pixel_error=built_for, raised={cell: 60 * built_for})
    assert len(store.vlod(cell))
    assert not np.array_equal(store.vlod(cell), plain.vlod(cell))
    strategy = Vlod(shown_model(store), pixel_error=built_for, wait=True)
    rows = store.drawables

    def drawn(error: float) -> set[int]:
        strategy.pixel_error = error
        return set(strategy.choose(inside_view()).drawables.tolist())

    def allowed(error: float) -> set[int]:
        row = store.cells[cell]
        cut = choose_cut(store.nodes, rows, row["lo"], row["hi"], store.manifest.pixel_angle, error)
        return set(cut[boxes_in_frustum(inside_view(), boxes_between(rows["lo"][cut], rows["hi"][cut]))].tolist())

    remembered = float(np.float32(60 * built_for))
    assert drawn(built_for) == allowed(remembered) <= set(store.vlod(cell).tolist())
    assert drawn(4 * built_for) == allowed(remembered * 4)
    assert drawn(built_for / 8) == allowed(remembered / 8)
    assert drawn(built_for / 8) != drawn(built_for) != drawn(40 * built_for)


def test_without_waiting_lists_arrive_in_the_background(room: Store) -> None:
    Vlod(shown_model(room), pixel_error=1, wait=True).choose(inside_view())  # compiles the kernels: not what is timed
    strategy = Vlod(shown_model(room), pixel_error=1, wait=False)
    try:
        view = inside_view()
        first = strategy.choose(view)
        assert len(first.drawables)  # the frustum's, meanwhile
        deadline = time.monotonic() + 20
        while not strategy.choose(view).computed and time.monotonic() < deadline:
            strategy.ahead(view, np.zeros(3))
            time.sleep(0.005)
        assert strategy.choose(view).computed
    finally:
        strategy.close()


def test_wishes_for_cells_ahead_keep_the_present_one_first(room: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    wished: list[list[int]] = []
    monkeypatch.setattr("player.loading.prefetch.Loader.wish", lambda _, keys: wished.append(list(keys)))
    strategy = Vlod(shown_model(room), pixel_error=1, wait=False)
    try:
        cell = strategy.choose(inside_view()).cell
        strategy.ahead(inside_view(), np.zeros(3))
        assert [keys[0] for keys in wished] == [cell, cell]
        assert len(wished[1]) > 1
    finally:
        strategy.close()


def test_what_lies_ahead_comes_before_what_lies_behind(odd_room: Store) -> None:
    strategy = Vlod(shown_model(odd_room), pixel_error=1, wait=True)
    view = view_from((2.8, 3, 1), (1, 0, 0))  # beyond x = 3, cells see everything
    own = strategy.choose(view_from((2.8, 3, 1), (1, 0, 0)))
    ahead = strategy.ahead(view, np.array([0.2, 0, 0]))
    assert ahead is not None
    cell_list = odd_room.vlod(own.cell)
    assert set(ahead[: len(cell_list)].tolist()) == set(cell_list.tolist())
    assert len(ahead) > len(cell_list)
    assert strategy.ahead(view, np.array([0.2, 0, 0])) is None


def test_store_without_cells_is_played_by_the_frustum(room: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "cell_at", lambda points: np.full(len(points), -1))
    choice = Vlod(shown_model(room), pixel_error=1, wait=True).choose(inside_view())
    assert len(choice.drawables)
    assert not choice.computed
