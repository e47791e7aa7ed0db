"""The automatic tour: inside, moving, clear of surfaces, and always the same."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from player.camera.path import CameraPath
from player.camera.view import rotation_matrix
from player.shown_model import shown_model
from player.tour.survey import survey
from player.tour.tour import make_tour
from storage.cells.octree import Octree, children, encode, morton_order
from storage.store import Store
from tests.storage.tiny_store import TinyPart, box_part, make_store, room_parts


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


def solids(parts: list[TinyPart]) -> np.ndarray:
    """The boxes (n, 2, 3) of parts that are boxes, as they are placed: of turned ones the boxes around them."""
    found = []
    for part in parts:
        points = np.asarray(part.levels[0][0], float)
        for matrix in part.matrices or [np.eye(4)[:3]]:
            placed = points @ np.asarray(matrix)[:, :3].T + np.asarray(matrix)[:, 3]
            found.append((placed.min(axis=0), placed.max(axis=0)))
    return np.array(found)


def distances(points: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """From points (n, 3) to the nearest of solid boxes (m, 2, 3): 0 inside one."""
    gaps = np.maximum(np.maximum(boxes[:, 0] - points[:, None], points[:, None] - boxes[:, 1]), 0)
    return np.sqrt((gaps**2).sum(axis=2)).min(axis=1)


def heights(points: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Of points (n, 3) above the highest box below them; infinite where there is none."""
    over = ((points[:, None, :2] >= boxes[:, 0, :2]) & (points[:, None, :2] <= boxes[:, 1, :2])).all(axis=2)
    under = over & (boxes[:, 1, 2] <= points[:, None, 2])
    return points[:, 2] - np.where(under, boxes[:, 1, 2], -np.inf).max(axis=1)


def town_parts() -> list[TinyPart]:
    """A plain of 400 x 400 with houses of 24 x 24, 16 apart; cars of 4 x 2 in the streets."""
    parts = [box_part("plain", (-200, -200, -0.5), (200, 200, 0), segments=(16, 2))]
    corners = [(x, y) for x in range(-180, 180, 40) for y in range(-180, 180, 40)]
    parts += [box_part("house", (x, y, 0), (x + 24, y + 24, 9 + (7 * x + 3 * y) % 23)) for x, y in corners]
    parts += [box_part("car", (x, 13, 0), (x + 4, 15, 1.5)) for x in range(-176, 180, 40)]
    return parts


def keys_within(parts: list[TinyPart], depth: int, lo: tuple[float, ...], hi: tuple[float, ...]) -> list[int]:
    """The cells of that depth whose middles lie between lo and hi, in the octree that `make_store` makes."""
    boxes = solids(parts)
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    margin = 0.05 * (high - low).max()
    octree = Octree.around(low - margin, high + margin)
    at = [octree.faces(np.arange(2**depth + 1)[:, None].repeat(3, axis=1), depth)[:, axis] for axis in range(3)]
    middles = [(faces[1:] + faces[:-1]) / 2 for faces in at]
    own = [np.flatnonzero((m > first) & (m < last)) for m, first, last in zip(middles, lo, hi, strict=True)]
    keys = encode(np.stack(np.meshgrid(*own, indexing="ij"), axis=-1).reshape(-1, 3), depth)
    return [int(key) for key in keys[morton_order(keys)]]


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A town of which the streets around one crossing were computed, up to 3.4 above the ground."""
    parts = town_parts()
    keys = keys_within(parts, 7, (-30, 3, 0), (30, 21, 3.4))
    return make_store(tmp_path_factory.mktemp("town") / "store", parts, keys=keys)


@pytest.mark.parametrize("seed", range(2))
def test_a_tour_of_a_town_stays_in_the_street_that_was_computed(town: Store, seed: int) -> None:
    tour = _tour(town, 60, seed)
    assert (town.cell_at(tour.positions) >= 0).all()
    boxes = solids(town_parts())
    assert distances(tour.positions, boxes).min() > 0.2
    above = heights(tour.positions, boxes)
    assert above.min() > 0.9
    assert above.max() < 2.1
    assert np.median(above) == pytest.approx(1.6, abs=0.21)  # a voxel
    steps = np.sqrt((np.diff(tour.positions, axis=0) ** 2).sum(axis=1))
    assert steps.min() > 0.01
    assert steps.max() < 0.3


def test_cells_far_above_every_floor_are_floated_through(tmp_path: Path) -> None:
    parts = town_parts()
    store = make_store(tmp_path / "s", parts, keys=keys_within(parts, 6, (-30, -60, 12), (30, 60, 40)))
    tour = _tour(store, 40)
    assert (store.cell_at(tour.positions) >= 0).all()
    assert distances(tour.positions, solids(parts)).min() > 0.2
    assert (np.diff(tour.positions, axis=0) != 0).any(axis=1).all()


def test_where_there_is_no_way_the_tour_looks_around(tmp_path: Path) -> None:
    parts = town_parts()
    store = make_store(tmp_path / "s", parts, keys=keys_within(parts, 9, (-8.0, 8.2, 1.2), (-7.1, 9.1, 2.1)))
    assert 0 < len(store.cells) < 9
    tour = _tour(store, 40)
    assert (store.cell_at(tour.positions) >= 0).all()
    assert distances(tour.positions, solids(parts)).min() > 0.2
    forward = np.array([-rotation_matrix(q)[:, 2] for q in tour.orientations])
    assert (forward[1:] * forward[:-1]).sum(axis=1).max() < 0.9999


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 2))
def test_wherever_cells_were_computed_the_tour_stays_in_them(
    tmp_path_factory: pytest.TempPathFactory, seed: int, depth: int
) -> None:
    """Random cells of the room, of one depth or two, among them such that hang together nowhere."""
    rng = np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp("cells")
    keys = np.arange(8**depth, 2 * 8**depth, dtype=np.uint64)
    if rng.random() < 0.5:
        split = rng.random(len(keys)) < 0.2
        keys = np.concatenate([keys[~split], *(children(int(key)) for key in keys[split])])
        keys = keys[morton_order(keys)]
    uncomputed = set(np.flatnonzero(rng.random(len(keys)) < rng.choice([0.1, 0.5, 0.9])).tolist())
    store = make_store(folder / "store", room_parts(), keys=keys, uncomputed=uncomputed)
    path = _tour(store, 30, int(seed % 3))
    boxes = solids(room_parts())
    inside = store.cell_at(path.positions) >= 0
    if inside.any():
        assert distances(path.positions, boxes[:6]).min() > 0.02
    elif store.cells["computed"].any():  # there is no room in them: whoever is there touches something
        lo, hi = store.cells["lo"], store.cells["hi"]
        points = (lo + rng.random((50, *lo.shape)) * (hi - lo)).reshape(-1, 3)
        free = points[(store.cell_at(points) >= 0) & (distances(points, boxes) > 0.6)]
        assert not ((free > 0) & (free < [8, 6, 3])).all(axis=1).any()
    assert inside.all() or not inside.any()
    shutil.rmtree(folder)
