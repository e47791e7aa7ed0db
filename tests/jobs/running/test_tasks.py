"""Keys of tasks, and what publishing a result promises."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import math
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import jobs.running.tasks
from jobs.running.errors import CodeMismatchError, WorkInUseError
from jobs.running.lock import LOCK
from jobs.running.tasks import RECORD, Stage, Task, content_key, find_finished, run_task
from jobs.running.workplace import Workplace
from tests.cluster.toy_stages import SLOW, SQUARE, square_task

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=10,
)
payloads = st.dictionaries(st.text(), json_values, max_size=5)


@given(payloads, st.randoms())
def test_a_key_does_not_depend_on_the_order_of_names(payload, random):
    names = list(payload)
    random.shuffle(names)
    assert Task(SQUARE, payload).key == Task(SQUARE, {name: payload[name] for name in names}).key


@given(payloads, payloads)
def test_different_payloads_have_different_keys(one, other):
    same = json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
    assert (Task(SQUARE, one).key == Task(SQUARE, other).key) == same


@given(payloads)
def test_a_key_survives_json(payload):
    assert Task(SQUARE, payload).key == Task(SQUARE, json.loads(json.dumps(payload))).key


def test_places_and_memory_do_not_change_the_key_but_stage_and_code_do(tmp_path):
    key = Task(SQUARE, {"a": 1}).key
    assert Task(SQUARE, {"a": 1}, {"where": "elsewhere"}, memory=7).key == key
    assert Task(SLOW, {"a": 1}).key != key
    assert Task(dataclasses.replace(SQUARE, code=("jobs.running.tasks",)), {"a": 1}).key != key
    assert Task(dataclasses.replace(SQUARE, distributions=("numpy",)), {"a": 1}).key != key


def test_a_worker_with_other_code_refuses(place, tmp_path, monkeypatch):
    task = square_task(3, log=str(tmp_path / "log"))
    assert task.key
    monkeypatch.setattr(jobs.running.tasks, "_version", lambda code, distributions: "other")
    with pytest.raises(CodeMismatchError, match="same on all machines"):
        run_task(task, place)
    assert not (tmp_path / "log").exists()


@pytest.mark.parametrize("value", [math.nan, math.inf, {1, 2}, b"bytes", object()])
def test_what_is_not_json_has_no_key(value):
    with pytest.raises((TypeError, ValueError)):
        content_key(value)


@pytest.fixture
def place(tmp_path):
    (tmp_path / "shards").mkdir()
    return Workplace(tmp_path / "work", tmp_path)


def test_a_result_is_whole_or_absent(place, tmp_path):
    task = square_task(3, log=str(tmp_path / "log"))
    assert find_finished(task, place) is None
    run_task(task, place)
    folder = place.result("square", task.key)
    assert {path.name for path in folder.iterdir()} == {"square.txt", RECORD}
    (folder / RECORD).write_text('{"record"')
    assert find_finished(task, place) is None
    assert not run_task(task, place).reused
    assert run_task(task, place).reused


def test_a_result_whose_shard_is_gone_is_not_finished(place, tmp_path):
    task = square_task(3, log=str(tmp_path / "log"))
    run_task(task, place)
    record = place.result("square", task.key) / RECORD
    saved = json.loads(record.read_text())
    saved["record"]["shards"] = [["abc", 5]]
    record.write_text(json.dumps(saved))
    assert find_finished(task, place) is None
    (tmp_path / "shards" / "abc").write_text("12345")
    assert find_finished(task, place) is not None
    (tmp_path / "shards" / "abc").write_text("123")
    assert find_finished(task, place) is None


def test_the_second_of_two_writers_takes_the_firsts_result(place):
    first, second = place.new_temporary("stage"), place.new_temporary("stage")
    (first / "a").write_text("first")
    (second / "a").write_text("second")
    for made in (first, second):
        place.publish(made, "stage", "k" * 32, lambda folder: (folder / "a").exists())
    final = place.result("stage", "k" * 32)
    assert (final / "a").read_text() == "first"
    assert [path.name for path in final.parent.iterdir()] == [final.name]


def test_what_is_no_result_makes_room(place):
    final = place.result("stage", "k" * 32)
    final.mkdir(parents=True)
    (final / "b").write_text("half")
    made = place.new_temporary("stage")
    (made / "a").write_text("whole")
    place.publish(made, "stage", final.name, lambda folder: (folder / "a").exists())
    assert [path.name for path in final.iterdir()] == ["a"]
    assert [path.name for path in final.parent.iterdir()] == [final.name]


def test_a_result_that_comes_between_the_last_look_and_the_move_goes_back(place):
    """A writer finds what is no result; before it moves that aside, another has put a whole one in its place."""
    final = place.result("stage", "k" * 32)
    final.mkdir(parents=True)
    (final / "half").touch()
    made = place.new_temporary("stage")
    (made / "mine").touch()
    looks = []

    def usable(folder):
        looks.append(folder)
        if len(looks) > 1:
            return (folder / "others").exists()
        (final / "half").unlink()
        (final / "others").touch()
        return False

    place.publish(made, "stage", final.name, usable)
    assert [path.name for path in final.iterdir()] == ["others"]
    assert [path.name for path in final.parent.iterdir()] == [final.name]


@pytest.mark.parametrize("unusable", [False, True])
@pytest.mark.parametrize("workers", [2, 5])
def test_workers_of_one_key_lose_nothing(place, tmp_path, monkeypatch, unusable, workers):
    """All begin before any has published; then they publish as they come."""
    log = tmp_path / "log"
    task = square_task(3, log=str(log))
    folder = place.result("square", task.key)
    if unusable:
        folder.mkdir(parents=True)
        (folder / RECORD).write_text('{"record"')
    together = threading.Barrier(workers)
    work = task.stage.load()

    def begun(assignment):
        record = work(assignment)
        together.wait(timeout=30)
        return {**record, "worker": threading.get_ident()}  # unlike real work: to tell whose result it is

    monkeypatch.setattr(Stage, "load", lambda _: begun)
    with ThreadPoolExecutor(workers) as pool:
        results = list(pool.map(lambda _: run_task(task, place), range(workers)))
    finished = find_finished(task, place)
    assert finished is not None
    assert all(result.record == finished.record for result in results)
    assert not any(result.reused for result in results)
    assert len(log.read_text().splitlines()) == workers
    assert {path.name for path in folder.iterdir()} == {"square.txt", RECORD}
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]


@pytest.mark.parametrize("unusable", [False, True])
def test_what_another_worker_finished_after_the_look_stays(place, tmp_path, monkeypatch, unusable):
    task = square_task(3, log=str(tmp_path / "log"))
    folder = place.result("square", task.key)
    if unusable:
        folder.mkdir(parents=True)
        (folder / RECORD).write_text('{"record"')

    def meanwhile(_task):
        monkeypatch.undo()
        run_task(task, place)
        (folder / "others").touch()

    monkeypatch.setattr(Task, "check_code", meanwhile)  # between the look and all else
    assert run_task(task, place).record == {"square": 9}
    assert {path.name for path in folder.iterdir()} == {"square.txt", RECORD, "others"}


def test_a_finished_result_is_never_away_while_another_worker_publishes(place, tmp_path):
    """What was handed to followers stays readable, whatever a second worker of the same key does."""
    task = square_task(3, log=str(tmp_path / "log"))
    gone = []
    done = threading.Event()
    temporary = []
    for _ in range(200):
        made = place.new_temporary("square")
        (made / RECORD).write_text("{}")
        temporary.append(made)
    run_task(task, place)
    record = place.result("square", task.key) / RECORD

    def watch():
        while not done.is_set():
            if not record.exists():
                gone.append(True)

    watcher = threading.Thread(target=watch)
    watcher.start()
    for made in temporary:
        place.publish(made, "square", task.key, lambda folder: (folder / "square.txt").exists())
    done.set()
    watcher.join()
    assert not gone


def test_leftovers_of_the_dead_are_removed_and_those_of_the_living_stay(place):
    mine = place.new_temporary("stage")
    child = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    dead = mine.with_name(mine.name.replace(f"-{os.getpid()}-", f"-{int(child.stdout)}-"))
    dead.mkdir()
    foreign = mine.with_name(".tmp-some-other-host-1-0abc")
    foreign.mkdir()
    old = mine.with_name(".tmp-some-other-host-2-0abc")
    old.mkdir()
    os.utime(old, (0, 0))
    shards = place.store / "shards"
    shards.mkdir(parents=True, exist_ok=True)
    (shards / dead.name).write_bytes(b"half a shard")
    (shards / mine.name).write_bytes(b"half a shard")
    (shards / "0123456789abcdef").write_bytes(b"a shard")
    assert place.clean() == 3
    assert {path.name for path in mine.parent.iterdir()} == {mine.name, foreign.name}
    assert {path.name for path in shards.iterdir()} == {mine.name, "0123456789abcdef"}


def test_one_build_at_a_time(place):
    with place.locked():
        other = f"""
from pathlib import Path
from jobs.running.workplace import Workplace
import jobs.running.tasks
from jobs.running.errors import CodeMismatchError, WorkInUseError
try:
    with Workplace(Path({str(place.work)!r}), Path({str(place.store)!r})).locked():
        print("in")
except WorkInUseError as error:
    print(error)
"""
        said = subprocess.run([sys.executable, "-c", other], capture_output=True, check=True, text=True).stdout
        assert f"process {os.getpid()} on " in said
    said = subprocess.run([sys.executable, "-c", other], capture_output=True, check=True, text=True).stdout
    assert said.strip() == "in"
    with place.locked():
        pass
    with place.locked(), pytest.raises(WorkInUseError, match="--work"), place.locked():
        pass
    assert not (place.work / LOCK).exists()
    assert not (place.store / LOCK).exists()


def test_one_build_at_a_time_in_a_store_whatever_their_work_directories(place, tmp_path):
    other = Workplace(tmp_path / "other", place.store)
    with place.locked():
        with (
            pytest.raises(WorkInUseError, match=f"{place.store} .*process {os.getpid()} on .*another place"),
            other.locked(),
        ):
            pass
        assert not (other.work / LOCK).exists()
        assert (place.store / LOCK).exists()
    with other.locked():
        pass
    assert not (place.store / LOCK).exists()
    same = Workplace(place.store, place.store)
    with same.locked(), pytest.raises(WorkInUseError), place.locked():
        pass


def test_what_a_killed_build_left_keeps_nobody_out(place):
    killed = f"""
import os, signal
from pathlib import Path
from jobs.running.workplace import Workplace
with Workplace(Path({str(place.work)!r}), Path({str(place.store)!r})).locked():
    os.kill(os.getpid(), signal.SIGKILL)
"""
    assert subprocess.run([sys.executable, "-c", killed], check=False).returncode == -signal.SIGKILL
    assert (place.store / LOCK).exists()
    with place.locked():
        pass
    assert not (place.store / LOCK).exists()
    assert not (place.work / LOCK).exists()


def test_a_lock_that_was_removed_meanwhile_keeps_nobody_out_and_lets_nobody_in(place, monkeypatch):
    """Two builds open the same file; the first ends, and removes it, before the second has it."""
    flock = fcntl.flock

    def removed_before(file, how):
        monkeypatch.setattr(fcntl, "flock", flock)
        (place.work / LOCK).unlink()
        flock(file, how)

    monkeypatch.setattr(fcntl, "flock", removed_before)
    with place.locked(), pytest.raises(WorkInUseError), place.locked():
        pass


def test_what_a_build_made_goes_with_it_unless_something_was_finished(tmp_path):
    place = Workplace(tmp_path / "far" / "work", tmp_path / "deep" / "store")
    with place.made(), place.locked(), place.cleaned():
        place.new_temporary("stage").rmdir()
    assert not any(tmp_path.iterdir())
    with place.made(), place.locked(), place.cleaned():
        place.publish(place.new_temporary("stage"), "stage", "k" * 32, Path.is_dir)
    assert [path.name for path in tmp_path.iterdir()] == ["far"]
    assert [path.name for path in place.work.iterdir()] == ["stage"]
