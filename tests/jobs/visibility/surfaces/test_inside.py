"""What reaches into a cell, against all corners looked at one by one."""

from __future__ import annotations

import numpy as np
import pytest

from jobs.visibility.engine import Engine
from jobs.visibility.settings import EngineSettings
from tests.jobs.visibility.scenes import box, soup_of


@pytest.mark.parametrize("seed", range(6))
def test_what_has_a_vertex_inside_reaches_into_a_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.integers(-100, 100, (60, 3))
    meshes = [box(tuple(at), tuple(at + rng.integers(1, 60, 3))) for at in corners]
    soup = soup_of(meshes)
    engine = Engine(soup, EngineSettings(resolution=8))
    for _ in range(10):
        lo = rng.integers(-100, 60, 3).astype(np.float64)
        hi = lo + rng.integers(1, 80, 3)
        cut = np.flatnonzero(rng.random(len(meshes)) < 0.8)
        expected = [d for d in cut if ((meshes[d][0] > lo) & (meshes[d][0] < hi)).all(axis=1).any()]
        assert engine.reaching_into(lo, hi, cut).tolist() == expected


def test_what_only_touches_a_cell_or_passes_through_it_has_no_vertex_inside() -> None:
    meshes = [box((10, 2, 2), (20, 8, 8)), box((-50, 4, 4), (50, 6, 6)), box((9, 2, 2), (20, 8, 8))]
    engine = Engine(soup_of(meshes), EngineSettings(resolution=8))
    assert engine.reaching_into(np.zeros(3), np.full(3, 10.0), np.arange(3)).tolist() == [2]
