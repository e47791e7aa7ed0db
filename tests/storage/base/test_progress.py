"""What is told of long work."""

from __future__ import annotations

import re
import time
from io import StringIO

import pytest

from storage.base import compiling
from storage.base.progress import GUESS, Bars, Lines, progress_for, seconds_left, time_left


def test_a_line_for_each_finished_step():
    stream = StringIO()
    with progress_for(stream) as progress:
        assert isinstance(progress, Lines)
        progress.start("cells")
        progress.update(1, 2)
        progress.finish("2 tasks")
    assert stream.getvalue() == "cells: 2 tasks (0.0 s)\n"


def test_a_log_gets_a_line_every_now_and_then_with_the_time_left():
    stream = StringIO()
    with Lines(stream, every=0.05) as progress:
        progress.start("cells")
        progress.update(3, 40, 1)
        deadline = time.monotonic() + 20
        while stream.getvalue().count("\n") < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        progress.finish("40 tasks")
    *going, finished = stream.getvalue().splitlines()
    assert len(going) >= 2
    assert all(re.fullmatch(r"cells: 3 of about 40 after \d+ s, about \d+ s left", line) for line in going)
    assert finished.startswith("cells: 40 tasks")
    silent = len(stream.getvalue())
    time.sleep(0.2)
    assert len(stream.getvalue()) == silent


@pytest.mark.parametrize(
    ("seconds", "done", "total", "before", "left"),
    [
        (0, 0, 9, 0, 9 * GUESS),  # a guess
        (95, 9, 109, 0, 1000),  # 95 s and the guess of 5 for 9 and one
        (95, 1009, 1109, 1000, 1000),  # what was done before took no time
        (95, 10, 9, 0, 0),
    ],
)
def test_time_left_follows_from_what_was_done(seconds, done, total, before, left):
    assert seconds_left(seconds, done, total, before) == pytest.approx(left)


@pytest.mark.parametrize(
    ("seconds", "told"),
    [(0, "about 10 s"), (47, "about 50 s"), (600, "about 10 min"), (9000, "about 2.5 h")],
)
def test_times_are_told_as_exactly_as_they_are_known(seconds, told):
    assert time_left(seconds) == f"{told} left"


def test_a_bar_tells_the_time_left_from_the_first_moment():
    with Bars(StringIO()) as progress:
        progress.start("cells")
        told = []
        for total in (None, 100):
            if total is not None:
                progress.update(0, total)
            (task,) = progress._bars.tasks
            told.append([str(column.render(task)) for column in progress._bars.columns if "TimeLeft" in repr(column)])
        progress.finish("100 tasks")
    assert told == [[""], ["about 8 min left"]]


@pytest.mark.parametrize(("long", "told"), [(0.0, 1), (60.0, 0)])
def test_log_files_hear_once_of_long_compiling(monkeypatch, long, told):
    monkeypatch.setattr(compiling, "LONG", long)
    stream = StringIO()
    with Lines(stream) as progress:
        progress.start("cells")
        for _ in range(3):
            compiling.announce(True)
            compiling.announce(False)
        progress.finish("2 tasks")
    compiling.announce(True)
    lines = stream.getvalue().splitlines()
    assert len(lines) == told + 1
    assert ["compiling" in line for line in lines] == [True] * told + [False]


def test_a_bar_says_that_kernels_are_compiled():
    with Bars(StringIO()) as progress:
        compiling.announce(True)  # before there is any bar
        progress.start("cells")
        notes = []
        for active in (True, False):
            compiling.announce(active)
            notes.append(progress._bars.tasks[0].fields["note"])
        progress.finish("2 tasks")
        compiling.announce(True)  # after it is finished
        notes.append(progress._bars.tasks[0].fields["note"])
    assert notes == ["compiling, once on a machine", "", "2 tasks"]
