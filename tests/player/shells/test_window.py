"""The window under a virtual display, and the text over the picture."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import moderngl
import numpy as np
import pytest

from player.camera.controls import Camera
from player.camera.path import read_path, write_path
from player.renderer.target import Target
from player.renderer.text import Atlas, TextOverlay, layout
from storage.store import Store
from tests.player.conftest import store_path
from tests.player.shells.test_headless import walk_along


@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs a virtual display: apt-get install xvfb")
def test_the_window_is_steered(room: Store, tmp_path: Path) -> None:
    write_path(tmp_path / "tour.json", walk_along(4))
    script = Path(__file__).with_name("window_script.py")
    done = subprocess.run(
        ["xvfb-run", "-a", "-s", "-screen 0 640x480x24", sys.executable, str(script), str(store_path(room)),
         str(tmp_path / "tour.json"), str(tmp_path / "out")],
        capture_output=True, text=True, check=False, timeout=300,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["triangles"] > 0
    assert found["shown"] > 5
    assert Path(found["screenshot"]).stat().st_size > 500
    assert found["moved"] == pytest.approx(2 * 1.6 * 0.02 * 8, rel=0.01)
    assert found["turned"] == pytest.approx(0.16)
    assert found["faster"] == pytest.approx(1.2)
    assert found["recorded"] == 9
    assert len(read_path(tmp_path / "out" / "vlod_path_0001.json")) == 9
    assert found["replayed from"] < found["moved"]
    assert found["replayed to"] < 1e-9
    assert found["standing"] == pytest.approx(1.6, abs=0.05)
    assert 0.2 < found["at the wall"] < 0.6
    assert found["strategies"] == ["frustum", "none", "vlod"]
    assert found["coarser"] == 1.25
    assert found["colours"] == ["objects", "levels", "model"]
    assert found["closing"]


def test_flying_goes_where_one_looks_and_walking_stays_level() -> None:
    camera = Camera(np.zeros(3), yaw=0.0, pitch=0.5, up="z", speed=2.0, held={"forward"})
    assert np.allclose(camera.motion(0.5), [math.cos(0.5), 0, math.sin(0.5)])
    camera.walking = True
    assert np.allclose(camera.motion(0.5), [1, 0, 0])
    camera.held = {"right"}
    assert np.allclose(camera.motion(0.5), [0, -1, 0])
    camera.held = {"forward", "back"}
    assert not camera.motion(0.5).any()
    camera.held = {"up", "fast"}
    assert np.allclose(camera.motion(0.5), [0, 0, 4])


def test_a_pose_is_taken_over() -> None:
    for up in ("x", "y", "z"):
        one = Camera(np.array([1.0, 2, 3]), yaw=2.5, pitch=-0.4, up=up, speed=1)
        other = Camera(np.zeros(3), 0, 0, up, 1)
        other.look_at(one.position, one.orientation)
        assert np.allclose(other.position, one.position)
        assert (other.yaw, other.pitch) == pytest.approx((2.5, -0.4))


def test_one_cannot_look_over_the_top() -> None:
    camera = Camera(np.zeros(3), 0, 0, "y", 1)
    camera.turn(0, 10)
    assert camera.pitch < math.pi / 2


def test_standing_follows_the_floor() -> None:
    camera = Camera(np.array([0.0, 0, 5]), 0, 0, "z", 1)
    for _ in range(100):
        camera.stand(camera.position[2], 1.6, 0.05)
    assert camera.position[2] == pytest.approx(1.6, abs=1e-3)
    camera.stand(math.inf, 1.6, 0.05)
    assert camera.position[2] == pytest.approx(1.6, abs=1e-3)


def test_letters_lie_on_the_panel_and_unknown_ones_are_replaced() -> None:
    atlas = Atlas(14)
    vertices = layout(atlas, [("frames/s", "12"), ("☃", "")], (300, 200), "top left")
    panel = vertices[:6, :2]
    assert (vertices[:, :2] >= panel.min(axis=0)).all()
    assert (vertices[:, :2] <= panel.max(axis=0)).all()
    assert len(vertices) == 6 * (1 + len("frames/s12") + 1)


def test_text_is_drawn_where_it_belongs(context: moderngl.Context) -> None:
    target = Target(context, (200, 100), samples=0, reversed_depth=False)
    overlay = TextOverlay(context)
    target.framebuffer.use()
    target.framebuffer.clear()
    overlay.draw([("hello", "world")], target.framebuffer, target.size, "bottom right")
    picture = target.read()
    overlay.release()
    target.release()
    assert not picture[:40].any()
    assert not picture[:, :20].any()
    assert picture[50:, 100:, :3].max() > 200
