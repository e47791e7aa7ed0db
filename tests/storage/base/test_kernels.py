"""Compiled code is used again, and never after a change of what it was made of."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

BASE = """
from storage.base.kernels import kernel

STEP = {step}

@kernel()
def grown(x):
    return x + {more}
"""
USER = """
from base import STEP, grown
from storage.base.kernels import kernel

@kernel()
def answer(x):
    return STEP * grown(x)

print(answer(1), sum(answer.stats.cache_hits.values()))
"""


def answer_and_hits(folder: Path, step: int, more: int) -> str:
    (folder / "base.py").write_text(BASE.format(step=step, more=more))
    return run_user(folder)


def run_user(folder: Path) -> str:
    run = subprocess.run(
        [sys.executable, folder / "user.py"],
        check=True,
        capture_output=True,
        text=True,
        # Python takes a .pyc for current whose source kept its size and its second, as these do.
        env={"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
    )
    return run.stdout.strip()


def test_compiled_code_follows_changes_of_what_it_imports(tmp_path: Path) -> None:
    (tmp_path / "user.py").write_text(USER)
    assert answer_and_hits(tmp_path, step=1, more=2) == "3 0"
    assert answer_and_hits(tmp_path, step=1, more=2) == "3 1"
    assert answer_and_hits(tmp_path, step=5, more=2) == "15 0"
    assert answer_and_hits(tmp_path, step=5, more=4) == "25 0"
    assert answer_and_hits(tmp_path, step=5, more=4) == "25 1"


HEARD = """
from storage.base.compiling import listening
from storage.base.kernels import kernel

@kernel()
def grown(x):
    return x + 1

@kernel()
def answer(x):
    return 2 * grown(x)

heard = []
with listening(heard.append):
    answer(1)
    answer(2)
answer(0.5)
print(heard)
"""


def test_compiling_is_told_of_once_and_not_when_compiled_code_is_there(tmp_path: Path) -> None:
    (tmp_path / "user.py").write_text(HEARD)
    assert run_user(tmp_path) == "[True, False]"
    assert run_user(tmp_path) == "[]"


WITH_CLASS = """
from typing import NamedTuple

class {name}(NamedTuple):
    x: int
"""
TAKES_CLASS = """
import kinds
from storage.base.kernels import kernel

@kernel()
def answer(thing):
    return thing.x + 1

print(answer(kinds.{name}(2)), sum(answer.stats.cache_hits.values()))
"""


def test_compiled_code_that_takes_a_class_that_is_gone_is_made_anew(tmp_path: Path) -> None:
    for name in ("Old", "New"):
        (tmp_path / "kinds.py").write_text(WITH_CLASS.format(name=name))
        (tmp_path / "user.py").write_text(TAKES_CLASS.format(name=name))
        assert run_user(tmp_path) == "3 0"
        assert run_user(tmp_path) == "3 1"


CALLED = """
import numpy as np
from storage.base.kernels import kernel

@kernel()
def grown(x, by):
    return x + by

@kernel()
def answer(x, numbers):
    return grown(x, 1) + grown(numbers[0], x) + grown(3, by=numbers[1]) + grown(x, numbers[2]) + grown(0.5, 1)

print(answer(1, np.array([10, 20, 30], np.int32)), len(grown.signatures))
"""


def test_a_kernel_is_compiled_once_for_whole_numbers_of_all_kinds(tmp_path: Path) -> None:
    """Not for each constant and each width as well: that took a third of all compiling."""
    (tmp_path / "user.py").write_text(CALLED)
    assert run_user(tmp_path) == "68.5 2"
