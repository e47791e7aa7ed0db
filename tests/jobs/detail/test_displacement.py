"""Placed grid points: the same bits as the store's own arithmetic gives."""

from __future__ import annotations

import numpy as np

from storage.placement import placed, transform_points


def test_placed_points_are_those_of_the_store() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        points = rng.integers(-(1 << 20), 1 << 20, (50, 3)).astype(np.int32)
        matrix = np.append(rng.normal(size=(3, 3)), rng.uniform(-100, 100, (3, 1)), axis=1)
        scale, step = 2.0 ** rng.integers(-20, -10), 2.0 ** rng.integers(-12, -8)
        wanted = np.rint(transform_points(matrix, points * scale) / step).astype(np.int32)
        assert np.array_equal(placed(points, scale, matrix, step), wanted)
