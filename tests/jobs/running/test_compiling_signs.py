"""Signs by which workers show that they compile."""

from __future__ import annotations

import os

import pytest

from jobs.running.compiling_signs import STALE, seen, shown
from jobs.running.workplace import Workplace
from storage.base import compiling


@pytest.fixture
def place(tmp_path):
    (tmp_path / "work").mkdir()
    return Workplace(tmp_path / "work", tmp_path / "store")


@pytest.mark.parametrize(("long", "expected"), [(0.0, [False, False, False, True, False]), (60.0, [False] * 5)])
def test_a_sign_is_there_while_long_compiling_goes_on(place, monkeypatch, long, expected):
    monkeypatch.setattr(compiling, "LONG", long)
    found = [seen(place)]
    with shown(place):
        for active in (True, False, True, False):
            compiling.announce(active)
            found.append(seen(place))
    assert found == expected
    compiling.announce(True)
    assert not seen(place)
    compiling.announce(False)


def test_signs_of_killed_workers_are_not_believed_for_long(place):
    sign = place.work / "compiling" / ".tmp-some-other-host-1-0abc"
    sign.parent.mkdir()
    sign.touch()
    assert seen(place)
    os.utime(sign, (sign.stat().st_mtime - STALE,) * 2)
    assert not seen(place)
