"""Proof by attack: hierarchies above nasty models, each level's distance from the model, and whether anything is lost.

`tests/benchmarks/attack_errors.py` goes on for as long as one likes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jobs.importing.model import MeshView, Part
from jobs.parameters import BuildParameters
from storage.meshes.placement import IDENTITY
from storage.model.tree import leaves
from tests.jobs.nasty_models import NastyModel, built_of, faults, nasty_model


def attack(numbers: range, folder: Path) -> None:
    for number in numbers:
        model = nasty_model(np.random.default_rng([78, number]))
        assert faults(model, built_of(model, folder / str(number)), number) == [], f"model {number}"


def test_no_level_is_farther_from_the_model_than_it_says(tmp_path: Path) -> None:
    attack(range(8), tmp_path)


@pytest.mark.slow
def test_no_level_of_many_models_is_farther_than_it_says(tmp_path: Path) -> None:
    attack(range(8, 28), tmp_path)


@pytest.mark.parametrize("times", [1, 3])
def test_things_smaller_than_a_grid_step_are_drawn(tmp_path: Path, times: int) -> None:
    """Specks and wires far from all else, placed once or as instances: all leaves are right to a few steps."""
    large = MeshView.of(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), np.array([[0, 2, 1], [0, 1, 3]]))
    speck = MeshView.of(np.array([[0, 0, 0], [1e-11, 0, 0], [0, 1e-11, 0], [0, 0, 1e-11]]), large.triangles)
    wire = MeshView.of(np.array([[0, 0, 0], [0.3, 0, 0], [0.1, 1e-11, 0]]), np.array([[0, 1, 2]]))
    spots = [np.hstack([np.eye(3), [[0.9], [0.9], [0.2 * number]]]) for number in range(2 * times)]
    placements = [Part(0, "large", IDENTITY)]
    placements += [Part(1 + number % 2, "small", spot) for number, spot in enumerate(spots)]
    model = NastyModel([large, speck, wire], placements, BuildParameters())
    built = built_of(model, tmp_path)
    assert faults(model, built, 0) == []
    nodes, rows = built.geometry.nodes, built.geometry.drawables
    assert leaves(nodes).sum() == 1 + 2 * times
    assert rows["error"][nodes["first_drawable"][leaves(nodes)]].max() <= 4 * built.geometry.grid.step


def test_a_model_of_one_wire_is_drawn(tmp_path: Path) -> None:
    wire = MeshView.of(np.array([[0, 0, 0], [1, 2, 3.0], [0.5, 1, 1.5 + 1e-13]]), np.array([[0, 1, 2]]))
    model = NastyModel([wire], [Part(0, "wire", IDENTITY)], BuildParameters())
    assert faults(model, built_of(model, tmp_path), 0) == []
