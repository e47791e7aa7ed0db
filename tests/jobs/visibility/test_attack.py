"""Proof by attack: nasty scenes, and rays that look for what the engine misses.

`tests/benchmarks/attack_visibility.py` goes on for as long as one likes.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.jobs.visibility.nasty import misses, nasty_scene

#: Scenes that follow each other in one test.
SCENES = 250


def attack(first: int, rays: int) -> None:
    for number in range(first, first + SCENES):
        missed = misses(nasty_scene(np.random.default_rng([77, number])), rays, number)
        assert missed == [], f"scene {number}"


def test_no_drawable_is_ever_missed() -> None:
    attack(0, 600)


@pytest.mark.slow
@pytest.mark.parametrize("round_", range(1, 6))
def test_no_drawable_is_missed_in_many_scenes(round_: int) -> None:
    attack(round_ * SCENES, 3000)
