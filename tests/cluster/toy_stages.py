"""Small stages for the tests of executors; imported by worker processes."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

from jobs.running.tasks import Assignment, Stage, Task
from storage.base.compiling import announce
from storage.base.errors import ModelError

_CODE = ("tests.cluster.toy_stages",)
SQUARE = Stage("square", "tests.cluster.toy_stages:square", _CODE)
LETHAL = Stage("lethal", "tests.cluster.toy_stages:lethal", _CODE)
WRONG = Stage("wrong", "tests.cluster.toy_stages:wrong", _CODE)
SLOW = Stage("slow", "tests.cluster.toy_stages:slow", _CODE)
COMPILING = Stage("compiled", "tests.cluster.toy_stages:compiles", _CODE)


def square_task(number: int, seconds: float = 0.0, **places: str) -> Task:
    """A task that squares a number and takes some seconds for it; it notes each run in places["log"]."""
    return Task(SQUARE, {"number": number, "seconds": seconds}, places, memory=50 << 20)


def square(work: Assignment) -> dict[str, Any]:
    """Squares a number."""
    _note(work)
    time.sleep(work.payload["seconds"])
    number = work.payload["number"]
    (work.out / "square.txt").write_text(str(number * number))
    return {"square": number * number}


def lethal(work: Assignment) -> dict[str, Any]:
    """Kills its own process, as often as the payload says, and then succeeds."""
    runs = _note(work)
    (work.out / "half-done").write_text("garbage")
    if runs <= work.payload["deaths"]:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"runs": runs}


def wrong(work: Assignment) -> dict[str, Any]:
    """Raises an error of a user's making, or of ours."""
    if work.payload["bug"]:
        raise ZeroDivisionError("a bug")
    raise ModelError("chair.obj: not a model")


def slow(work: Assignment) -> dict[str, Any]:
    """Takes a minute."""
    _note(work)
    time.sleep(60)
    return {}


def compiles(work: Assignment) -> dict[str, Any]:
    """Says that it compiles, in turns of some seconds."""
    for seconds in work.payload["turns"]:
        announce(True)
        time.sleep(seconds)
        announce(False)
    return {}


def _note(work: Assignment) -> int:
    """Notes a run in the log; returns how many runs of the same payload there were."""
    log = Path(work.places["log"])
    line = repr(sorted(work.payload.items())) + "\n"
    with log.open("a") as file:
        file.write(line)
    return log.read_text().splitlines().count(line.strip())
