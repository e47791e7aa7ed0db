"""What a window shows and does, without one: keys, messages, help; any driver that renders will do."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import moderngl
import numpy as np
import pytest

from player.offers import names
from player.shells.head_up_display import message_rows
from player.shells.headless import Screen
from player.shells.keys import HELD, key_table
from player.shells.window import Viewer, WindowOptions
from player.shown_model import ShownModel, shown_model
from player.strategies import STRATEGIES
from player.walkthrough import Settings
from storage.shards.shards import shard_path
from storage.store import Store, open_store
from tests.player.conftest import draw, store_path
from tests.player.shells.test_headless import walk_along
from tests.storage.tiny_store import box_part, make_store, room_parts


class Keys:
    """Names of keys; each is itself."""

    ACTION_PRESS, ACTION_RELEASE = "down", "up"

    def __getattr__(self, name: str) -> str:
        return name


class Window:
    """As much of a window of moderngl-window as the viewer uses."""

    def __init__(self, context: moderngl.Context) -> None:
        self.ctx = context
        self.buffer_size = (320, 180)
        self.fbo = context.framebuffer([context.renderbuffer(self.buffer_size, 4)])
        self.keys = Keys()
        self.mouse_exclusivity = False
        self.is_closing = False

    def close(self) -> None:
        self.is_closing = True

    def press(self, *keys: str, action: str = Keys.ACTION_PRESS) -> None:
        for key in keys:
            self.key_event_func(key, action, SimpleNamespace(shift=False))  # type: ignore[attr-defined]


def _viewer(context: moderngl.Context, model: ShownModel, output: Path) -> Viewer:
    options = WindowOptions(Screen(320, 180, 60), walk_along(4), False, output, 1.6)
    return Viewer(Window(context), model, Settings(wait=False), options)


@pytest.fixture
def viewer(context: moderngl.Context, model: ShownModel, tmp_path: Path) -> Iterator[Viewer]:
    made = _viewer(context, model, tmp_path)
    yield made
    made.close()


def test_every_key_of_the_table_does_something(viewer: Viewer) -> None:
    viewer.step(0.02)
    names_of_keys = [name for row in key_table() for name in row.actions]
    assert len(names_of_keys) == len(set(names_of_keys))
    assert not HELD.keys() & set(names_of_keys)
    for name in names_of_keys:
        before = (viewer.message, viewer.show_help, viewer.show_statistics, viewer.window.mouse_exclusivity)
        viewer.window.press(name)
        viewer.step(0.02)
        after = (viewer.message, viewer.show_help, viewer.show_statistics, viewer.window.mouse_exclusivity)
        assert before != after or viewer.window.is_closing, name


def test_digits_choose_strategies_in_their_order(viewer: Viewer) -> None:
    for number, name in reversed(list(enumerate(names(STRATEGIES), start=1))):
        viewer.window.press(f"NUMBER_{number}")
        assert viewer.step(0.02).strategy == name


def test_another_error_than_the_stores_is_called_approximate(viewer: Viewer) -> None:
    deadline = time.monotonic() + 60
    while not viewer.step(0.02).computed and time.monotonic() < deadline:
        time.sleep(0.01)
    statistics = viewer.step(0.02)
    assert statistics.computed
    assert not statistics.approximate
    viewer.window.press("EQUAL")
    assert viewer.step(0.02).approximate
    viewer.window.press("MINUS")
    assert not viewer.step(0.02).approximate
    viewer.window.press("NUMBER_2", "EQUAL")
    assert not viewer.step(0.02).approximate  # the frustum's cut is right for any error


def test_a_path_is_recorded_and_replayed(viewer: Viewer, tmp_path: Path) -> None:
    viewer.window.press("R", "W")
    for _ in range(5):
        viewer.step(0.02)
    viewer.window.press("R")
    viewer.window.press("W", action=Keys.ACTION_RELEASE)
    assert viewer.recorder.recorded is not None
    assert len(viewer.recorder.recorded) == 5
    assert (tmp_path / "vlod_path_0001.json").is_file()
    start = viewer.camera.position.copy()
    viewer.window.press("T")
    viewer.step(0.0)
    assert np.linalg.norm(viewer.camera.position - start) > 0.1
    viewer.window.press("W")
    assert not viewer.recorder.replaying


def test_what_cannot_be_written_is_said_and_the_window_stays(viewer: Viewer, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    viewer.options = replace(viewer.options, output=tmp_path / "file")
    viewer.step(0.02)
    viewer.window.press("P")
    assert str(tmp_path / "file") in viewer.message
    assert viewer.step(0.02)


def test_what_cannot_be_had_is_said_first(viewer: Viewer) -> None:
    sound = replace(viewer.step(0.02), unreadable=0, trouble="", absent=0)
    assert message_rows(sound, 3, "H: help") == [("H: help",)]
    assert message_rows(sound, 3, "") == []
    assert message_rows(replace(sound, absent=2), 3, "H: help") == [("3 packs to come ...",)]
    ahead = replace(sound, absent=2, trouble="shards/ab is damaged")
    assert message_rows(ahead, 3, "H: help") == [("shards/ab is damaged",)]
    needed = " ".join(line for (line,) in message_rows(replace(ahead, unreadable=5), 3, ""))
    assert needed.startswith("what cannot be had for now: 5 ")
    assert needed.endswith("shards/ab is damaged")


def test_a_window_stays_open_over_a_store_that_is_gone(room: Store, context: moderngl.Context, tmp_path: Path) -> None:
    shutil.copytree(store_path(room), tmp_path / "store")
    store = open_store(tmp_path / "store")
    viewer = _viewer(context, shown_model(store), tmp_path)
    names_of_shards = [shard.name for shard in store.manifest.geometry.shards]
    for name in names_of_shards:
        (tmp_path / "store" / shard_path(name)).unlink()
    statistics = viewer.step(0.02)
    deadline = time.monotonic() + 60
    while not statistics.unreadable and time.monotonic() < deadline:
        time.sleep(0.01)
        statistics = viewer.step(0.02)
    assert statistics.unreadable
    assert names_of_shards[0] in statistics.trouble
    viewer.close()


def test_the_window_shows_panes_as_pictures_do(context: moderngl.Context, tmp_path: Path) -> None:
    """Text is laid over each frame, the next one begins afresh; and the window may be resized."""
    pane = box_part("pane", (2.5, 0, 0), (2.6, 6, 3), segments=(2,), colour=(20, 40, 200, 120))
    model = shown_model(make_store(tmp_path / "s", [*room_parts(), pane], depth=1))
    viewer = _viewer(context, model, tmp_path)
    viewer.toggle_statistics()
    for size in ((320, 180), (200, 120)):
        viewer.window.buffer_size = size
        viewer.window.fbo = context.framebuffer([context.renderbuffer(size, 4)])
        deadline = time.monotonic() + 60
        while viewer.statistics is None or viewer.walk.packs.pending or not viewer.statistics.computed:
            viewer.step(0.0)
            assert time.monotonic() < deadline
        for _ in range(2):
            viewer.step(0.0)
        picture = draw(context, model, viewer.view())
        assert np.array_equal(viewer.target.read(), picture)
        shown = np.frombuffer(viewer.window.fbo.read(components=4, alignment=1), np.uint8).reshape(*size[::-1], 4)[::-1]
        above = size[1] // 2  # the message
        assert np.array_equal(shown[:above, :, :3], picture[:above, :, :3])
        assert not np.array_equal(shown[above:, :, :3], picture[above:, :, :3])
    viewer.close()
    assert context.error == "GL_NO_ERROR"
