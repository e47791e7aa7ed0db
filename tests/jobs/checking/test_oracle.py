"""The oracle itself: what its rays see, pass and confirm."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.checking.oracle import Oracle, examine, surface_points

LO, HI = np.zeros(3), np.ones(3)


def squares(*xs: float, flipped: bool = False, half: float = 5.0) -> np.ndarray:
    """(2 n, 3, 3) float32: squares at x = xs around (x, 0.5, 0.5) whose fronts face -x, or +x where flipped."""
    corners = np.array([[-half, -half], [-half, half], [half, half], [half, -half]]) + 0.5
    triangles = []
    for x in xs:
        points = np.column_stack([np.full(4, x), corners])
        for a, b, c in ((0, 1, 2), (0, 2, 3)):
            triangles.append(points[[a, c, b] if flipped else [a, b, c]])
    front = np.cross(triangles[0][1] - triangles[0][0], triangles[0][2] - triangles[0][0])[0]
    assert (front > 0) == flipped
    return np.array(triangles, np.float32)


def oracle_of(
    parts: list[tuple[np.ndarray, bool]], see_through: Collection[int] = ()
) -> tuple[Oracle, np.ndarray, np.ndarray]:
    """An oracle over parts (triangles, one-sided), drawable n the n-th; the owners and all triangles."""
    triangles = np.concatenate([part for part, _ in parts])
    owner = np.repeat(np.arange(len(parts)), [len(part) for part, _ in parts])
    one_sided = np.repeat([sided for _, sided in parts], [len(part) for part, _ in parts])
    return Oracle(triangles, owner, one_sided, np.isin(owner, list(see_through))), owner, triangles


def rays(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Rays from the unit cell roughly along +x."""
    rng = np.random.default_rng(seed)
    origins = surface_points(LO, HI, count, rng)
    directions = np.column_stack([np.ones(count), rng.uniform(-0.3, 0.3, (count, 2))]).astype(np.float32)
    return origins, directions


def test_rays_pass_the_backs_of_one_sided_drawables() -> None:
    oracle, owner, _ = oracle_of([(squares(2, 3, 4, flipped=True), True), (squares(5), False)])
    origins, directions = rays(50)
    found, distance = oracle.cast(origins, directions)
    assert (owner[found] == 1).all()
    np.testing.assert_allclose(origins[:, 0] + distance, 5, atol=1e-4)


def test_backs_of_two_sided_drawables_stop_rays() -> None:
    oracle, owner, _ = oracle_of([(squares(2, flipped=True), False), (squares(5), False)])
    found, _ = oracle.cast(*rays(50))
    assert (owner[found] == 0).all()


def test_rays_are_left_as_they_were() -> None:
    oracle, _, _ = oracle_of([(squares(2, 3, 4, flipped=True), True), (squares(5), False)])
    origins, directions = rays(50)
    before = origins.copy(), directions.copy()
    oracle.cast(origins, directions)
    np.testing.assert_array_equal(origins, before[0])
    np.testing.assert_array_equal(directions, before[1])


def test_rays_that_leave_a_solid_meet_the_front_that_touches_it() -> None:
    # backs of a box around the cell at x = 2, in the very same plane the front of a slab, something behind both
    touching = squares(2)
    apart = touching[:, ::-1, :] * np.float32([1, 0.9, 1.1])  # other triangles in the same plane
    assert np.cross(apart[0, 1] - apart[0, 0], apart[0, 2] - apart[0, 0])[0] > 0
    for slab in (touching, apart[:, ::-1, :]):
        for two_sided in (False, True):
            box = (squares(2, flipped=True), True)
            behind = (squares(2 + 1e-4, half=3.0), False)
            oracle, owner, _ = oracle_of([box, (slab, not two_sided), behind])
            origins, directions = rays(4000, seed=3)
            found, distance = oracle.cast(origins, directions)
            assert (owner[found] == 1).all()
            np.testing.assert_allclose(origins[:, 0] + distance, 2, atol=1e-5)
            seen = examine(oracle, LO, HI, np.arange(3), 2000, np.random.default_rng(1)).seen
            assert seen.tolist() == [1]


def test_rays_that_hit_nothing_say_so() -> None:
    oracle, _, _ = oracle_of([(squares(-3), False)])
    found, distance = oracle.cast(*rays(20))
    assert (found == -1).all()
    assert np.isinf(distance).all()


def test_confirm_refuses_what_lies_behind_another_drawable() -> None:
    oracle, owner, _ = oracle_of([(squares(2), True), (squares(5), True)])
    origin, direction = np.array([0.5, 0.4, 0.5], np.float32), np.array([1, 0.01, 0.02], np.float32)
    distances = np.array([oracle.confirm(origin, direction, t) for t in range(4)])
    assert np.nanmin(distances[owner == 0]) == 1.5
    assert np.isnan(distances[owner == 1]).all()


def test_of_coincident_drawables_none_is_seen_alone_and_both_are_seen() -> None:
    oracle, owner, _ = oracle_of([(squares(2), False), (squares(2), False), (squares(5), False)])
    origin, direction = np.array([0.5, 0.4, 0.5], np.float32), np.array([1, 0.01, 0.02], np.float32)
    assert all(np.isnan(oracle.confirm(origin, direction, t)) for t in range(6))
    distances = np.array([oracle.confirm(origin, direction, t, alone=False) for t in range(6)])
    assert [np.nanmin(distances[owner == d]) for d in (0, 1)] == [1.5, 1.5]
    assert np.isnan(distances[owner == 2]).all()


def test_confirm_looks_through_backs_of_one_sided_drawables() -> None:
    oracle, owner, _ = oracle_of([(squares(2, flipped=True), True), (squares(5), True)])
    origin, direction = np.array([0.5, 0.4, 0.5], np.float32), np.array([1, 0.01, 0.02], np.float32)
    distances = [oracle.confirm(origin, direction, int(t)) for t in np.flatnonzero(owner == 1)]
    assert np.nanmin(distances) == 4.5


def test_a_drawable_left_out_is_missed_and_no_other_is() -> None:
    oracle, _, _ = oracle_of(
        [(squares(2, flipped=True), True), (squares(3, half=0.2), False), (squares(4), True), (squares(6), True)]
    )
    rng = np.random.default_rng(1)
    sound = examine(oracle, LO, HI, np.array([1, 2]), 2000, rng)
    assert sound.missed == []
    assert sound.rays == 2000
    assert sound.seen.tolist() == [1, 2]
    accused = examine(oracle, LO, HI, np.array([2]), 2000, np.random.default_rng(1))
    assert [sight.drawable for sight in accused.missed] == [1]
    origin = np.array(accused.missed[0].origin)
    assert (origin >= LO).all()
    assert (origin <= HI).all()


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(*[st.floats(-1e7, 1e7)] * 3),
    st.tuples(*[st.floats(0.0078125, 1024)] * 3),
    st.integers(0, 9),
)
def test_rays_start_in_the_cell(low: tuple[float, ...], size: tuple[float, ...], seed: int) -> None:
    lo = np.array(low)
    hi = lo + np.maximum(np.array(size), np.abs(lo) * 1e-5)
    points = surface_points(lo, hi, 40, np.random.default_rng(seed)).astype(np.float64)
    assert (points >= lo).all()
    assert (points <= hi).all()


def test_where_nothing_is_nothing_is_seen() -> None:
    oracle = Oracle(np.zeros((0, 3, 3), np.float32), np.zeros(0, np.int64), np.zeros(0, np.bool_))
    found, distance = oracle.cast(np.zeros((5, 3), np.float32), np.ones((5, 3), np.float32))
    assert (found == -1).all()
    assert np.isinf(distance).all()


@settings(max_examples=60)
@given(st.integers(0, 10**9))
def test_knowing_the_cell_changes_no_hit(seed: int) -> None:
    """Triangles that turn their backs to the cell are left out, and those that turn their fronts to it never are."""
    rng = np.random.default_rng(seed)
    centres = rng.uniform(-3, 4, (200, 1, 3))
    triangles = (centres + rng.normal(0, 0.6, (200, 3, 3))).astype(np.float32)
    owner, one_sided = np.arange(200), rng.random(200) < 0.8
    origins = surface_points(LO, HI, 300, rng)
    directions = rng.normal(size=(300, 3)).astype(np.float32)
    see_through = rng.random(200) < rng.choice([0.0, 0.3])
    anywhere, here = (Oracle(triangles, owner, one_sided, see_through, cell) for cell in (None, (LO, HI)))
    found, distance = anywhere.cast(origins, directions)
    again, along = here.cast(origins, directions)
    np.testing.assert_array_equal(found, again)
    np.testing.assert_allclose(distance, along, rtol=1e-6)
    assert (found >= 0).any()
    passed, passed_again = (
        sorted(zip(*(hits.tolist() for hits in oracle.passed(origins, directions, distance)), strict=True))
        for oracle in (anywhere, here)
    )
    assert passed == passed_again
    assert bool(passed) == see_through.any()


def test_rays_go_through_panes_note_them_all_and_end_at_what_is_behind_them() -> None:
    """Nearer and farther, in each order, and another one's back; what lies behind what stops a ray is not noted."""
    oracle, owner, _ = oracle_of(
        [(squares(2), False), (squares(3, flipped=True), False), (squares(4), False), (squares(3.5), False)], [0, 1, 2]
    )
    origins, directions = rays(100)
    found, distance = oracle.cast(origins, directions)
    assert (owner[found] == 3).all()
    np.testing.assert_allclose(origins[:, 0] + distance, 3.5, atol=1e-4)
    ray, pane = oracle.passed(origins, directions, distance)
    assert sorted(zip(ray.tolist(), owner[pane].tolist(), strict=True)) == [(r, d) for r in range(100) for d in (0, 1)]
    ray, pane = oracle.passed(origins, directions, np.full(100, np.inf))
    assert len(ray) == 300


@pytest.mark.parametrize("at", [1e3, 1e6])
def test_far_from_the_origin_rays_do_not_stay_before_a_pane(at: float) -> None:
    oracle, owner, _ = oracle_of([(squares(at + 2), False), (squares(at + 4), False)], [0, 1])
    origins, directions = rays(100)
    start = (origins + np.array([at, 0, 0])).astype(np.float32)
    ray, pane = oracle.passed(start, directions, np.full(100, np.inf))
    assert sorted(zip(ray.tolist(), owner[pane].tolist(), strict=True)) == [(r, d) for r in range(100) for d in (0, 1)]


def test_backs_of_panes_that_have_but_one_side_are_passed_and_not_noted() -> None:
    oracle, owner, _ = oracle_of([(squares(2, flipped=True), True), (squares(3), True)], [0, 1])
    _, pane = oracle.passed(*rays(50), np.full(50, np.inf))
    assert len(pane) == 50
    assert (owner[pane] == 1).all()


def test_panes_are_confirmed_before_what_stops_a_ray_and_not_behind_it_or_where_it_is() -> None:
    oracle, owner, _ = oracle_of(
        [(squares(2), False), (squares(2), False), (squares(3), False), (squares(3), False), (squares(4), False)],
        [0, 1, 2, 4],
    )
    origin, direction = np.array([0.5, 0.4, 0.5], np.float32), np.array([1, 0.01, 0.02], np.float32)
    distances = np.array([oracle.confirm(origin, direction, t) for t in range(10)])
    assert [np.nanmin(distances[owner == d]) for d in (0, 1)] == [1.5, 1.5]  # neither pane stops the other
    assert np.isnan(distances[owner == 2]).all()  # the wall may be what is drawn there
    assert np.nanmin(distances[owner == 3]) == 2.5
    assert np.isnan(distances[owner == 4]).all()


def test_panes_left_out_are_missed_and_so_is_what_is_seen_through_them() -> None:
    parts = [(squares(2), False), (squares(2), False), (squares(3), False), (squares(4), False), (squares(5), False)]
    oracle, _, _ = oracle_of(parts, [0, 1, 2, 4])
    sound = examine(oracle, LO, HI, np.arange(4), 2000, np.random.default_rng(1))
    assert sound.missed == []
    assert sound.seen.tolist() == [0, 1, 2, 3]  # of two panes in one place those are seen that are aimed at
    assert sound.missed_rays == 0
    for left_out in range(4):
        known = np.array([d for d in range(4) if d != left_out])
        accused = examine(oracle, LO, HI, known, 2000, np.random.default_rng(1))
        assert [sight.drawable for sight in accused.missed] == [left_out]
        if left_out > 1:
            assert accused.missed_rays > 50
    nothing = examine(oracle, LO, HI, np.zeros(0, np.int64), 2000, np.random.default_rng(1))
    assert [sight.drawable for sight in nothing.missed] == [0, 1, 2, 3]
    assert nothing.missed_rays <= nothing.uniform
