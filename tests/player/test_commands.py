"""The commands as a user types them: exit codes, one-line errors, files."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from player import commands
from player.camera.path import read_path, write_path
from player.tour import survey
from storage.base import compiling
from storage.geometry_reader import Geometry
from storage.store import Store
from tests.player.conftest import store_path
from tests.player.shells.test_headless import walk_along
from tests.storage.tiny_store import make_store, room_parts

VLOD = Path(sys.executable).with_name("vlod")


def vlod(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs `vlod` without a display."""
    base = {"PATH": "/usr/bin:/bin", "HOME": "/tmp", "PYTHONPATH": str(Path(__file__).parents[2]), **environment}
    return subprocess.run(
        [str(VLOD), *map(str, arguments)], capture_output=True, text=True, check=False, env=base, timeout=300
    )


@pytest.mark.parametrize("command", ["play", "path"])
def test_help_shows_an_example(command: str) -> None:
    done = vlod(command, "--help")
    assert done.returncode == 0
    assert "Example" in done.stdout


def test_a_first_run_says_that_it_compiles(room: Store, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    plain = survey.survey

    def compiles_first(*arguments: object) -> object:
        for _ in range(3):
            compiling.announce(True)
            compiling.announce(False)
        return plain(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(survey, "survey", compiles_first)
    monkeypatch.setattr(compiling, "LONG", 0.0)
    arguments = [str(store_path(room)), "-o", str(tmp_path / "tour.json")]
    for _ in range(2):
        done = CliRunner().invoke(commands.path, arguments, catch_exceptions=False)
        assert done.exit_code == 0
        assert done.stderr.count(f"{compiling.notice('a minute')}\n") == 1
        compiling.announce(True)  # nobody hears it any more


def test_a_tour_is_made_and_rendered(room: Store, tmp_path: Path, context: object) -> None:
    store, tour = store_path(room), tmp_path / "tour.json"
    done = vlod("path", store, "-o", tour, "--frames", 5)
    assert done.returncode == 0, done.stderr
    assert "5 poses" in done.stdout
    assert len(read_path(tour)) == 5
    done = vlod(
        "play", store, "--headless", "--path", tour, "--frames", tmp_path / "frames", "--report", tmp_path / "r.json",
        "--size", "64x36", "--compare", "none", "--strategy", "vlod",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "passed; no hole; at most 0.000 % of a frame's pixels differ; the worst is frame " in done.stdout
    assert ": see worst_difference.png among the frames" in done.stdout
    assert len(list((tmp_path / "frames").glob("frame_*.png"))) == 5
    content = json.loads((tmp_path / "r.json").read_text())
    assert content["screen"]["field_of_view"] == room.manifest.parameters["field_of_view"]
    done = vlod("play", store, "--headless", "--path", tour, "--json", "--size", "64x36", "--fps", "50", "--gl33")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["totals"]["frames"] == 9


def test_holes_are_told_with_their_part_and_the_worst_frame(tmp_path: Path, context: object) -> None:
    def visible(geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        return cut[geometry.drawables["lo"][cut, 0] < 7.9]  # not the east wall

    store, tour, report = tmp_path / "s", tmp_path / "tour.json", tmp_path / "r.json"
    make_store(store, room_parts(), depth=1, visible=visible)
    write_path(tour, walk_along(3))
    done = vlod("play", store, "--headless", "--path", tour, "--size", "64x36", "--compare", "none", "--report", report)
    assert done.returncode == 1
    content = json.loads(report.read_text())
    compared = content["compare"]
    holes = [row["compare"]["holes"] for row in content["frames"]]
    covered = sum(row["compare"]["covered"] for row in content["frames"])
    worst = content["frames"][compared["worst_frame"]]
    assert worst["compare"]["holes"] == max(holes) > 1
    x, y, z = worst["position"]
    assert (
        f"against the full model: FAILED; {sum(holes):,} hole pixels in {np.count_nonzero(holes)} of the frames, "
        f"{1e6 * sum(holes) / covered:.2f} in a million that it covers, of which 1 may be; at most "
    ) in done.stdout
    assert (
        f"differ; the worst is frame {worst['index']}, seen from ({x:.6g}, {y:.6g}, {z:.6g}) with {max(holes):,} of "
        "the hole pixels\n"
    ) in done.stdout


def test_a_tour_goes_to_standard_output(room: Store, tmp_path: Path) -> None:
    done = vlod("path", store_path(room), "--frames", 3)
    (tmp_path / "p.json").write_text(done.stdout)
    assert len(read_path(tmp_path / "p.json")) == 3


def test_without_a_display_headless_is_suggested(room: Store, tmp_path: Path) -> None:
    tour = tmp_path / "t.json"
    vlod("path", store_path(room), "-o", tour, "--frames", 2)
    done = vlod("play", store_path(room), "--path", tour)
    assert done.returncode == 2
    assert "there is no display" in done.stderr
    assert "--headless" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--headless"], "nothing to do"),
        (["--report", "r.json"], "--report needs --headless"),
        (["--headless", "--json", "--colours", "objects", "--compare", "none"], "leave --colours out"),
        (["--headless", "--json", "--size", "big"], "not a size"),
        (["--headless", "--json", "--size", "0x9"], "not a size"),
        (["--headless", "--json", "--cache", "lots"], "no amount of bytes"),
        (["--headless", "--json", "--strategy", "magic"], "magic"),
        (["--headless", "--json", "--path", "missing.json"], "missing.json: there is no such file"),
    ],
)
def test_wrong_usage_exits_with_2(room: Store, arguments: list[str], what: str) -> None:
    done = vlod("play", store_path(room), *arguments)
    assert done.returncode == 2
    assert what in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", ["play", "path"])
def test_what_is_not_a_store_is_said_in_one_line(command: str, tmp_path: Path) -> None:
    extra = ["--headless", "--json"] if command == "play" else []
    done = vlod(command, tmp_path, *extra)
    assert done.returncode == 2
    assert str(tmp_path) in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
