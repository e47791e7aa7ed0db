"""What every executor promises: the same tests over the one in this process and Ray."""

from __future__ import annotations

import contextlib
import itertools
import time

import pytest

from jobs.running.choose_executor import choose_executor
from jobs.running.errors import MemoryLimitError, WorkerLostError
from jobs.running.executors import GrowingExecutor, SerialExecutor
from jobs.running.ray_executor import ATTEMPTS, RayExecutor
from jobs.running.tasks import Task
from storage.base import compiling
from storage.base.errors import ModelError, ParameterError
from tests.cluster.toy_stages import COMPILING, LETHAL, SQUARE, WRONG, square_task


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log"
    path.touch()
    return path


def runs(log):
    return len(log.read_text().splitlines())


def test_every_task_gives_its_result_once(executor, place, log):
    tasks = [square_task(number, log=str(log)) for number in range(12)]
    results = list(executor.run(tasks, place))
    assert sorted(result.record["square"] for result in results) == [number * number for number in range(12)]
    assert runs(log) == 12
    assert not any(result.reused for result in results)
    for result in results:
        text = (place.result("square", result.key) / "square.txt").read_text()
        assert int(text) == result.record["square"]
        assert result.peak_memory > 1 << 20


def test_finished_tasks_do_not_run_again(executor, place, log):
    tasks = [square_task(number, log=str(log)) for number in range(5)]
    list(executor.run(tasks[:3], place))
    results = list(executor.run(tasks, place))
    assert runs(log) == 5
    assert sum(result.reused for result in results) == 3
    assert sorted(result.record["square"] for result in results) == [0, 1, 4, 9, 16]


def test_tasks_may_follow_from_results(executor, place, log):
    def parts(result):
        number = result.task.payload["number"]
        return (
            [square_task(number // 2, log=str(log)), square_task(number // 2 - 1, log=str(log))] if number > 2 else []
        )

    results = list(executor.run([square_task(9, log=str(log))], place, parts))
    # 9 gives 4 and 3; 4 gives 2 and 1; 3 gives 1 and 0.
    assert sorted(result.task.payload["number"] for result in results) == [0, 1, 1, 2, 3, 4, 9]


def test_tasks_are_read_only_as_far_ahead_as_needed(executor, place, log):
    taken = []

    def endless():
        for number in itertools.count():
            taken.append(number)
            yield square_task(number, log=str(log))

    with contextlib.closing(executor.run(endless(), place)) as results:
        for _ in range(3):
            next(results)
    assert len(taken) <= 3 + 2 * executor.workers + 2


def test_no_tasks(executor, place):
    assert list(executor.run([], place)) == []


@pytest.mark.parametrize(("bug", "kind"), [(False, ModelError), (True, ZeroDivisionError)])
def test_a_tasks_error_comes_as_it_is(executor, place, log, bug, kind):
    with pytest.raises(kind) as caught:
        list(executor.run([Task(WRONG, {"bug": bug}, memory=1 << 20)], place))
    assert "\n" not in str(caught.value)
    assert not place.result("wrong", Task(WRONG, {"bug": bug}).key).exists()
    assert list(place.work.glob("*/.tmp-*")) == []
    assert [result.record["square"] for result in executor.run([square_task(3, log=str(log))], place)] == [9]


@pytest.mark.slow
def test_a_killed_worker_is_replaced(ray_executor, place, log):
    tasks = [Task(LETHAL, {"deaths": 1}, {"log": str(log)}, 1 << 20), square_task(7, log=str(log))]
    results = {result.task.stage.name: result for result in ray_executor.run(tasks, place)}
    assert results["lethal"].record["runs"] == 2
    assert results["square"].record["square"] == 49
    assert place.clean() == 1


@pytest.mark.slow
def test_a_task_that_always_kills_its_worker_ends(ray_executor, place, log):
    with pytest.raises(WorkerLostError, match="lethal"):
        list(ray_executor.run([Task(LETHAL, {"deaths": 99}, {"log": str(log)}, 1 << 20)], place))
    assert runs(log) == ATTEMPTS


@pytest.mark.slow
def test_a_task_that_cannot_fit_is_refused(ray_executor, place):
    with pytest.raises(MemoryLimitError, match="square"):
        list(ray_executor.run([Task(SQUARE, {"number": 1}, memory=1 << 60)], place))


def test_ray_is_not_started_when_all_is_finished(place, log):
    task = square_task(2, log=str(log))
    list(SerialExecutor().run([task], place))
    executor = RayExecutor(address="nowhere:1")
    assert [result.reused for result in executor.run([task], place)] == [True]
    executor.close()


def test_long_work_is_handed_on(place, log):
    larger = SerialExecutor()
    larger.name, larger.workers = "larger", 7
    executor = GrowingExecutor(larger, patience=0.25)
    seen = []
    for number in range(5):
        task = square_task(number, log=str(log), seconds=0.1)
        results = list(executor.run([task], place, lambda result: [result.task] if len(seen) > 9 else []))
        seen.append((executor.name, executor.workers))
        assert [result.record["square"] for result in results] == [number * number]
    assert seen[0] == ("serial", 1)
    assert seen[-1] == ("larger", 7)
    assert seen == sorted(seen, key=lambda entry: entry[1])
    # what was finished before costs no patience
    executor = GrowingExecutor(larger, patience=1e-9)
    assert [result.reused for result in executor.run([square_task(1, log=str(log), seconds=0.1)], place)] == [True]
    assert executor.name == "serial"


def test_compiling_does_not_count_as_long_work(monkeypatch, place, log):
    """Workers would only compile the same once more, each of them."""
    whole = time.sleep

    def sleep(seconds):
        compiling.announce(True)
        whole(seconds)
        compiling.announce(False)

    monkeypatch.setattr("tests.cluster.toy_stages.time.sleep", sleep)
    executor = GrowingExecutor(SerialExecutor(), patience=10.0)
    list(executor.run([square_task(number, log=str(log), seconds=0.2) for number in range(5)], place))
    assert 9.5 < executor._patience < 10.0


@pytest.mark.slow
def test_that_workers_compile_is_heard_of(ray_executor, place):
    heard = []
    task = Task(COMPILING, {"turns": [compiling.LONG + 0.1, 4.0]}, {}, memory=50 << 20)
    with compiling.listening(heard.append):
        list(ray_executor.run([task], place))
    assert heard
    assert heard == [True, False] * (len(heard) // 2)
    assert not any((place.work / "compiling").iterdir())


@pytest.mark.slow
def test_what_follows_from_early_results_runs_after_the_handing_on(ray_executor, place, log):
    def next_one(result):
        number = result.task.payload["number"]
        return [square_task(number - 1, log=str(log), seconds=0.05)] if number > 0 else []

    executor = GrowingExecutor(ray_executor, patience=0.12)
    results = list(executor.run([square_task(6, log=str(log), seconds=0.05)], place, next_one))
    assert sorted(result.record["square"] for result in results) == [n * n for n in range(7)]
    assert executor.name == "ray"
    assert runs(log) == 7


def test_choosing_an_executor(monkeypatch):
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    assert choose_executor("serial", None, None, 1 << 40).name == "serial"
    assert choose_executor("auto", 2, None, 1000).name == "serial"
    assert isinstance(choose_executor("auto", 2, None, 1000), GrowingExecutor)
    assert choose_executor("auto", 2, None, 1 << 40).name == "ray"
    assert choose_executor("auto", 1, None, 1 << 40).name == "serial"
    assert choose_executor("auto", None, "host:6379", 0).name == "ray"
    assert choose_executor("ray", 3, None, 0).workers == 3
    monkeypatch.setenv("RAY_ADDRESS", "host:6379")
    assert choose_executor("auto", None, None, 0).name == "ray"
    with pytest.raises(ParameterError, match="serial"):
        choose_executor("serial", 4, None, 0)
