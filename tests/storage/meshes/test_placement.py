"""How placements move positions and normals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.meshes.placement import IDENTITY, normal_matrix, placed, transform_points
from storage.model.tables import Grid


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-3, 1.0, 1e4]))
def test_the_normal_of_a_moved_triangle_is_the_moved_normal(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(3, 4)) * scale
    corners = rng.normal(size=(3, 3))
    moved = transform_points(matrix, corners)
    linear, mirrored = normal_matrix(matrix)
    assert mirrored == (np.linalg.det(matrix[:, :3]) < 0)
    a, b, c = corners
    normal = linear @ np.cross(b - a, c - a)
    a, b, c = moved[[0, 2, 1]] if mirrored else moved
    truth = np.cross(b - a, c - a)
    size = np.abs(matrix[:, :3]).max() ** 2 * np.abs(corners).max() ** 2
    np.testing.assert_allclose(normal, truth, rtol=0, atol=1e-10 * size * (1 + np.abs(matrix[:, 3]).max() / scale))


def test_a_placement_that_flattens_does_not_mirror() -> None:
    matrix = np.array([[1.0, 0, 0, 5], [0, 1, 0, 6], [0, 0, 0, 7]])
    linear, mirrored = normal_matrix(matrix)
    assert not mirrored
    assert linear.tolist() == [[0, 0, 0], [0, 0, 0], [0, 0, 1]]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mirror_keeps_normals_on_their_side(axis: int) -> None:
    matrix = np.eye(3, 4)
    matrix[axis, axis] = -1
    linear, mirrored = normal_matrix(matrix)
    assert mirrored
    assert np.array_equal(linear, matrix[:, :3])


@given(st.integers(0, 2**32 - 1), st.integers(-20, -10), st.integers(-12, -8))
def test_placed_points_are_moved_and_snapped(seed: int, scale: int, step: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(-(1 << 20), 1 << 20, (50, 3)).astype(np.int32)
    matrix = np.append(rng.normal(size=(3, 3)), rng.uniform(-100, 100, (3, 1)), axis=1)
    moved = transform_points(matrix, points * 2.0**scale)
    assert np.array_equal(placed(points, 2.0**scale, matrix, 2.0**step), Grid(2.0**step).snap(moved))


def test_what_lies_in_place_stays() -> None:
    points = np.array([[1, -2, 3], [(1 << 23) - 1, 0, -(1 << 23)]], np.int32)
    assert np.array_equal(placed(points, 0.125, IDENTITY, 0.125), points)
