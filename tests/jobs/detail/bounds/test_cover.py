"""Bounds by covering: what they say holds on any surface, with holes and folds, and they do say something."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from jobs.detail.bounds.cover import Cover, covered
from jobs.detail.bounds.hausdorff import hausdorff_bound, point_distances
from tests.jobs.detail.sampling import distances, sample
from tests.jobs.detail.shapes import Shape, box, grid, joined, sphere, surface_of, torus

SIZE = 1e4  # grid steps


def bound_by_covering(corners: np.ndarray, points: np.ndarray, triangles: np.ndarray, limit: float) -> float:
    """`covered` for one triangle (3, 3), with the flood begun where its corners and its centre are nearest."""
    surface = surface_of(points, triangles)
    places = np.append(corners, [corners.mean(axis=0)], axis=0)
    begin = np.unique([point_distances(places[i : i + 1], surface, 0.0)[0][0] for i in range(4)]).astype(np.int32)
    seen = np.full(len(surface.triangles), -1, np.int32)
    flood = np.empty(len(surface.triangles), np.int32)
    flood[: len(begin)] = begin
    seen[begin] = 0
    cover = Cover(seen, flood, np.empty((2, 16, 3)))
    return float(covered(corners, np.arange(3, dtype=np.int32), surface, limit, cover, 0, len(begin)))


def uneven(seed: int, height: float) -> Shape:
    """A welded sheet over the unit square, with a fold where it is steep."""
    rng = np.random.default_rng(seed)
    points, triangles = grid(12, height * rng.standard_normal((12, 12)))
    points[:, :2] += rng.uniform(-0.03, 0.03, (len(points), 2))
    return points * SIZE, triangles


@settings(max_examples=200, deadline=None)
@given(
    st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.01, 0.1]), st.sampled_from([0.02, 0.2, 2.0]), st.integers(0, 60)
)
def test_what_is_covered_is_as_near_as_said(seed: int, height: float, limit: float, holes: int) -> None:
    """Some triangle, over or beside a sheet with holes: if there is a bound, no sample lies farther away."""
    rng = np.random.default_rng(seed)
    points, triangles = uneven(seed, height)
    triangles = np.delete(triangles, rng.choice(len(triangles), holes, replace=False), axis=0)
    corners = np.append(rng.uniform(-0.1, 1.1, (3, 2)), rng.normal(0, height, (3, 1)), axis=1) * SIZE
    bound = bound_by_covering(corners, points, triangles, limit * SIZE)
    if np.isfinite(bound):
        assert bound <= limit * SIZE
        on = sample(corners, np.array([[0, 1, 2]]), 400, rng)
        assert distances(on, points, triangles).max() <= bound


def test_a_triangle_over_a_sheet_is_covered() -> None:
    """And the bound is its height above the sheet, give or take what the sheet varies by."""
    points, triangles = uneven(1, 0.001)
    corners = np.array([[0.1, 0.1, 0.02], [0.9, 0.2, 0.02], [0.4, 0.8, 0.02]]) * SIZE
    assert 0.02 * SIZE < bound_by_covering(corners, points, triangles, 0.03 * SIZE) < 0.026 * SIZE
    assert bound_by_covering(corners, points, triangles, 0.01 * SIZE) == np.inf


def test_a_triangle_of_the_sheet_itself_is_covered() -> None:
    """Its edges are the sheet's own edges, at the rim and inside: they do not get in the way."""
    points, triangles = grid(8, np.zeros((8, 8)))
    points = points * SIZE
    for t in (triangles[0], triangles[40], np.array([0, 7, 63]), np.array([0, 63, 56])):
        assert bound_by_covering(points[t], points, triangles, 5.0) <= 0.11


def test_a_hole_is_seen() -> None:
    points, triangles = grid(20, np.zeros((20, 20)))
    points = points * SIZE
    corners = np.array([[0.1, 0.1, 0], [0.9, 0.1, 0], [0.1, 0.9, 0.0]]) * SIZE
    assert bound_by_covering(corners, points, triangles, 50.0) <= 1.01
    inside = (points[triangles].mean(axis=1)[:, :2] / SIZE < 0.35).all(axis=1) & (
        points[triangles].mean(axis=1)[:, :2] / SIZE > 0.25
    ).all(axis=1)
    assert bound_by_covering(corners, points, triangles[~inside], 50.0) == np.inf


def test_two_layers_do_not_cancel() -> None:
    """A closed box under a triangle: the flood stays on the side that faces it."""
    points, triangles = box((0, 0, 0), (1, 1, 0.01))
    points = points * SIZE
    corners = np.array([[0, 0, 0.01], [1, 0, 0.01], [1, 1, 0.01]]) * SIZE
    assert bound_by_covering(corners, points, triangles, 5.0) <= 0.11


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, 30.0, 1000.0]), st.integers(0, 40))
@example(2_789_629_938, 1000.0, 0)
@example(118_887, 1000.0, 0)
def test_bound_holds_between_connected_surfaces(seed: int, noise: float, holes: int) -> None:
    """Closed and open surfaces against shaken, holed copies of them: sampled distances stay below the bound."""
    rng = np.random.default_rng(seed)
    points, triangles = joined([sphere(8), torus(16, 8), box(), uneven(seed, 0.02)])
    points = points * np.where(np.abs(points) > 100, 1, SIZE)
    shaken = points + rng.normal(0, noise, points.shape)
    left = np.delete(triangles, rng.choice(len(triangles), holes, replace=False), axis=0)
    a, b = surface_of(points, triangles), surface_of(shaken, left)
    bound, lower = hausdorff_bound(a, b, 0.0, 1.0, 1.25)
    there = distances(sample(points, triangles, 400, rng), shaken, left).max()
    back = distances(sample(shaken, left, 400, rng), points, triangles).max()
    assert max(there, back) <= bound + 1e-6
    assert bound <= max(2.0 * lower, 1.0)  # they cross each other everywhere, so that the effort may run out
