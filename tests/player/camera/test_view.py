"""Cameras, projection and the frustum test, against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from player.camera.view import (
    View,
    boxes_between,
    boxes_in_frustum,
    direction_yaw_pitch,
    looking,
    normalised,
    quaternion_of,
    rotation_matrix,
    yaw_pitch_direction,
)
from storage.base.errors import ParameterError
from tests.player.conftest import view_from

quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(x * x for x in q) > 1e-2)
numbers = st.floats(-50, 50)
points = st.tuples(numbers, numbers, numbers)


@given(quaternions)
def test_quaternion_and_matrix_are_inverse(q: tuple[float, ...]) -> None:
    rotation = rotation_matrix(q)
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.isclose(np.linalg.det(rotation), 1)
    assert np.allclose(rotation_matrix(quaternion_of(rotation)), rotation, atol=1e-9)


@pytest.mark.parametrize("up", ["x", "y", "z"])
@given(yaw=st.floats(-3.1, 3.1), pitch=st.floats(-1.5, 1.5))
def test_yaw_and_pitch_are_inverse(up: str, yaw: float, pitch: float) -> None:
    found = direction_yaw_pitch(yaw_pitch_direction(yaw, pitch, up), up)
    assert np.allclose(found, (yaw, pitch), atol=1e-6)


def test_a_camera_looks_where_it_is_told_with_its_head_up() -> None:
    rotation = rotation_matrix(looking((1, 2, -0.5), (0, 0, 1)))
    assert np.allclose(-rotation[:, 2], normalised([1, 2, -0.5]))
    assert abs(rotation[2, 0]) < 1e-12  # the right-hand axis is level
    assert rotation[2, 1] > 0


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1)])
def test_a_camera_may_look_straight_up_or_down(direction: tuple[float, ...]) -> None:
    assert np.allclose(-rotation_matrix(looking(direction, (0, 0, 1)))[:, 2], direction)


@pytest.mark.parametrize("reversed_depth", [True, False])
def test_depth_runs_from_the_near_plane_to_the_far_one(reversed_depth: bool) -> None:
    view = view_from((0, 0, 0), (1, 0, 0), near=0.5, far=200)
    near, far = (view.projection(reversed_depth) @ [0, 0, -distance, 1] for distance in (0.5, 200))
    if reversed_depth:
        assert np.isclose(near[2] / near[3], 1)
        assert np.isclose(far[2] / far[3], 0.5 / 200)
    else:
        assert np.isclose(near[2] / near[3], -1)
        assert np.isclose(far[2] / far[3], 1)


def test_the_corner_of_the_lens_is_the_corner_of_the_picture() -> None:
    view = view_from((0, 0, 0), (1, 0, 0), size=(200, 100), field_of_view=90)
    clip = view.projection(True) @ [2, 1, -1, 1]
    assert np.allclose(clip[:2] / clip[3], [1, 1])


@given(points, points, st.lists(st.tuples(points, points), min_size=1, max_size=8))
def test_no_box_with_a_visible_point_is_culled(
    eye: tuple[float, ...], direction: tuple[float, ...], boxes: list[tuple[tuple[float, ...], tuple[float, ...]]]
) -> None:
    direction = direction if np.abs(direction).max() > 1e-3 else (1.0, 0.0, 0.0)
    view = View(np.array(eye), looking(direction, (0, 0, 1)), 60, 160, 90, 0.01, 1000)
    lo = np.array([np.minimum(a, b) for a, b in boxes], np.float32)
    hi = np.array([np.maximum(a, b) for a, b in boxes], np.float32)
    kept = boxes_in_frustum(view, boxes_between(lo, hi))
    steps = np.stack(np.meshgrid(*[np.linspace(0, 1, 5)] * 3), axis=-1).reshape(-1, 3)
    for low, high, inside in zip(lo, hi, kept, strict=True):
        samples = low + steps * (high - low).astype(np.float64)
        camera = (samples - view.position) @ view.rotation
        clip = camera @ view.projection(True)[:3, :3].T
        depth = -camera[:, 2]
        seen = (depth > view.near) & (np.abs(clip[:, 0]) < depth) & (np.abs(clip[:, 1]) < depth)
        assert inside or not seen.any()


def test_boxes_behind_and_beside_are_culled() -> None:
    view = view_from((0, 0, 0), (1, 0, 0), field_of_view=60)
    lo = np.array([[-5, -1, -1], [5, -1, -1], [5, 60, -1], [-1, -1, -1]], np.float32)
    assert boxes_in_frustum(view, boxes_between(lo, lo + 2)).tolist() == [False, True, False, True]


@pytest.mark.parametrize(("field", "size"), [(0.0, (4, 4)), (180.0, (4, 4)), (60.0, (0, 4))])
def test_impossible_views_are_refused(field: float, size: tuple[int, int]) -> None:
    with pytest.raises(ParameterError):
        view_from((0, 0, 0), (1, 0, 0), field_of_view=field, size=size)
