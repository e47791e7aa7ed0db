"""How many tasks there will be is guessed, and the guess becomes the truth."""

from __future__ import annotations

from collections import deque

import pytest

from jobs.running.run import FOLLOWERS, Expected
from jobs.running.tasks import Task
from tests.cluster.toy_stages import square_task


def waves_after(task: Task) -> int:
    return int(task.payload["number"])


def tasks(waves: int, count: int) -> list[Task]:
    return [square_task(waves) for _ in range(count)]


def test_what_nothing_follows_from_is_what_is_known():
    expected = Expected(waves_after)
    assert expected.total == 0
    expected.begin(tasks(0, 7))
    assert expected.total == 7
    expected.finish(tasks(0, 1)[0], 0)
    assert expected.total == 7


def test_before_any_is_done_each_task_counts_with_what_may_follow():
    expected = Expected(waves_after)
    expected.begin(tasks(2, 1))
    assert expected.total == 1 + FOLLOWERS + FOLLOWERS**2


def test_tasks_are_expected_to_have_as_many_followers_as_those_before():
    expected = Expected(waves_after)
    (first,) = tasks(2, 1)
    expected.begin([first])
    expected.begin(tasks(1, 5))
    expected.finish(first, 5)
    assert expected.total == 6 + 5 * 5
    one, *_ = tasks(1, 1)
    expected.begin(tasks(0, 3))
    expected.finish(one, 3)  # the first of its own wave to be done
    assert expected.total == 9 + 4 * 3


@pytest.mark.parametrize("each", [1, 3, 8])
def test_even_waves_are_foretold_once_one_is_done(each: int):
    expected = Expected(waves_after)
    waiting = deque(tasks(3, 1))
    expected.begin(waiting)
    told = []
    while waiting:
        task = waiting.popleft()
        followers = tasks(waves_after(task) - 1, each) if waves_after(task) else []
        expected.begin(followers)
        expected.finish(task, len(followers))
        waiting.extend(followers)
        told.append(expected.total)
    assert set(told) == {1 + each + each**2 + each**3} == {len(told)}
