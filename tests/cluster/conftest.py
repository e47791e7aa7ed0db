"""Executors for the conformance suite: Ray is started once for all tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from jobs.running.executors import Executor, GrowingExecutor, SerialExecutor
from jobs.running.ray_executor import RayExecutor
from jobs.running.workplace import Workplace


@pytest.fixture(scope="session")
def ray_executor() -> Iterator[RayExecutor]:
    executor = RayExecutor(workers=2)
    yield executor
    executor.close()


@pytest.fixture(params=["serial", "growing", "grown", pytest.param("ray", marks=pytest.mark.slow)])
def executor(request: pytest.FixtureRequest) -> Executor:
    if request.param == "serial":
        return SerialExecutor()
    if request.param in ("growing", "grown"):  # while it works by itself, and after that
        return GrowingExecutor(SerialExecutor(), patience=1e-3 if request.param == "growing" else 0.0)
    return request.getfixturevalue("ray_executor")


@pytest.fixture
def place(tmp_path):
    store = tmp_path / "store"
    (store / "shards").mkdir(parents=True)
    return Workplace(store / "work", store)
