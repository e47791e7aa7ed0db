"""Compiled code is used again, and never after a change of what it was made of."""

from __future__ import annotations

import inspect
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core import caching
from numba.core.dispatcher import Dispatcher

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


PATCHED = """
import json
import numpy as np
from storage.base.kernels import allocating_kernel, kernel

@kernel()
def total(values):
    found = 0.0
    for value in values:
        found += value
    return found

@kernel()
def twice(values):
    return total(values) + total(values[1:])

@allocating_kernel()
def copied(values):
    return values.copy()

assert twice(np.ones(3)) == 5
assert len(copied(np.ones(3))) == 3
counts = ["NRT_incref" in code for made in (twice, copied) for code in made.inspect_llvm().values()]
cache = twice._cache
print(json.dumps([type(cache._cache_file).__name__, type(cache._impl._locator).__name__, counts]))
"""

#: What to do when one of the tests below fails.
MEND = (
    "storage/base/kernels.py replaces numba's {}, and numba {} has it no more as it was, so that {}. Mend it there, or "
    "keep numba's version below this one in pyproject.toml"
)


def mend(name: str, else_what: str) -> str:
    return MEND.format(name, numba.__version__, else_what)


@pytest.fixture(scope="module")
def patched(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """What is seen of the patches: classes of the cache's index and place, whether references are counted."""
    folder = tmp_path_factory.mktemp("patched")
    (folder / "user.py").write_text(PATCHED)
    found: list[Any] = json.loads(run_user(folder))
    return found


def test_numba_still_lists_compiled_code_by_the_class_that_is_replaced(patched: list[Any]) -> None:
    says = mend("caching.IndexDataCacheFile", "compiled code that names a class that is gone stops whoever runs it")
    assert callable(getattr(caching.IndexDataCacheFile, "_load_index", None)), says
    assert patched[0] == "_Index", says


def test_numba_still_asks_the_configured_places_for_compiled_code(patched: list[Any]) -> None:
    says = mend("config.CACHE_LOCATOR_CLASSES", "changed code may meet old machine code")
    for place in (caching.InTreeCacheLocator, caching.UserWideCacheLocator):
        assert callable(getattr(place, "get_source_stamp", None)), says
    assert patched[1] in ("BesideSource", "InUsersCache"), says


def test_numba_still_asks_a_dispatcher_how_a_kernel_is_called() -> None:
    says = mend("Dispatcher.get_call_template", "kernels are compiled once for each constant that they are called with")
    template = getattr(Dispatcher, "get_call_template", None)
    assert template is not None, says
    assert list(inspect.signature(template).parameters) == ["self", "args", "kws"], says


def test_numba_still_leaves_out_the_counting_of_references(patched: list[Any]) -> None:
    says = mend("option _nrt", "the engine takes a fifth longer")
    without, with_counting = patched[2]
    assert with_counting, "NRT_incref is not what numba calls to count references any more: look for its new name"
    assert not without, says


def test_numba_is_bounded_where_its_insides_are_known() -> None:
    """The bound is what keeps a later numba away until these tests have passed with it."""
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    (need,) = (need for need in project["dependencies"] if need.startswith("numba"))
    assert re.fullmatch(r"numba>=\d+\.\d+,<\d+\.\d+", need)
    below = need.partition("<")[2].split(".")
    assert tuple(map(int, numba.__version__.split(".")[:2])) < tuple(map(int, below)), need
