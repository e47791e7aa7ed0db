"""Edge collapses and melting: what they promise, on meshes of any topology."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.detail.clean import cleaned
from jobs.detail.collapse import begin, collapse, snapshot
from jobs.detail.inner import joined_on_grid, melt
from jobs.objects.components import components
from jobs.objects.weld import twins, weld
from tests.jobs.detail.sampling import distances, sample
from tests.jobs.detail.shapes import Shape, box, grid, joined, sphere, torus

SCALE = 2.0**-16


def on_grid(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    points = np.rint(shape[0] / SCALE).astype(np.int32)
    ids, first = weld(points, np.zeros(len(points), np.int32))
    return points[first], ids[shape[1].astype(np.int64)].astype(np.int32)


def simplified(
    shape: Shape, target: int, locked: np.ndarray | None = None, limit: float = np.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    points, triangles = on_grid(shape)
    stays = np.zeros(len(points), np.bool_) if locked is None else locked
    state = begin(points, triangles, twins(triangles), stays, np.zeros((3 * len(triangles), 4), np.uint8))
    collapse(state, target, limit)
    return *snapshot(state), float(state.error[0])


def prism(sides: int, radius: float, length: float, x: float) -> Shape:
    """A closed pipe along z."""
    a = np.arange(sides)
    b = (a + 1) % sides
    angle = a * 2 * np.pi / sides
    ring = np.stack([x + radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([ring, ring + np.array([0, 0, length]), [[x, 0, 0], [x, 0, length]]])
    caps = [np.stack([0 * a + 2 * sides, b, a], 1), np.stack([0 * a + 2 * sides + 1, a + sides, b + sides], 1)]
    walls = [np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1)]
    return points, np.concatenate(walls + caps)


@pytest.mark.parametrize(
    "shape", [sphere(12), torus(), grid(25, np.zeros((25, 25))), joined([box(), prism(9, 1, 9, 4)])]
)
def test_targets_are_met(shape: Shape) -> None:
    for target in (len(shape[1]) // 2, len(shape[1]) // 8):
        _, triangles, source, _ = simplified(shape, target)
        assert target - 2 <= len(triangles) <= target
        assert len(np.unique(source)) == len(source)


def test_flat_surfaces_lose_their_triangles_without_error() -> None:
    points, triangles, _, error = simplified(grid(30, np.zeros((30, 30))), 2, limit=0.6)
    assert len(triangles) == 2
    assert error <= 0.5  # grid steps: rounding
    assert {tuple(p) for p in points.tolist()} == {(x, y, 0) for x in (0, 2**16) for y in (0, 2**16)}


def test_what_is_closed_stays_closed() -> None:
    """Every edge keeps an even number of triangles, whatever is left."""
    for shape in (sphere(10, bumps=0.2), torus(), joined([prism(12, 0.1, 5, i) for i in range(5)])):
        for target in (len(shape[1]) // 3, len(shape[1]) // 20, 2):
            _, triangles, _, _ = simplified(shape, target)
            edges = np.sort(np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
            _, counts = np.unique(edges, axis=0, return_counts=True)
            assert (counts % 2 == 0).all()


def test_nothing_connected_vanishes() -> None:
    shape = joined([prism(12, 0.05, 1 + i % 5, 0.5 * i) for i in range(30)])
    points, triangles, _, _ = simplified(shape, 0)
    assert components(triangles, len(points))[1] == 30
    at = np.unique(np.rint(points[triangles].mean(axis=1)[:, 0] * SCALE / 0.5)).tolist()
    assert at == list(range(30))


def test_long_things_keep_their_length() -> None:
    """A pipe of 40 diameters is still as long when it is as simple as its thickness allows."""
    points, triangles, _, error = simplified(prism(16, 0.05, 4, 0), 4)
    assert len(triangles) <= 4
    assert error * SCALE < 0.15
    assert (points[:, 2].max() - points[:, 2].min()) * SCALE > 3.8


def test_locked_vertices_and_the_edges_between_them_stay() -> None:
    shape = grid(20, np.random.default_rng(0).random((20, 20)) * 0.1)
    points, _ = on_grid(shape)
    locked = points[:, 0] == 0
    _, at_border, _, _ = simplified(shape, 30, locked)
    new_points, new_triangles, _, _ = simplified(shape, 30, locked)
    assert len(at_border) <= 40
    places = {tuple(p) for p in new_points.tolist()}
    assert {tuple(p) for p in points[locked].tolist()} <= places
    edges = {
        frozenset((tuple(new_points[t[i]]), tuple(new_points[t[(i + 1) % 3]]))) for t in new_triangles for i in range(3)
    }
    border = points[locked][np.argsort(points[locked, 1])]
    for a, b in pairwise(border):
        assert frozenset((tuple(a), tuple(b))) in edges


def test_colours_keep_their_borders() -> None:
    points, triangles = on_grid(grid(21, np.zeros((21, 21))))
    left = points[triangles][:, :, 0].mean(axis=1) < points[:, 0].max() / 2
    colours = np.repeat(np.where(left[:, None], [255, 0, 0, 255], [0, 0, 255, 255]), 3, axis=0).astype(np.uint8)
    state = begin(points, triangles, twins(triangles), np.zeros(len(points), np.bool_), colours)
    collapse(state, 4, 0.6)
    new_points, new_triangles, source = snapshot(state)
    assert len(new_triangles) == 4
    for t, s in zip(new_triangles, source, strict=True):
        side = new_points[t][:, 0].mean() < points[:, 0].max() / 2
        assert side == left[s]


def test_the_same_mesh_gives_the_same_result() -> None:
    shape = joined([sphere(10, bumps=0.1), prism(7, 0.3, 2, 3)])
    a, b = simplified(shape, 100), simplified(shape, 100)
    assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(0, 60))
def test_any_soup_is_survived(seed: int, m: int, target: int) -> None:
    """Random triangles over few vertices: non-manifold everywhere. Something is left of each connected thing."""
    rng = np.random.default_rng(seed)
    points = np.unique(rng.integers(0, 4, (40, 3)) * 1000, axis=0).astype(np.int32)
    soup = rng.integers(0, len(points), (m, 3)).astype(np.int32)
    points, triangles, _ = cleaned(points, soup, True)
    if not len(triangles):
        return
    state = begin(
        points, triangles, twins(triangles), rng.random(len(points)) < 0.2, np.zeros((3 * len(triangles), 4), np.uint8)
    )
    collapse(state, target, np.inf)
    _, new_triangles, source = snapshot(state)
    assert 0 < len(new_triangles) <= len(triangles)
    label, things = components(triangles, len(points))
    assert len(np.unique(label[source])) == things


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([0.02, 0.3, 3.0]))
def test_melting_moves_nothing_farther_than_a_cell(seed: int, count: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    things = [box(tuple(lo), tuple(lo + rng.uniform(0.01, 0.5, 3))) for lo in rng.uniform(0, 4, (count, 3))]
    points, triangles = on_grid(joined(things))
    locked = rng.random(len(points)) < 0.1
    melted, kept = melt(points, triangles, locked, size / SCALE)
    assert len(melted) > 0
    assert len(np.unique(kept)) == len(kept)
    reach = size * 3**0.5 * 1.0001 + 4 * SCALE
    before = sample(points * SCALE, triangles, 300, rng)
    after = sample(points * SCALE, melted, 300, rng)
    assert distances(before, points * SCALE, melted).max() <= reach
    assert distances(after, points * SCALE, triangles).max() <= reach
    into = joined_on_grid(points, locked, size / SCALE)
    assert (into[locked] == np.flatnonzero(locked)).all()
