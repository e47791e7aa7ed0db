"""What is told of long work."""

from __future__ import annotations

from io import StringIO

import pytest

from storage.base import compiling
from storage.base.progress import Bars, Lines, progress_for


def test_a_line_for_each_finished_step():
    stream = StringIO()
    with progress_for(stream) as progress:
        assert isinstance(progress, Lines)
        progress.start("cells")
        progress.update(1, 2)
        progress.finish("2 tasks")
    assert stream.getvalue() == "cells: 2 tasks (0.0 s)\n"


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
