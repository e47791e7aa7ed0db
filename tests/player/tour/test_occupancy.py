"""The voxel kernels against brute force."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from player.tour.occupancy import cheapest_ways, clearance, enclosure, free_run, mark_triangles

seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_no_voxel_that_a_triangle_touches_is_missed_and_few_others_are_marked(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 9, (3, 3, 3))
    lo, size = np.array([0.5, -0.5, 0.0]), 0.75
    grid, facing = np.zeros((10, 11, 12), bool), np.zeros((10, 11, 12, 3), np.float32)
    mark_triangles(grid, facing, corners, False, lo, size)
    assert not facing.any()
    u, v = np.meshgrid(np.linspace(0, 1, 90), np.linspace(0, 1, 90))
    inside = u + v <= 1
    for a, b, c in corners:
        points = a + u[inside][:, None] * (b - a) + v[inside][:, None] * (c - a)
        voxels = np.floor((points - lo) / size).astype(int)
        voxels = voxels[((voxels >= 0) & (voxels < grid.shape)).all(axis=1)]
        assert grid[tuple(voxels.T)].all()
    centres = lo + (np.argwhere(grid) + 0.5) * size
    steps = np.linspace(0, 1, 40)
    s, t = np.meshgrid(steps, steps)
    keep = s + t <= 1
    samples = np.concatenate([a + s[keep][:, None] * (b - a) + t[keep][:, None] * (c - a) for a, b, c in corners])
    if len(centres):
        off = np.sqrt(((centres[:, None] - samples[None]) ** 2).sum(axis=2)).min(axis=1)
        assert off.max() < size * (np.sqrt(3) / 2) + 0.4  # half a voxel's diagonal, and the samples' spacing


def test_clearance_is_the_distance_within_thirteen_percent() -> None:
    rng = np.random.default_rng(3)
    occupied = rng.random((14, 15, 16)) < 0.01
    found = clearance(occupied)
    exact = np.sqrt(((np.argwhere(np.ones_like(occupied))[:, None] - np.argwhere(occupied)[None]) ** 2).sum(axis=2))
    nearest = exact.min(axis=1).reshape(occupied.shape)
    assert (found >= nearest - 1e-4).all()
    assert (found <= nearest * 1.13 + 1e-4).all()


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(0, 2), st.sampled_from([1, -1]))
def test_free_runs_count_up_to_the_next_occupied_voxel(seed: int, axis: int, sign: int) -> None:
    occupied = np.random.default_rng(seed).random((5, 6, 7)) < 0.2
    found = free_run(occupied, axis, sign)
    for voxel in np.ndindex(occupied.shape):
        at = list(voxel)
        count = 0
        while 0 <= at[axis] < occupied.shape[axis] and not occupied[tuple(at)]:
            at[axis] += sign
            count += 1
        ended = 0 <= at[axis] < occupied.shape[axis]
        assert found[voxel] == (max(count - 1, 0) if ended else -1)


def test_enclosure_counts_directions_that_meet_something() -> None:
    occupied = np.zeros((20, 20, 5), bool)
    occupied[15] = True
    directions = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0.8, 0.6, 0]])
    facing = np.zeros((20, 20, 5, 3), np.float32)
    here = np.array([[5, 5, 2]])
    assert enclosure(occupied, facing, here, directions).tolist() == [0.5]
    facing[15, :, :, 0] = -1  # it faces the viewer
    assert enclosure(occupied, facing, here, directions).tolist() == [0.5]
    facing[15, :, :, 0] = 1  # it turns its back
    assert enclosure(occupied, facing, here, directions).tolist() == [0.0]


def box_between(one: np.ndarray, other: np.ndarray) -> tuple[slice, ...]:
    """The voxels that a step between two neighbours touches."""
    ends = zip(np.minimum(one, other).tolist(), np.maximum(one, other).tolist(), strict=True)
    return tuple(slice(first, last + 1) for first, last in ends)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_cheapest_ways_satisfy_bellman(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cost = np.where(rng.random((5, 5, 4)) < 0.3, np.inf, rng.uniform(1, 5, (5, 5, 4))).astype(np.float32)
    start = int(rng.integers(cost.size))
    cost.ravel()[start] = 1.0
    total, before = cheapest_ways(cost, start)
    places = np.stack(np.unravel_index(np.arange(cost.size), cost.shape), axis=1)
    flat = cost.ravel()
    assert total[start] == 0
    for here in range(cost.size):
        near = np.flatnonzero(np.abs(places - places[here]).max(axis=1) == 1)
        near = near[[np.isfinite(cost[box_between(places[here], places[other])]).all() for other in near]]
        steps = np.sqrt(((places[near] - places[here]) ** 2).sum(axis=1)) * (flat[near] + flat[here]) / 2
        best = (total[near] + steps).min(initial=np.inf)
        if here != start:
            assert np.isclose(total[here], best, rtol=1e-5) or (np.isinf(total[here]) and np.isinf(best))
            assert (before[here] >= 0) == np.isfinite(total[here])
