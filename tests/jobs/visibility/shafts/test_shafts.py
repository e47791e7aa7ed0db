"""Shafts: where edges meet them, what closes them, and that they only ever sharpen what images say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from jobs.visibility.engine import CellVisibility, Engine
from jobs.visibility.settings import EngineSettings
from jobs.visibility.shafts.closing_sets import MOST_EPOCHS
from jobs.visibility.shafts.shafts import edge_meets, part_within
from tests.jobs.visibility.scenes import Mesh, rooms, sheet, soup_of

COORDINATE = st.integers(-100, 100)
CORNER = st.tuples(COORDINATE, COORDINATE, COORDINATE)
SHUFFLES = [(0, 1, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]


def extent(a: tuple[int, int, int], b: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    return np.minimum(a, b).astype(np.float64), np.maximum(a, b).astype(np.float64)


@given(CORNER, CORNER, CORNER, CORNER, CORNER, CORNER)
def test_an_edge_meets_a_shaft_where_a_linear_programme_says_so(
    v0: tuple[int, int, int], v1: tuple[int, int, int], u0: tuple[int, int, int], u1: tuple[int, int, int],
    a: tuple[int, int, int], b: tuple[int, int, int],
) -> None:  # fmt: skip
    v_lo, v_hi = extent(v0, v1)
    u_lo, u_hi = extent(u0, u1)
    start, end = np.array(a, np.int32), np.array(b, np.int32)
    low, high = np.stack([u_lo, v_lo - u_lo]), np.stack([u_hi, v_hi - u_hi])
    along = (end - start).astype(np.float64)
    # unknown: the place in the shaft, the place on the edge, and by how much all bounds are kept
    above = np.stack([low[1], -along, np.ones(3)], axis=1)
    below = np.stack([-high[1], along, np.ones(3)], axis=1)
    bounds = np.concatenate([above, below]), np.concatenate([start - low[0], high[0] - start])
    limits = [(0, 1), (0, 1), (None, 1)]
    best = linprog([0, 0, -1], *bounds, bounds=limits)
    first, last = edge_meets(start, end, low, high)
    if best.x[2] < -1e-6:
        assert first > last
    if best.x[2] > 1e-6:
        assert first <= last
        t0, t1 = part_within(start, end, low, high, first, last)
        kept = [(0, 1), (0, 1), (0, None)]
        for sign in (1, -1):
            least = linprog([0, sign, 0], *bounds, bounds=kept)
            assert t0 - 1e-6 <= least.x[1] <= t1 + 1e-6
            nearest = linprog([sign, 0, 0], *bounds, bounds=kept)
            assert first - 1e-6 <= nearest.x[0] <= last + 1e-6


def looked(meshes: list[Mesh], shafts: int) -> CellVisibility:
    """What is seen from a cell of 100 units around the grid's middle."""
    soup = soup_of(meshes)
    settings = EngineSettings(resolution=16, proof_resolution=8, aimed_rays=0, shafts=shafts, least_worth=0)
    engine = Engine(soup, settings)
    found = engine.visible_from(np.full(3, -50.0), np.full(3, 50.0), soup.drawables)
    assert found is not None
    return found


def turned(mesh: Mesh, shuffle: tuple[int, int, int]) -> Mesh:
    return np.ascontiguousarray(mesh[0][:, shuffle]), mesh[1]


@pytest.mark.parametrize("shuffle", SHUFFLES)
@pytest.mark.parametrize(("begins", "hidden"), [(-60, True), (-10, True), (5, False), (25, False)])
def test_two_screens_hide_together_what_neither_hides_alone(
    shuffle: tuple[int, int, int], begins: int, hidden: bool
) -> None:
    near = sheet((400, -4000, -4000), (400, 0, 4000), 1)
    far = sheet((600, begins, -4000), (600, 4000, 4000), 1)
    thing = sheet((1000, -1, -1), (1000, 1, 1), 1)
    scene = [turned(mesh, shuffle) for mesh in (near, far, thing)]
    assert looked(scene, 0).visible.tolist() == [0, 1, 2]  # a pixel is wider than the thing
    found = looked(scene, 10_000)
    assert found.visible.tolist() == ([0, 1] if hidden else [0, 1, 2])
    assert found.proven.tolist() == found.visible.tolist()


@pytest.mark.parametrize("shuffle", SHUFFLES)
@pytest.mark.parametrize(("offset", "seen"), [(1, False), (0, True), (-1, True)])
def test_what_is_right_behind_a_slanting_wall_is_hidden(shuffle: tuple[int, int, int], offset: int, seen: bool) -> None:
    corners = np.array([[200, -4000, -4000], [2200, 4000, -4000], [2200, 4000, 4000], [200, -4000, 4000]], np.int32)
    wall = corners, np.array([[0, 1, 2], [0, 2, 3]])
    poster = (
        np.array([[1100 + offset, -400, 0], [1150 + offset, -200, 0], [1125 + offset, -300, 50]], np.int32),
        np.array([[0, 1, 2]]),
    )
    scene = [turned(mesh, shuffle) for mesh in (wall, poster)]
    found = looked(scene, 10_000)
    assert found.visible.tolist() == ([0, 1] if seen else [0])
    assert found.proven.tolist() == found.visible.tolist()


@pytest.mark.parametrize("shuffle", SHUFFLES)
def test_a_slit_of_one_grid_unit_is_looked_through(shuffle: tuple[int, int, int]) -> None:
    left = sheet((400, -4000, -4000), (400, 0, 4000), 1)
    right = sheet((400, 1, -4000), (400, 4000, 4000), 1)
    thing = sheet((1000, -200, -200), (1000, 200, 200), 1)
    found = looked([turned(mesh, shuffle) for mesh in (left, right, thing)], 10_000)
    assert 2 in found.visible


@pytest.mark.parametrize("seed", range(3))
def test_shafts_only_ever_sharpen_and_an_engine_forgets_its_last_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    soup = soup_of(rooms(rng, 4))
    lo = rng.integers(500, 15000, (2, 3)) * np.array([1.0, 1.0, 0.0]) + [0.0, 0.0, 1500.0]
    few, more, most = (
        Engine(soup, replace(EngineSettings(resolution=32), shafts=shafts, least_worth=worth))
        for shafts, worth in ((0, 1), (500, 1), (100_000, 0.01))
    )
    found = [engine.visible_from(lo[0], lo[0] + 300, soup.drawables) for engine in (few, more, most)]
    visible = [set(cell.visible.tolist()) for cell in found if cell is not None]
    proven = [set(cell.proven.tolist()) for cell in found if cell is not None]
    assert visible[2] <= visible[1] <= visible[0]
    assert len(visible[2]) < len(visible[0])
    assert proven[0] <= proven[1] <= proven[2] <= visible[2]
    for engine, before in ((more, found[1]), (most, found[2])):
        engine.visible_from(lo[1], lo[1] + 300, soup.drawables)
        engine._room.work.epoch[:] = MOST_EPOCHS + 1  # so many floods later
        again = engine.visible_from(lo[0], lo[0] + 300, soup.drawables)
        assert before is not None
        assert again is not None
        assert again.visible.tolist() == before.visible.tolist()
        assert again.proven.tolist() == before.proven.tolist()


def test_a_crowded_cell_is_given_up_only_once_shafts_have_had_their_say() -> None:
    soup = soup_of(rooms(np.random.default_rng(1), 4))
    lo, hi = np.array([6000.0, 6100, 1500]), np.array([6300.0, 6400, 1800])
    images = Engine(soup, EngineSettings(resolution=32, shafts=0)).visible_from(lo, hi, soup.drawables)
    engine = Engine(soup, EngineSettings(resolution=32))
    both = engine.visible_from(lo, hi, soup.drawables)
    assert images is not None
    assert both is not None
    reported = [int(soup.triangle_counts[soup.places(found.visible)].sum()) for found in (images, both)]
    assert reported[1] < reported[0] <= 2 * reported[1]
    assert engine.visible_from(lo, hi, soup.drawables, reported[1]) is not None
    assert engine.visible_from(lo, hi, soup.drawables, reported[1] - 1) is None
