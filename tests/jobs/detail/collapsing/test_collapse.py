"""Collapses of edges and pairs: what they promise, on meshes of any topology."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.detail.collapsing.clean import cleaned
from jobs.detail.collapsing.collapse import NO_PAIRS, begin, collapse, snapshot
from jobs.detail.collapsing.near_pairs import near_pairs
from jobs.objects.components import components
from jobs.objects.weld import twins, weld
from tests.jobs.detail.sampling import sample
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
    state = begin(points, triangles, twins(triangles), stays, np.zeros((3 * len(triangles), 4), np.uint8), NO_PAIRS)
    collapse(state, target, limit)
    return *snapshot(state)[:3], float(state.error[0])


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
    state = begin(points, triangles, twins(triangles), np.zeros(len(points), np.bool_), colours, NO_PAIRS)
    collapse(state, 4, 0.6)
    new_points, new_triangles, source, _ = snapshot(state)
    assert len(new_triangles) == 4
    for t, s in zip(new_triangles, source, strict=True):
        side = new_points[t][:, 0].mean() < points[:, 0].max() / 2
        assert side == left[s]


def test_the_same_mesh_gives_the_same_result() -> None:
    shape = joined([sphere(10, bumps=0.1), prism(7, 0.3, 2, 3)])
    a, b = simplified(shape, 100), simplified(shape, 100)
    assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(0, 60), st.booleans())
def test_any_soup_is_survived(seed: int, m: int, target: int, paired: bool) -> None:
    """Random triangles over few vertices: non-manifold everywhere. Something is left of each connected thing."""
    rng = np.random.default_rng(seed)
    points = np.unique(rng.integers(0, 4, (40, 3)) * 1000, axis=0).astype(np.int32)
    soup = rng.integers(0, len(points), (m, 3)).astype(np.int32)
    points, triangles, _ = cleaned(points, soup, True)
    if not len(triangles):
        return
    state = begin(
        points, triangles, twins(triangles), rng.random(len(points)) < 0.2, np.zeros((3 * len(triangles), 4), np.uint8),
        near_pairs(points, triangles, components(triangles, len(points))[0]) if paired else NO_PAIRS,
    )  # fmt: skip
    collapse(state, target, np.inf)
    _, new_triangles, source, _ = snapshot(state)
    assert 0 < len(new_triangles) <= len(triangles)
    label, things = components(triangles, len(points))
    assert paired or len(np.unique(label[source])) == things


def spread_boxes(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return on_grid(
        joined([box(tuple(lo), tuple(lo + rng.uniform(0.01, 0.5, 3))) for lo in rng.uniform(0, 4, (count, 3))])
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 60))
def test_pairs_join_different_things_once_each(seed: int, count: int) -> None:
    points, triangles = spread_boxes(seed, count)
    label, things = components(triangles, len(points))
    pairs = near_pairs(points, triangles, label)
    thing = np.zeros(len(points), np.int32)
    thing[triangles] = label[:, None]
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert (thing[pairs[:, 0]] != thing[pairs[:, 1]]).all()
    assert len(np.unique(pairs, axis=0)) == len(pairs) <= 2 * len(points)
    assert len(np.unique(thing[pairs])) == things  # everything has a neighbour


def test_pairs_are_near() -> None:
    """Boxes in a row, the gaps between them a tenth of their size: pairs bridge the gaps, not the row."""
    shape = joined([box((1.1 * i, 0, 0), (1.1 * i + 1, 1, 1)) for i in range(40)])
    points, triangles = on_grid(shape)
    pairs = near_pairs(points, triangles, components(triangles, len(points))[0])
    length = np.linalg.norm((points[pairs[:, 0]] - points[pairs[:, 1]]) * SCALE, axis=1)
    assert np.median(length) < 1.2


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.integers(1, 200))
def test_pairs_let_things_grow_together(seed: int, count: int, target: int) -> None:
    """With pairs any target can be met, whatever the number of things; and what is left lies where they were."""
    points, triangles = spread_boxes(seed, count)
    pairs = near_pairs(points, triangles, components(triangles, len(points))[0])
    state = begin(
        points,
        triangles,
        twins(triangles),
        np.zeros(len(points), np.bool_),
        np.zeros((3 * len(triangles), 4), np.uint8),
        pairs,
    )
    collapse(state, target, np.inf)
    new_points, new_triangles, source, _ = snapshot(state)
    assert 0 < len(new_triangles) <= max(target, count // 2 + 12)
    assert len(np.unique(source)) == len(source)
    rng = np.random.default_rng(seed)
    middle = (points.max(axis=0) + points.min(axis=0)) * SCALE / 2
    extent = float(np.linalg.norm(np.ptp(points, axis=0))) * SCALE
    after = sample(new_points * SCALE, new_triangles, 200, rng)
    assert np.linalg.norm(after - middle, axis=1).max() <= extent


def test_far_things_stay_apart_longer_than_near_ones() -> None:
    """Two clusters of boxes: each becomes one thing before they become one another."""
    rng = np.random.default_rng(3)
    near = [box(tuple(lo), tuple(lo + 0.05)) for lo in rng.uniform(0, 0.3, (12, 3))]
    far = [box(tuple(lo), tuple(lo + 0.05)) for lo in rng.uniform(0, 0.3, (12, 3)) + np.array([20, 0, 0])]
    points, triangles = on_grid(joined(near + far))
    pairs = near_pairs(points, triangles, components(triangles, len(points))[0])
    state = begin(
        points,
        triangles,
        twins(triangles),
        np.zeros(len(points), np.bool_),
        np.zeros((3 * len(triangles), 4), np.uint8),
        pairs,
    )
    collapse(state, 24, np.inf)
    new_points, new_triangles, _, _ = snapshot(state)
    side = new_points[new_triangles][:, :, 0] > new_points[:, 0].mean()
    assert (side.all(axis=1) | ~side.any(axis=1)).all()
    assert side.any()
    assert not side.all()
