"""Walks on while the store fails: servers with errors, silent ones, ones that go and come back; damaged packs."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import moderngl
import numpy as np
import pytest
from click.testing import CliRunner

from player import commands
from player.camera.path import CameraPath, write_path
from player.camera.view import View
from player.loading import prefetch
from player.loading.packs import Packs, PreparedPack
from player.renderer.context import abilities
from player.renderer.targets.target import Target
from player.shells import headless
from player.shells.headless import play
from player.shown_model import ShownModel, shown_model
from player.tour import survey
from player.walkthrough import FrameStatistics, Settings, Walkthrough
from storage.base.errors import StoreError, StoreNotFoundError
from storage.shards import files
from storage.shards.shards import FRAME, TAIL_BYTES, shard_path
from storage.store import Store, open_store
from tests.player.conftest import inside_view, store_path
from tests.player.shells.test_headless import SCREEN, walk_along
from tests.player.unsteady_server import UnsteadyServer
from tests.storage.tiny_store import make_store, room_parts

#: Long enough for anything here, on a busy machine.
PATIENCE = 60.0


@pytest.fixture(scope="module", autouse=True)
def _driver(context: moderngl.Context) -> None:
    """Skips where there is no OpenGL."""


@pytest.fixture(autouse=True)
def _hasty(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Everything that waits for servers waits less."""
    monkeypatch.setattr(files, "FIRST_PAUSE", 0.01)
    if "silent" in request.node.name:
        monkeypatch.setattr(files, "SILENCE_TIME", 0.2)
        monkeypatch.setattr(files, "LAST_ATTEMPT", 0.3)
    monkeypatch.setattr(prefetch, "FIRST_PAUSE", 0.05)
    monkeypatch.setattr(prefetch, "LONGEST_PAUSE", 0.1)


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """The room with two cells in each shard: something is read at almost every step."""
    return make_store(tmp_path_factory.mktemp("rooms") / "store", room_parts(), depth=2, cells_per_shard=2)


@pytest.fixture
def server(rooms: Store) -> Iterator[UnsteadyServer]:
    """Serves `rooms`."""
    with UnsteadyServer(store_path(rooms)) as served:
        yield served


class Player:
    """A walk that does not wait, frame by frame."""

    def __init__(self, context: moderngl.Context, model: ShownModel) -> None:
        self.able = abilities(context)
        self.target = Target(context, (160, 90), samples=0, reversed_depth=self.able.reversed_depth)
        self.walk = Walkthrough(model, context, self.able, Settings(wait=False))

    def frame(self, view: View) -> FrameStatistics:
        """Draws one frame; none may be held up by the store."""
        began = time.monotonic()
        statistics = self.walk.frame(view, self.target)
        assert time.monotonic() - began < 10
        return statistics

    def until(self, view: View, holds: Callable[[FrameStatistics], bool]) -> FrameStatistics:
        """Draws frames until something holds for one, and returns that one."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            statistics = self.frame(view)
            if holds(statistics):
                return statistics
            time.sleep(0.01)
        raise AssertionError(f"it never came to that: {statistics}")

    def close(self) -> None:
        self.walk.close()
        self.target.release()


def complete(s: FrameStatistics) -> bool:
    """Everything is there, out of the cell's list."""
    return s.computed and not (s.absent or s.replaced or s.unreadable)


@pytest.fixture
def player(context: moderngl.Context, server: UnsteadyServer) -> Iterator[Player]:
    """Opened while the server is well, before any mesh or list was read."""
    made = Player(context, shown_model(open_store(server.url)))
    yield made
    made.close()


def _shown(player: Player, view: View, expected: Store, context: moderngl.Context) -> bool:
    """Whether the player's picture is what the sound store shows."""
    sound = Player(context, shown_model(expected))
    sound.until(view, complete)
    same = np.array_equal(sound.target.read(), player.target.read())
    sound.close()
    return same


def test_requests_that_fail_now_and_then_are_repeated_and_leave_no_trace(rooms: Store, server: UnsteadyServer) -> None:
    expected = play(shown_model(rooms), walk_along(5), SCREEN, Settings())
    server.become("every third fails")
    report = play(shown_model(open_store(server.url)), walk_along(5), SCREEN, Settings())
    assert server.refused > 1
    assert report.passed
    keys = ("triangles", "drawables", "cell", "computed", "unreadable", "trouble", "absent", "replaced")
    seen, meant = ([[row[key] for key in keys] for row in r.content["frames"]] for r in (report, expected))
    assert seen == meant


def test_a_walk_goes_on_with_a_server_of_which_every_third_request_fails(
    rooms: Store, server: UnsteadyServer, player: Player, context: moderngl.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "ATTEMPTS", 1)  # so that failures reach the loaders
    server.become("every third fails")
    path = walk_along(4)
    for index in range(len(path)):
        view = inside_view()
        view.position[:], view.orientation[:] = path.pose(index)
        player.until(view, complete)
    assert server.refused > 1
    assert _shown(player, view, rooms, context)


@pytest.mark.parametrize("mood", ["fails", "silent"])
def test_a_server_without_answers_is_said_and_recovered_from(
    rooms: Store, server: UnsteadyServer, player: Player, context: moderngl.Context, mood: str
) -> None:
    server.become(mood)
    view = inside_view()
    first = player.frame(view)
    assert first.absent > 0
    lacking = player.until(view, lambda s: s.unreadable > 1 and bool(s.trouble))
    assert not lacking.computed
    assert server.url in lacking.trouble
    assert "cannot be read" in lacking.trouble
    server.become("well")
    assert player.until(view, complete).trouble == ""
    assert _shown(player, view, rooms, context)


def test_a_server_that_dies_and_comes_back_is_waited_for(
    rooms: Store, server: UnsteadyServer, player: Player, context: moderngl.Context
) -> None:
    path = walk_along(6)
    view = inside_view()
    view.position[:], view.orientation[:] = path.pose(0)
    player.until(view, complete)
    server.die()
    view.position[:], view.orientation[:] = path.pose(5)
    lacking = player.until(view, lambda s: s.unreadable > 0)
    assert lacking.triangles > 0  # what had arrived before is drawn
    assert "cannot be read" in lacking.trouble
    server.live()
    assert player.until(view, complete).trouble == ""
    assert _shown(player, view, rooms, context)


@pytest.mark.parametrize("mood", ["fails", "silent"])
def test_a_walk_that_waits_does_not_wait_for_ever_and_counts_what_lacks(server: UnsteadyServer, mood: str) -> None:
    model = shown_model(open_store(server.url))
    server.become(mood)
    began = time.monotonic()
    report = play(model, walk_along(5), SCREEN, Settings())
    assert time.monotonic() - began < 30
    assert report.content["totals"]["lacking_frames"] == 5
    assert any("cannot be read" in trouble for trouble in report.content["totals"]["troubles"])
    assert not report.passed


def test_a_walk_that_waits_is_whole_again_once_the_server_is_back(server: UnsteadyServer) -> None:
    model = shown_model(open_store(server.url))
    still = walk_along(1)
    many = CameraPath(np.arange(400) / 10, np.repeat(still.positions, 400, 0), np.repeat(still.orientations, 400, 0))
    server.become("fails")

    class Repairs:
        """Mends the server in the middle of the walk."""

        def start(self, step: str) -> None: ...

        def update(self, done: int, total: int, before: int = 0) -> None:
            if done == 10:
                server.become("well")
            time.sleep(0.01)

        def finish(self, note: str) -> None: ...

    rows = play(model, many, SCREEN, Settings(), progress=Repairs()).content["frames"]
    assert rows[0]["unreadable"] > 0
    assert rows[-1]["unreadable"] == rows[-1]["absent"] == rows[-1]["replaced"] == 0
    assert rows[-1]["computed"]
    assert rows[-1]["trouble"] == ""


@pytest.fixture
def damaged(rooms: Store, tmp_path: Path) -> tuple[Path, str]:
    """A copy of the room of which the finest meshes are damaged, and the damaged file."""
    folder = tmp_path / "damaged"
    shutil.copytree(store_path(rooms), folder)
    row = rooms.packs[int(rooms.geometry["pack"][rooms.drawables["geometry"][0]])]
    name = shard_path([record for _, record in rooms.manifest.shards()][1 + int(row["shard"])].name)
    content = bytearray((folder / name).read_bytes())
    length = int.from_bytes(content[-TAIL_BYTES : -TAIL_BYTES + 8], "little")
    index = np.frombuffer(bytes(content[-TAIL_BYTES - length : -TAIL_BYTES]), FRAME)
    content[int(index[int(row["frame"])]["offset"]) + 9] ^= 1
    (folder / name).write_bytes(content)
    return folder, name


def test_damage_is_said_by_file_and_the_walk_goes_on(damaged: tuple[Path, str], context: moderngl.Context) -> None:
    folder, name = damaged
    player = Player(context, shown_model(open_store(folder)))
    player.walk.use_strategy("none")  # draws the finest meshes
    said = player.until(inside_view(), lambda s: bool(s.trouble))
    assert name in said.trouble
    assert "damaged" in said.trouble
    lacking = player.until(inside_view(), lambda s: s.unreadable > 0 and s.replaced > 0 and s.absent == 0)
    assert lacking.triangles > 0
    player.close()


def test_damage_of_what_is_only_loaded_ahead_is_said_too(damaged: tuple[Path, str], context: moderngl.Context) -> None:
    folder, name = damaged
    model = shown_model(open_store(folder))
    player = Player(context, model)
    player.walk.packs.prefetch(np.arange(len(model.store.packs)))
    for number in range(len(model.store.packs)):
        player.walk.packs.keep(np.array([number]))
    empty = np.zeros(0, np.int64)
    deadline = time.monotonic() + PATIENCE
    while player.walk.packs.damage is None and time.monotonic() < deadline:
        player.walk.packs.need(empty, wait=False)
        time.sleep(0.01)
    assert name in str(player.walk.packs.damage)
    assert player.walk.packs.failures(empty) == []
    player.close()


def test_the_command_says_what_lacks_and_fails(damaged: tuple[Path, str], tmp_path: Path) -> None:
    folder, name = damaged
    write_path(tmp_path / "p.json", walk_along(3))
    arguments = [str(folder), "--headless", "--json", "--path", str(tmp_path / "p.json"), "--size", "64x36"]
    done = CliRunner().invoke(commands.play, [*arguments, "--strategy", "none"])
    assert done.exit_code == 1
    assert f"3 frames lack what cannot be read: {folder}/{name}" in done.stderr
    done = CliRunner().invoke(commands.play, [*arguments, "--strategy", "none", "--no-wait"])
    assert done.exit_code == 0


def _mended_after(server: UnsteadyServer, seconds: float) -> None:
    """The server fails, and is well again after so long."""
    server.become("fails")
    threading.Timer(seconds, server.become, ["well"]).start()


@pytest.mark.parametrize("when", ["opening", "touring"])
def test_a_short_outage_before_the_first_frame_is_told_and_waited_for(
    server: UnsteadyServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, when: str
) -> None:
    arguments = [server.url, "--headless", "--json", "--no-wait", "--tour-frames", "2", "--size", "64x36"]
    if when == "opening":
        _mended_after(server, 0.7)
    else:
        real = survey.survey

        def surveyed(model: ShownModel) -> survey.Survey:
            _mended_after(server, 0.7)
            return real(model)

        monkeypatch.setattr(survey, "survey", surveyed)
    done = CliRunner().invoke(commands.play, arguments)
    assert (done.exit_code, done.exception) == (0, None)
    assert server.refused > files.ATTEMPTS
    assert f"{server.url}/{'manifest.json' if when == 'opening' else 'shards/'}" in done.stderr
    assert "does not come: trying again for up to 30 seconds ..." in done.stderr


def test_an_outage_that_lasts_ends_with_what_helps(server: UnsteadyServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "LAST_ATTEMPT", 0.3)
    real = survey.survey

    def surveyed(model: ShownModel) -> survey.Survey:
        server.become("fails")
        return real(model)

    monkeypatch.setattr(survey, "survey", surveyed)
    arguments = [server.url, "--headless", "--json", "--size", "64x36"]
    done = CliRunner().invoke(commands.play, arguments)
    assert isinstance(done.exception, StoreError)
    assert str(done.exception).endswith("its server runs, or give a --path")
    done = CliRunner().invoke(commands.play, arguments)  # fails on opening: no path helps
    assert isinstance(done.exception, StoreError)
    assert str(done.exception).endswith("its server runs")


def test_what_will_not_pass_is_not_waited_for_however_patient(tmp_path: Path) -> None:
    told: list[str] = []
    began = time.monotonic()
    with pytest.raises(StoreNotFoundError):
        open_store(tmp_path, tell=told.append)
    assert time.monotonic() - began < 5
    assert told == []


@pytest.fixture
def _slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Packs take a while to load."""
    real = Packs._load

    def load(packs: Packs, number: int) -> PreparedPack:
        time.sleep(0.05)
        return real(packs, number)

    monkeypatch.setattr(Packs, "_load", load)


@pytest.mark.usefixtures("_slow")
def test_frames_that_do_not_wait_have_the_coarse_picture_from_the_first_on(rooms: Store) -> None:
    content = play(shown_model(open_store(store_path(rooms))), walk_along(4), SCREEN, Settings(wait=False)).content
    assert [row["absent"] for row in content["frames"]] == [0] * 4
    assert content["frames"][0]["triangles"] > 0
    assert content["totals"]["absent_frames"] == content["totals"]["most_absent"] == 0


@pytest.mark.usefixtures("_slow")
def test_frames_without_what_had_not_arrived_are_counted_and_told(
    rooms: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(headless, "BASE_TIME", 0.0)
    write_path(tmp_path / "p.json", walk_along(3))
    arguments = [store_path(rooms), "--headless", "--json", "--path", str(tmp_path / "p.json"), "--size", "64x36"]
    done = CliRunner().invoke(commands.play, [*map(str, arguments), "--no-wait", "--report", str(tmp_path / "r.json")])
    assert done.exit_code == 0
    content = json.loads((tmp_path / "r.json").read_text())
    absent = [row["absent"] for row in content["frames"]]
    frames, most = content["totals"]["absent_frames"], content["totals"]["most_absent"]
    assert (frames, most) == (sum(n > 0 for n in absent), max(absent))
    assert frames > 0
    assert f"{frames} of 3 frames lack up to {most} nodes that had not arrived" in done.stderr


def test_a_silent_server_does_not_hold_the_first_frame_up_for_long(
    server: UnsteadyServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(headless, "BASE_TIME", 0.1)
    model = shown_model(open_store(server.url))
    server.become("silent")
    began = time.monotonic()
    totals = play(model, walk_along(2), SCREEN, Settings(wait=False)).content["totals"]
    assert time.monotonic() - began < 10
    assert totals["absent_frames"] == 2
    server.become("well")
