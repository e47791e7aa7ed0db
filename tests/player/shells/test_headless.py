"""Rendering a path without a window: frames, report, comparison; the same bytes every time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from player.camera.path import CameraPath
from player.camera.view import looking
from player.offers import names
from player.renderer.context import headless_context
from player.shells.headless import Report, ReportMaker, Screen, play, render, write_report
from player.shown_model import ShownModel, shown_model
from player.strategies import STRATEGIES
from player.walkthrough import Settings
from storage.geometry_reader import Geometry
from storage.store import Store, open_store
from tests.player.conftest import UP, store_path
from tests.storage.tiny_store import box_part, make_store, room_parts

SCREEN = Screen(96, 54, 70)


def walk_along(count: int) -> CameraPath:
    """From one end of the room to the other, looking around."""
    positions = np.stack([np.linspace(0.6, 7.4, count), np.full(count, 1.1), np.full(count, 1.7)], axis=1)
    turns = np.linspace(0.2, 1.4, count)
    orientations = [looking((np.cos(turn), np.sin(turn), -0.2), UP) for turn in turns]
    return CameraPath(np.arange(count) / 10, positions, np.array(orientations))


class Heard:
    """Progress that remembers."""

    def __init__(self) -> None:
        self.calls: list[object] = []

    def start(self, step: str) -> None:
        self.calls.append(step)

    def update(self, done: int, total: int, before: int = 0) -> None:
        self.calls.append((done, total))

    def finish(self, note: str) -> None:
        self.calls.append(note)


def played(model: ShownModel, path: CameraPath, settings: Settings, **options: bool) -> tuple[list[np.ndarray], Report]:
    """The pictures of a path, coverage included, and the report."""
    keeping = ReportMaker(model, path, SCREEN, settings)
    pictures = []
    for frame in render(model, path, SCREEN, settings, **options):
        keeping.add(frame)
        pictures.append(frame.picture)
    return pictures, keeping.report()


@pytest.fixture(scope="module", autouse=True)
def _driver(context: object) -> None:
    """Skips where there is no OpenGL."""


def test_frames_and_report_say_what_happened(room: Store, tmp_path: Path) -> None:
    heard = Heard()
    model = shown_model(open_store(store_path(room)))
    report = play(model, walk_along(6), SCREEN, Settings(), frames=tmp_path / "f", progress=heard)
    assert heard.calls == ["rendering", *((n + 1, 6) for n in range(6)), "6 frames"]
    assert sorted(file.name for file in (tmp_path / "f").iterdir()) == [f"frame_{n:04d}.png" for n in range(6)]
    with Image.open(tmp_path / "f" / "frame_0003.png") as image:
        assert image.size == (96, 54)
    content = report.content
    for row in content["frames"]:
        cell = int(room.cell_at(np.array([row["position"]]))[0])
        assert (row["cell"], row["computed"], row["strategy"]) == (cell, True, "vlod")
        assert 0 < row["triangles"] <= content["model_triangles"]
        assert row["draw_calls"] >= 1
        assert row["absent"] == row["replaced"] == 0
        assert row["frame_ms"] >= row["cpu_ms"] >= row["strategy_ms"] > 0
    fetched = [row["bytes_fetched"] for row in content["frames"]]
    assert fetched == sorted(fetched)
    assert content["totals"]["frames"] == content["totals"]["computed_frames"] == 6
    assert content["totals"]["cells_entered"] > 1
    write_report(tmp_path / "deep" / "r.json", report)
    assert json.loads((tmp_path / "deep" / "r.json").read_text())["format"] == "vlod-play-report"
    assert report.passed


def test_pictures_and_counts_do_not_depend_on_threads_or_cache(room: Store) -> None:
    keys = ("triangles", "drawables", "cell", "computed", "draw_calls")
    results = []
    for settings in (
        Settings(),
        Settings(threads=1),
        Settings(cache_bytes=1),
        Settings(prefetch=False),
    ):
        model = shown_model(open_store(store_path(room)))
        pictures, report = played(model, walk_along(4), settings)
        results.append((np.array(pictures), [[row[key] for key in keys] for row in report.content["frames"]]))
    for pictures, rows in results[1:]:
        assert np.array_equal(pictures, results[0][0])
        assert rows == results[0][1]


def test_what_is_fetched_is_the_same_in_every_run(room: Store) -> None:
    runs = []
    for _ in range(2):
        model = shown_model(open_store(store_path(room)))
        rows = play(model, walk_along(5), SCREEN, Settings(threads=3)).content["frames"]
        runs.append([(row["bytes_fetched"], row["cache_bytes"]) for row in rows])
    assert runs[0] == runs[1]


@pytest.mark.parametrize("strategy", names(STRATEGIES))
def test_a_complete_vlod_shows_what_the_full_model_shows(room: Store, strategy: str, tmp_path: Path) -> None:
    settings = replace(Settings(), strategy=strategy)
    report = play(shown_model(room), walk_along(5), SCREEN, settings, frames=tmp_path, compare=True)
    assert report.passed
    compared = report.content["compare"]
    assert compared["holes"] == 0
    assert compared["largest_differing"] <= 0.01
    for image in compared["images"].values():
        assert (tmp_path / image).is_file()
    if strategy == "none":
        assert compared["largest_differing"] == 0


def test_a_wall_that_is_missing_is_found(tmp_path: Path) -> None:
    def visible(geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        return cut[geometry.drawables["lo"][cut, 0] < 7.9]  # not the east wall

    store = make_store(tmp_path / "s", room_parts(), depth=1, visible=visible)
    report = play(shown_model(store), walk_along(5), SCREEN, Settings(), frames=tmp_path / "f", compare=True)
    assert not report.passed
    compared = report.content["compare"]
    assert compared["holes"] > 100
    assert compared["holes_in_a_million"] == 1e6 * compared["holes"] / compared["covered_pixels"] > 1
    worst = max(report.content["frames"], key=lambda row: row["compare"]["holes"])
    assert compared["worst_frame"] == worst["index"]
    with Image.open(tmp_path / "f" / compared["images"]["difference"]) as image:
        shown = np.array(image)
    assert ((shown == (255, 0, 0)).all(axis=2)).sum() == worst["compare"]["holes"]


@pytest.mark.parametrize("lacking", ["pane", "wall east"])
def test_holes_are_counted_with_panes_left_out_and_differences_with_them(tmp_path: Path, lacking: str) -> None:
    """A pane before the east wall: where the pane lacks there is no hole, where the wall does, one behind the pane."""
    parts = [*room_parts(), box_part("pane", (7.5, 0, 0), (7.6, 6, 3), segments=(6,), colour=(20, 40, 200, 160))]
    number = [part.name for part in parts].index(lacking)

    def visible(geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        return cut[geometry.nodes["part"][geometry.drawables["node"][cut]] != number]

    model = shown_model(make_store(tmp_path / "s", parts, depth=1, visible=visible))
    compared = played(model, walk_along(5), Settings(), compare=True)[1].content["compare"]
    assert not compared["passed"]
    assert compared["largest_differing"] > 0.01
    assert compared["holes"] == 0 if lacking == "pane" else compared["holes"] > 100


def test_outside_the_computed_cells_there_is_a_picture(odd_room: Store) -> None:
    path = CameraPath(np.zeros(1), np.array([[-6.0, -5.0, 6.0]]), np.array([looking((10, 8, -5), UP)]))
    pictures, report = played(shown_model(odd_room), path, Settings(), compare=True)
    assert not report.content["frames"][0]["computed"]
    assert report.content["frames"][0]["cell"] == -1
    assert pictures[0][..., 3].any()
    assert report.passed


def test_without_waiting_every_frame_comes_at_once_and_the_picture_completes(model: ShownModel) -> None:
    path = walk_along(1)
    still = CameraPath(np.arange(300) / 10, np.repeat(path.positions, 300, 0), np.repeat(path.orientations, 300, 0))
    pictures, report = played(model, still, Settings(wait=False))
    waited, _ = played(model, path, Settings())
    last = report.content["frames"][-1]
    assert last["absent"] == last["replaced"] == 0
    assert last["computed"]
    assert np.array_equal(pictures[-1], waited[0])


def test_a_driver_that_is_missing_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    import moderngl

    from player.errors import GraphicsError

    def fail(**_: object) -> None:
        raise Exception("eglInitialize failed (0x3001)")

    monkeypatch.setattr(moderngl, "create_standalone_context", fail)
    with pytest.raises(GraphicsError, match=r"eglInitialize failed.*apt-get install libegl1 libgl1-mesa-dri"):
        headless_context()
