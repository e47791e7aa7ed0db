"""Keys of tasks, and what publishing a result promises."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import math
import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

import jobs.running.tasks
from jobs.running.errors import CodeMismatchError, WorkInUseError
from jobs.running.tasks import RECORD, Task, content_key, find_finished, run_task
from jobs.running.workplace import LOCK, Workplace
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
    place.publish(first, "stage", "k" * 32)
    final = place.publish(second, "stage", "k" * 32)
    assert (final / "a").read_text() == "first"
    assert not second.exists()


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
        place.publish(place.new_temporary("stage"), "stage", "k" * 32)
    assert [path.name for path in tmp_path.iterdir()] == ["far"]
    assert [path.name for path in place.work.iterdir()] == ["stage"]
