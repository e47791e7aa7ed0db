"""Builds of real models: the same bytes on every executor, and no input that ends in a traceback or half a store."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from storage import open_store

pytestmark = pytest.mark.slow

VLOD = [sys.executable, "-c", "from storage.cli.command import main; main()"]
DIRTY = ["busted.STL", "capsule.obj", "chair_model.obj", "cycloidal.ply", "gazebo_cafe.dae", "nancolor.obj"]


def build(model, store, *options):
    command = [*VLOD, "build", str(model), str(store), *map(str, options)]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=900)


def shards(store):
    return {path.name: path.read_bytes() for path in (store / "shards").iterdir()}


def test_executors_and_numbers_of_workers_write_the_same_shards(real_model, tmp_path):
    model = real_model("mid_hospital/hospital_three_floors.glb")
    # Some rooms of the ground floor: every stage has several tasks, and cells come in more than one wave.
    region = ["--region", "-4", "0.5", "-6", "8", "2.5", "8"]
    options = ["--triangles-per-cell", "30000", "--max-depth", "4", *region]
    ways = {
        "serial": ["--executor", "serial"],
        "ray1": ["--executor", "ray", "--workers", "1"],
        "ray2": ["--executor", "ray", "--workers", "2"],
    }
    found = {}
    for name, way in ways.items():
        done = build(model, tmp_path / name, *options, *way)
        assert done.returncode == 0, done.stderr
        found[name] = {**shards(tmp_path / name), "manifest": (tmp_path / name / "manifest.json").read_bytes()}
    assert len(open_store(tmp_path / "serial").cells) > 10
    assert found["ray1"] == found["serial"]
    assert found["ray2"] == found["serial"]


@pytest.mark.parametrize("name", DIRTY)
def test_a_dirty_model_is_built_or_refused_in_one_line(real_model, tmp_path, name):
    report = tmp_path / "report.json"
    done = build(real_model(f"dirty/{name}"), tmp_path / "store", "--max-depth", "1", "--report", report)
    assert "Traceback" not in done.stderr
    if done.returncode == 0:
        store = open_store(tmp_path / "store")
        assert list(store.check()) == []
        assert json.loads(report.read_text())["model"]["triangles"] > 0
    else:
        assert done.returncode == 2, done.stderr
        said = [line for line in done.stderr.splitlines() if not line.endswith(" s)")]
        assert len(said) == 1, done.stderr
        assert name in said[0]
        assert not (tmp_path / "store" / "manifest.json").exists()
