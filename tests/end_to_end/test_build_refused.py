"""What a build refuses: one clear line, exit code 2, and nothing that could be taken for a store."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys

import pytest

from storage.base.compiling import notice
from tests.jobs.tiny_model import write_rooms

VLOD = [sys.executable, "-c", "from storage.cli.command import main; main()"]


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return write_rooms(tmp_path_factory.mktemp("model") / "rooms.obj", rooms=2)


def refused(*arguments):
    """What a command says that ends with exit code 2: one line."""
    done = subprocess.run([*VLOD, *map(str, arguments)], check=False, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2, done.stderr
    lines = done.stderr.splitlines()
    # Lines of finished steps, and of compiling on a machine's first run, may stand before it.
    said = [line for line in lines if not line.endswith(" s)") and notice("a few minutes") not in line]
    assert len(said) == 1, done.stderr
    assert said[0].startswith("error: ")
    return said[0]


@contextlib.contextmanager
def mounted(path, options):
    """A file system in memory at `path`; skips the test where this user may not mount one."""
    path.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(path)]
    if os.geteuid() != 0 or subprocess.run(command, check=False, capture_output=True).returncode != 0:
        pytest.skip("mounting a small file system needs root")
    try:
        yield path
    finally:
        subprocess.run(["umount", "-l", str(path)], check=True)


def test_a_missing_model(tmp_path):
    assert "absent.glb" in refused("build", tmp_path / "absent.glb", tmp_path / "deep" / "store")
    assert not (tmp_path / "deep").exists()


def test_a_missing_model_beside_what_is_the_users(tmp_path):
    (tmp_path / "store").mkdir()
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "mine").write_text("mine")
    refused("build", tmp_path / "absent.glb", tmp_path / "store", "--work", tmp_path / "work")
    assert not any((tmp_path / "store").iterdir())
    assert [path.name for path in (tmp_path / "work").iterdir()] == ["mine"]


@pytest.mark.parametrize(("name", "cure"), [("rooms.obj", "rooms.obj STORE`"), ("rooms.store", "rooms.store`")])
def test_one_name_where_two_are_needed(tmp_path, name, cure):
    (tmp_path / "rooms.obj").write_text("")
    done = subprocess.run(
        [*VLOD, "build", str(tmp_path / name)], check=False, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith(cure)
    assert [path.name for path in tmp_path.iterdir()] == ["rooms.obj"]


def test_a_file_that_is_no_model(tmp_path):
    (tmp_path / "notes.obj").write_text("shopping list\n")
    assert "notes.obj" in refused("build", tmp_path / "notes.obj", tmp_path / "store")
    (tmp_path / "noise.glb").write_bytes(bytes(range(256)) * 9)
    assert "noise.glb" in refused("build", tmp_path / "noise.glb", tmp_path / "store")
    assert not (tmp_path / "store").exists()


def test_too_little_memory_names_what_suffices(model, tmp_path):
    said = refused("build", model, tmp_path / "store", "--memory", "100MB")
    assert "import" in said
    assert "--memory 2" in said
    assert "lots" in refused("build", model, tmp_path / "store", "--memory", "lots")


def test_a_budget_below_the_coarsest_model(model, tmp_path):
    said = refused("build", model, tmp_path / "store", "--executor", "serial", "--max-triangles", "1")
    assert "no cell can report as few as 1 triangles" in said
    assert "allow --max-triangles " in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--seal", "0"], "distance to seal must be positive, not 0"),
        (["--seal", "-0.5"], "distance to seal must be positive, not -0.5"),
        (["--seal", "nan"], "distance to seal must be positive, not nan"),
        (["--seal", "0.1", "--sampled"], "use one of the two"),
        (["--seal", "0.1", "--visibility-engine", "shrunk-occluders"], "--visibility-engine flooded-occluders"),
    ],
)
def test_distances_that_seal_nothing_and_options_that_do_not_go_with_them(model, tmp_path, options, words):
    assert words in refused("build", model, tmp_path / "store", *options)
    assert not (tmp_path / "store").exists()


def test_a_folder_without_models(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "readme.txt").write_text("nothing here")
    assert "folder" in refused("build", tmp_path / "folder", tmp_path / "store")


@pytest.mark.parametrize(
    "options",
    [
        ["--max-depth", "77"],
        ["--view-box", "0", "0", "0", "0", "0", "0"],
        ["--pixel-error", "0"],
        ["--triangles-per-cell", "-5"],
        ["--max-triangles", "0"],
        ["--field-of-view", "180"],
        ["--executor", "serial", "--workers", "3"],
    ],
    ids=lambda options: options[0],
)
def test_parameters_out_of_range(model, tmp_path, options):
    refused("build", model, tmp_path / "store", *options)
    assert not (tmp_path / "store" / "manifest.json").exists()


@pytest.mark.parametrize("address", ["127.0.0.1:1", "no-such-host.invalid:6379", "nonsense", "ray://127.0.0.1:1"])
def test_an_address_where_no_cluster_is(model, tmp_path, address):
    assert address in refused("build", model, tmp_path / "store", "--ray-address", address)


def test_a_store_that_is_a_file(model, tmp_path):
    (tmp_path / "store").write_text("mine")
    assert "is a file" in refused("build", model, tmp_path / "store", "--executor", "serial")


def test_a_read_only_place(model, tmp_path):
    with mounted(tmp_path / "disk", "ro,size=1m") as disk:
        assert "store" in refused("build", model, disk / "store", "--executor", "serial")


def test_a_place_without_permission(model, tmp_path):
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    (tmp_path / "locked").mkdir(mode=0o500)
    assert "ermission" in refused("build", model, tmp_path / "locked" / "store", "--executor", "serial")


@pytest.mark.slow
@pytest.mark.parametrize("kilobytes", [16, 60, 120])
def test_a_full_disk(model, tmp_path, kilobytes):
    with mounted(tmp_path / "disk", f"size={kilobytes}k") as disk:
        said = refused("build", model, disk / "store", "--executor", "serial", "--triangles-per-cell", "150")
        assert "No space left" in said
        assert not (disk / "store" / "manifest.json").exists()
        info = subprocess.run([*VLOD, "info", str(disk / "store")], check=False, capture_output=True, text=True)
        assert info.returncode == 2
        assert len(info.stderr.splitlines()) == 1
