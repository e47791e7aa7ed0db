"""Comparing pictures: what differs, and what is a hole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from player.shells.compare import ALLOWED_HOLES, Difference, difference, holes, in_a_million, magnified, passed


def _picture(rng: np.random.Generator, surface: float) -> np.ndarray:
    picture = rng.integers(0, 256, (13, 17, 4)).astype(np.uint8)
    picture[..., 3] = np.where(rng.random((13, 17)) < surface, 255, 0)
    return picture


@given(st.integers(0, 2**32 - 1))
def test_holes_are_surface_far_from_any_surface(seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn, full = _picture(rng, 0.1), _picture(rng, 0.7)
    expected = np.zeros((13, 17), bool)
    for y in range(13):
        for x in range(17):
            near = drawn[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2, 3]
            expected[y, x] = full[y, x, 3] > 0 and not near.any()
    assert np.array_equal(holes(drawn, full), expected)
    assert difference(drawn, full).holes == expected.sum()
    assert difference(drawn, full).covered == (full[..., 3] > 0).sum()
    assert (magnified(drawn, full)[expected] == (255, 0, 0)).all()


def test_only_differences_above_sixteen_levels_count() -> None:
    full = np.full((10, 10, 4), 100, np.uint8)
    drawn = full.copy()
    drawn[0, 0, 0] = 116
    drawn[0, 1, 1] = 117
    found = difference(drawn, full)
    assert found.differing == 0.01
    assert found.differing_grey == 0
    assert found.holes == 0
    assert passed([found])
    drawn[0, 2] = 200
    found = difference(drawn, full)
    assert found.differing == 0.02
    assert found.differing_grey == 0.01
    assert not passed([found])
    assert not passed([*[difference(full, full)] * 9, found])  # each frame by itself


def test_a_single_hole_fails_a_small_picture() -> None:
    full = np.full((10, 10, 4), 255, np.uint8)
    drawn = full.copy()
    drawn[3:6, 3:6, 3] = 0
    assert difference(drawn, full).holes == 1
    assert not passed([replace(difference(drawn, full), differing=0.0)])


def test_one_hole_in_a_million_covered_pixels_passes_over_all_frames_together() -> None:
    assert ALLOWED_HOLES == 1e-6
    whole = Difference(differing=0.0, differing_grey=0.0, holes=0, covered=500_000)
    torn = replace(whole, holes=1)
    assert passed([torn, whole])
    assert not passed([torn])
    assert not passed([torn, replace(whole, covered=499_999)])  # what is background does not count
    assert not passed([torn, torn])
    assert passed([torn, torn, whole, whole])
    assert passed([replace(whole, covered=0)])
    assert in_a_million(3, 1_500_000) == 2.0
    assert in_a_million(0, 0) == 0.0
