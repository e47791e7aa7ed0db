"""Compiled code is used again, and never after a change of what it was made of."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

BASE = """
from storage.kernels import kernel

STEP = {step}

@kernel()
def grown(x):
    return x + {more}
"""
USER = """
from base import STEP, grown
from storage.kernels import kernel

@kernel()
def answer(x):
    return STEP * grown(x)

print(answer(1), sum(answer.stats.cache_hits.values()))
"""


def answer_and_hits(folder: Path, step: int, more: int) -> str:
    (folder / "base.py").write_text(BASE.format(step=step, more=more))
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
