"""Kernels run without checks of their indices: here they are compiled once more with checks, and given nasty input."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

SCRIPT = """
import tempfile
from pathlib import Path

import numpy as np
from numba import config

import storage
from tests.jobs.nasty_models import built_of, nasty_model
from tests.jobs.visibility.nasty import misses, nasty_scene

assert config.BOUNDSCHECK == 1
assert Path(storage.__file__).is_relative_to(Path.cwd())
for number in range(100):
    with tempfile.TemporaryDirectory() as folder:
        built_of(nasty_model(np.random.default_rng([78, number])), Path(folder))
for number in range(300):
    assert misses(nasty_scene(np.random.default_rng([79, number])), 100, number) == [], f"scene {number}"
"""


@pytest.mark.slow
def test_no_kernel_leaves_its_arrays(tmp_path: Path) -> None:
    for package in ("jobs", "player", "storage", "tests"):  # compiled code is kept beside the sources
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
