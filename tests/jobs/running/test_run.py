"""Stages as they run: results in order, each task once."""

from __future__ import annotations

import pytest

from jobs.running.errors import MemoryLimitError
from jobs.running.executors import SerialExecutor
from jobs.running.memory import MemoryWatch
from jobs.running.run import Run
from jobs.running.tasks import Task
from jobs.running.workplace import Workplace
from storage.base.progress import Silent
from tests.cluster.toy_stages import SQUARE, square_task


@pytest.fixture
def run(tmp_path):
    (tmp_path / "shards").mkdir()
    with MemoryWatch() as watch:
        yield Run(Workplace(tmp_path / "work", tmp_path), SerialExecutor(), Silent(), watch)


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log"
    path.touch()
    return path


def test_tasks_of_one_key_run_once_and_each_gets_the_result(run, log):
    numbers = [3, 1, 3, 2, 1]
    results = run.all(SQUARE, [square_task(number, log=str(log)) for number in numbers])
    assert [result.record["square"] for result in results] == [9, 1, 9, 4, 1]
    assert len(log.read_text().splitlines()) == 3
    assert run.reports[0].run == 3


def test_what_follows_comes_behind_by_key_and_once(run, log):
    def follow(result):
        number = result.task.payload["number"]
        return [square_task(number // 2, log=str(log)), square_task(number, log=str(log))] if number else []

    results = run.all(SQUARE, [square_task(4, log=str(log)), square_task(5, log=str(log))], follow)
    assert [result.record["square"] for result in results[:2]] == [16, 25]
    followed = [result.task for result in results[2:]]
    assert sorted(task.payload["number"] for task in followed) == [0, 1, 2]
    assert [task.key for task in followed] == sorted(task.key for task in followed)
    assert len(log.read_text().splitlines()) == 5


def test_a_follower_that_needs_too_much_is_refused(run, log):
    with pytest.raises(MemoryLimitError, match=r"'square' needs about 1024GiB"):
        run.all(SQUARE, [square_task(1, log=str(log))], lambda _: [Task(SQUARE, {"number": 2}, memory=1 << 40)])
