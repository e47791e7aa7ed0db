"""How placements move positions and normals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.placement import normal_matrix, transform_points


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
