"""The window under a virtual display."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from player.camera.path import read_path, write_path
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
