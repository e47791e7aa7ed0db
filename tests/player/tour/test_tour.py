"""The automatic tour: inside, moving, clear of surfaces, and always the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from player.camera.path import CameraPath
from player.camera.view import rotation_matrix
from player.shown_model import shown_model
from player.tour.survey import survey
from player.tour.tour import make_tour
from storage.store import Store
from tests.storage.tiny_store import box_part, make_store


def _tour(store: Store, frames: int, seed: int = 0) -> CameraPath:
    model = shown_model(store)
    return make_tour(model, survey(model), frames=frames, seed=seed)


def test_the_tour_walks_through_the_room(room: Store) -> None:
    tour = _tour(room, 80)
    assert len(tour) == 80
    assert (tour.positions > [0.1, 0.1, 0.3]).all()
    assert (tour.positions < [7.9, 5.9, 2.9]).all()
    assert (room.cell_at(tour.positions) >= 0).all()
    steps = np.sqrt((np.diff(tour.positions, axis=0) ** 2).sum(axis=1))
    assert steps.min() > 0
    assert steps.max() < 0.5
    for lo, hi in (((3, 2.5, 0.7), (5, 3.5, 0.75)),):  # the table
        gap = np.maximum(np.maximum(lo - tour.positions, tour.positions - hi), 0)
        assert np.sqrt((gap**2).sum(axis=1)).min() > 0.05


def test_the_tour_turns_gently_and_keeps_its_head_up(room: Store) -> None:
    tour = _tour(room, 80)
    forward = np.array([-rotation_matrix(q)[:, 2] for q in tour.orientations])
    turns = np.arccos(np.clip((forward[1:] * forward[:-1]).sum(axis=1), -1, 1))
    assert turns.max() < 0.35
    assert all(rotation_matrix(q)[2, 1] > 0.8 for q in tour.orientations)
    assert np.allclose(np.diff(tour.times), tour.times[1] - tour.times[0])


def test_the_same_store_and_seed_give_the_same_tour(room: Store) -> None:
    first, second, other = _tour(room, 30), _tour(room, 30), _tour(room, 30, seed=5)
    assert np.array_equal(first.positions, second.positions)
    assert np.array_equal(first.orientations, second.orientations)
    assert not np.array_equal(first.positions, other.positions)


def test_the_tour_stays_in_computed_cells(tmp_path: Path) -> None:
    from tests.storage.tiny_store import room_parts

    whole = make_store(tmp_path / "whole", room_parts(), depth=2)
    outside = {n for n, cell in enumerate(whole.cells) if cell["lo"][0] < 3}
    half = make_store(tmp_path / "half", room_parts(), depth=2, uncomputed=outside)
    assert (half.cell_at(_tour(half, 20).positions) >= 0).all()


@pytest.mark.parametrize("frames", [1, 2, 40])
def test_a_thing_in_the_void_is_circled(tmp_path: Path, frames: int) -> None:
    store = make_store(tmp_path / "s", [box_part("thing", (0, 0, 0), (1, 1, 1))], depth=1)
    tour = _tour(store, frames)
    assert len(tour) == frames
    middle = np.array([0.5, 0.5, 0.5])
    for position, orientation in zip(tour.positions, tour.orientations, strict=True):
        to_middle = (middle - position) / np.linalg.norm(middle - position)
        assert to_middle @ -rotation_matrix(orientation)[:, 2] > 0.99
    assert (np.diff(tour.positions, axis=0) != 0).any(axis=1).all()
