"""How tight visibility is in rooms; tests/benchmarks/measure_visibility.py measures large models, minutes each."""

from __future__ import annotations

from pathlib import Path

import pytest

from jobs.visibility.settings import EngineSettings
from tests.benchmarks.measure_visibility import Case


@pytest.mark.slow
def test_persons_in_offices_are_told_little_more_than_they_see(tmp_path: Path) -> None:
    case = Case("offices:100000", tmp_path)
    found = case.measure(0.25, case.persons(8), 20_000, EngineSettings())
    assert found.missed == 0
    assert found.proven <= 1 <= found.tightness < 2.5
    assert found.mean_seen > 500
    again = case.measure(0.25, case.persons(8), 20_000, EngineSettings())
    assert again.tightness <= found.tightness  # what was seen once stays seen
