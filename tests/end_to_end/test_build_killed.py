"""Builds that are killed or interrupted: what is finished stays, what follows is the same to the last byte."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from storage import open_store
from storage.base.errors import StoreNotFoundError
from tests.jobs.tiny_model import write_rooms

pytestmark = pytest.mark.slow

#: As started from a terminal: a shell's background jobs ignore interrupts, and what they start does too.
VLOD = [
    sys.executable,
    "-c",
    "from signal import *; signal(SIGINT, default_int_handler); from storage.cli.command import main; main()",
]
OPTIONS = ["--triangles-per-cell", "150", "--max-depth", "3", "--region", "0", "0", "0", "8", "3.5", "2"]
EXECUTORS = [["--executor", "serial"], ["--executor", "ray", "--workers", "2"]]


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return write_rooms(tmp_path_factory.mktemp("model") / "rooms.obj", rooms=2)


@pytest.fixture(scope="module")
def reference(model, tmp_path_factory):
    """Bytes of a store whose build nobody disturbed, and its report."""
    store = tmp_path_factory.mktemp("reference") / "store"
    report = run(model, store, "--executor", "serial")
    return content(store), report


def run(model, store, *options):
    """Builds, and returns the report."""
    path = store.parent / "report.json"
    command = [*VLOD, "build", str(model), str(store), *OPTIONS, *options, "--report", str(path)]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    return json.loads(path.read_text())


def content(store):
    files = {path.name: path.read_bytes() for path in (store / "shards").iterdir() if not path.name.startswith(".")}
    return {**files, "manifest": (store / "manifest.json").read_bytes()}


def finished(store):
    """Tasks whose results are published."""
    return len([path for path in (store / "work").glob("*/*/record.json") if not path.parent.name.startswith(".")])


def begin(model, store, options, least):
    """Starts a build and waits until `least` tasks are finished."""
    command = [*VLOD, "build", str(model), str(store), *OPTIONS, *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while finished(store) < least:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return process


class Reader:
    """Opens a store and reads all of its cells, again and again, on a thread."""

    def __init__(self, store):
        self.store, self.trouble, self.whole, self.absent = store, [], 0, 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()

    def _read(self):
        while not self._stop.is_set():
            try:
                store = open_store(self.store)
                for cell in range(len(store.cells)):
                    store.vlod(cell)
                store.mesh(0)
                self.whole += 1
            except StoreNotFoundError:
                self.absent += 1
            except Exception as error:
                self.trouble.append(repr(error))
            time.sleep(0.02)


@pytest.mark.parametrize("options", EXECUTORS, ids=["serial", "ray"])
def test_a_killed_build_goes_on_where_it_was(model, reference, options, tmp_path):
    store = tmp_path / "store"
    expected, undisturbed = reference
    with Reader(store) as reader:
        process = begin(model, store, options, 5)
        process.kill()
        process.communicate()
        before = finished(store)
        assert not (store / "manifest.json").exists()
        report = run(model, store, *options)
    assert reader.trouble == []
    assert reader.absent > 0
    # Workers of Ray outlive their driver for a moment, and may have finished a task that was not counted.
    assert before <= report["tasks_reused"] <= before + 2
    assert report["tasks_run"] + report["tasks_reused"] == undisturbed["tasks_run"]
    assert content(store) == expected
    assert list(store.rglob(".tmp-*")) == []


def test_a_store_stays_readable_while_its_next_version_is_killed(model, tmp_path):
    store = tmp_path / "store"
    run(model, store, "--executor", "serial", "--pixel-error", "2")
    old = (store / "manifest.json").read_bytes()
    with Reader(store) as reader:
        process = begin(model, store, ["--executor", "serial"], finished(store) + 3)
        process.kill()
        process.communicate()
        assert (store / "manifest.json").read_bytes() == old
        run(model, store, "--executor", "serial")
    assert reader.trouble == []
    assert reader.absent == 0
    assert reader.whole > 0
    assert open_store(store).manifest.version == 2


@pytest.mark.parametrize(
    ("options", "number"),
    [(EXECUTORS[0], signal.SIGINT), (EXECUTORS[1], signal.SIGINT), (EXECUTORS[1], signal.SIGTERM)],
    ids=["serial", "ray", "ray-terminated"],
)
def test_an_interrupt_ends_in_130_and_keeps_what_is_finished(model, reference, options, number, tmp_path):
    store = tmp_path / "store"
    process = begin(model, store, options, 4)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert said.splitlines()[-1] == "interrupted"
    assert "Traceback" not in said
    kept = finished(store)
    report = run(model, store, *options)
    assert report["tasks_reused"] == kept
    assert content(store) == reference[0]


def test_two_builds_into_one_store_do_not_both_write_its_next_version(model, reference, tmp_path):
    """Each has a work directory of its own: only the store keeps them apart. A killed one keeps nobody out."""
    store = tmp_path / "store"
    process = begin(model, store, ["--executor", "serial"], 2)
    other = [*OPTIONS, "--executor", "serial", "--work", str(tmp_path / "other")]
    try:
        command = [*VLOD, "build", str(model), str(store), *other]
        second = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
        assert second.returncode == 2
        assert len(second.stderr.splitlines()) == 1
        assert f"{store} is in use by another build (process {process.pid} " in second.stderr
        assert "another place" in second.stderr
        assert not (tmp_path / "other").exists()
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
    run(model, store, "--executor", "serial", "--work", str(tmp_path / "other"))
    assert content(store) == reference[0]
    assert {path.name for path in store.iterdir()} == {"manifest.json", "shards", "versions", "work"}


def test_the_second_build_in_a_work_directory_says_who_is_in_it(model, tmp_path):
    store = tmp_path / "store"
    process = begin(model, store, ["--executor", "serial"], 2)
    try:
        command = [*VLOD, "build", str(model), str(store), *OPTIONS, "--executor", "serial"]
        second = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
        assert second.returncode == 2
        assert len(second.stderr.splitlines()) == 1
        assert f"process {process.pid} " in second.stderr
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
