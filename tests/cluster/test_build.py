"""Whole builds on Ray: the same bytes as in one process, whatever the number of workers, and whatever dies."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest

from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from tests.jobs.glass_model import write_glass
from tests.jobs.tiny_model import write_rooms

pytestmark = pytest.mark.slow

PARAMETERS = BuildParameters(triangles_per_cell=150, max_depth=3, region=(0, 0, 0, 8, 3.5, 2))


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return write_rooms(tmp_path_factory.mktemp("model") / "rooms.obj", rooms=2)


@pytest.fixture(scope="module")
def serial(model, tmp_path_factory):
    return content(model, tmp_path_factory.mktemp("serial") / "store", SerialExecutor())


def content(model, store, executor):
    """Every shard and the manifest of a store that is built now."""
    build([model], store, PARAMETERS, executor)
    files = {path.name: path.read_bytes() for path in (store / "shards").iterdir()}
    return {**files, "manifest": (store / "manifest.json").read_bytes()}


def test_ray_writes_the_same_bytes(model, serial, ray_executor, tmp_path):
    assert content(model, tmp_path / "store", ray_executor) == serial


def test_ray_writes_the_same_bytes_of_what_can_be_seen_through(ray_executor, tmp_path):
    """Two trees, and tasks of both at once."""
    glass = write_glass(tmp_path / "glass.ply")
    serial = content(glass, tmp_path / "serial", SerialExecutor())
    assert content(glass, tmp_path / "store", ray_executor) == serial


def test_one_worker_writes_the_same_bytes_as_two(model, serial, ray_executor, tmp_path, monkeypatch):
    monkeypatch.setattr(ray_executor, "window", lambda: 1)
    assert content(model, tmp_path / "store", ray_executor) == serial


def test_killed_workers_do_not_change_a_byte(model, serial, ray_executor, tmp_path):
    stop = threading.Event()
    killed = []

    def kill_now_and_then():
        import psutil

        while not stop.wait(0.02) and len(killed) < 3:
            for process in psutil.Process().children(recursive=True):
                if process.name().startswith("ray::vlod"):
                    os.kill(process.pid, signal.SIGKILL)
                    killed.append(process.pid)
                    time.sleep(0.5)
                    break

    killer = threading.Thread(target=kill_now_and_then)
    killer.start()
    try:
        assert content(model, tmp_path / "store", ray_executor) == serial
    finally:
        stop.set()
        killer.join()
    assert killed
