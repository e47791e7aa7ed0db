"""Named settings of the engine: more time reports less and proves more, and none misses anything."""

from __future__ import annotations

import numpy as np

from jobs.checking.oracle import examine
from jobs.visibility.engine import Engine
from jobs.visibility.settings import QUALITIES
from tests.jobs.visibility.scenes import oracle_of, rooms, soup_of


def test_more_time_reports_less_and_proves_more_and_none_misses_anything() -> None:
    soup = soup_of(rooms(np.random.default_rng(2), 4))
    oracle = oracle_of(soup)
    low, high = soup.vertices.min(axis=0).astype(np.float32), soup.vertices.max(axis=0).astype(np.float32)
    cells = [low + part * (high - low) for part in np.random.default_rng(1).uniform(0.1, 0.9, (6, 3))]
    reported, proven = [], []
    for settings in QUALITIES.values():
        engine = Engine(soup, settings)
        reported.append(0)
        proven.append(0)
        for number, lo in enumerate(cells):
            hi = lo + 300
            found = engine.visible_from(lo, hi, soup.drawables)
            assert found is not None
            looked = examine(oracle, lo, hi, found.visible, 10_000, np.random.default_rng(number))
            assert looked.missed == []
            reported[-1] += int(soup.triangle_counts[found.visible].sum())
            proven[-1] += int(soup.triangle_counts[found.proven].sum())
    assert reported[0] > reported[1] > reported[2]
    assert proven[0] < proven[1] < proven[2]
