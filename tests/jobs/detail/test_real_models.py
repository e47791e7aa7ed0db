"""Certified errors on a real model; tests/benchmarks/measure_errors.py measures the large ones, minutes each."""

from __future__ import annotations

import os

import pytest

from tests.benchmarks.measure_errors import measure

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif("VLOD_MODELS" not in os.environ, reason="VLOD_MODELS does not name a folder of real models"),
]


@pytest.mark.parametrize("name", ["small_willowgarage"])
def test_measured_errors_of_real_models_are_below_the_stored_ones(name: str) -> None:
    result = measure(name, points=10_000)
    assert result["measured_above_stored"] == 0
    assert result["points_each_way"] >= 10_000
    assert result["stored_over_measured_median"] < 2
