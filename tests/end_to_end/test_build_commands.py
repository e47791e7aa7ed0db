"""The chain by its commands: build, look, verify, damage, verify."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.jobs.tiny_model import write_rooms

pytestmark = pytest.mark.slow

VLOD = [sys.executable, "-c", "from storage.command import main; main()"]


def vlod(*arguments):
    return subprocess.run([*VLOD, *map(str, arguments)], check=False, capture_output=True, text=True, timeout=300)


def said(done):
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commands")
    model = write_rooms(folder / "rooms.obj", rooms=2)
    options = ["--triangles-per-cell", 150, "--max-depth", 2, "--executor", "serial", "--work", folder / "work"]
    report = said(vlod("build", model, folder / "rooms.store", *options, "--json"))
    assert report["tasks_run"] > 0
    assert report["executor"] == "serial"
    return folder / "rooms.store"


def test_a_store_needs_no_work_directory(store):
    assert {path.name for path in store.iterdir()} == {"manifest.json", "shards", "versions"}


def test_info_and_verify_agree_on_the_store(store):
    found = said(vlod("verify", store, "--cells", 5, "--samples", 200, "--json"))
    assert found["ok"]
    assert found["missed"] == 0
    assert found["sampled_cells"] == 5
    assert found["rays"] >= 1000
    assert vlod("info", store).returncode == 0


def test_a_budget_holds_and_info_lists_what_it_cost(store, tmp_path):
    free = said(vlod("info", store, "--json"))["cells"]
    assert free["raised"] == []
    most = free["largest_triangles"] // 2
    options = ["--triangles-per-cell", 150, "--max-depth", 2, "--max-triangles", most, "--quality", "high"]
    model = store.parent / "rooms.obj"
    said(vlod("build", model, tmp_path / "s", *options, "--executor", "serial", "--json"))
    facts = said(vlod("info", tmp_path / "s", "--json"))
    assert facts["parameters"]["max_triangles"] == most
    assert facts["parameters"]["quality"] == "high"
    assert facts["cells"]["largest_triangles"] <= most
    assert facts["cells"]["raised"]
    assert all(row["pixel_error"] > 1 and row["reported_triangles"] <= most for row in facts["cells"]["raised"])
    assert "to keep --max-triangles" in vlod("info", tmp_path / "s").stdout
    assert said(vlod("verify", tmp_path / "s", "--cells", 20, "--samples", 200, "--json"))["ok"]


def test_verify_prints_a_table(store):
    done = vlod("verify", store, "--cells", 2, "--samples", 50)
    assert done.returncode == 0
    assert "missed drawables" in done.stdout
    assert done.stdout.rstrip().endswith("sound")


def test_verify_names_the_shard_with_a_flipped_byte_and_fails(store, tmp_path):
    victim = max((store / "shards").iterdir(), key=lambda path: path.stat().st_size)
    whole = victim.read_bytes()
    try:
        victim.write_bytes(whole[:100] + bytes([whole[100] ^ 4]) + whole[101:])
        done = vlod("verify", store, "--cells", 1, "--samples", 10)
        assert done.returncode == 1
        assert victim.name in done.stdout.replace("\n", "")
    finally:
        victim.write_bytes(whole)


def test_a_demo_scene_says_what_it_is(tmp_path):
    scene = said(vlod("demo-scene", "offices", tmp_path / "o.glb", "--triangles", 20000, "--seed", 3, "--json"))
    assert abs(scene["triangles"] - 20000) <= 600
    assert (tmp_path / "o.glb").stat().st_size == scene["bytes"]
    again = vlod("demo-scene", "offices", tmp_path / "p.glb", "--triangles", 20000, "--seed", 3)
    assert again.returncode == 0
    assert (tmp_path / "p.glb").read_bytes() == (tmp_path / "o.glb").read_bytes()


def test_a_report_needs_reports(tmp_path):
    done = vlod("report", tmp_path)
    assert done.returncode == 2
    assert "build.json" in done.stderr
