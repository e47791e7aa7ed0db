"""A steered camera: poses, turning, and what held keys ask for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from player.camera.camera import Camera


def test_a_pose_is_taken_over() -> None:
    for up in ("x", "y", "z"):
        one = Camera(np.array([1.0, 2, 3]), yaw=2.5, pitch=-0.4, up=up, speed=1)
        other = Camera(np.zeros(3), 0, 0, up, 1)
        other.look_at(one.position, one.orientation)
        assert np.allclose(other.position, one.position)
        assert (other.yaw, other.pitch) == pytest.approx((2.5, -0.4))


def test_one_cannot_look_over_the_top() -> None:
    camera = Camera(np.zeros(3), 0, 0, "y", 1)
    camera.turn(0, 10)
    assert camera.pitch < math.pi / 2


def test_shift_makes_four_times_as_fast_and_opposite_keys_cancel() -> None:
    camera = Camera(np.zeros(3), 0, 0, "z", speed=2.0)
    camera.hold("up", True)
    assert np.allclose(camera.asked(camera.forward, 0.5), [0, 0, 1])
    camera.hold("fast", True)
    assert np.allclose(camera.asked(camera.forward, 0.5), [0, 0, 4])
    camera.hold("down", True)
    assert not camera.asked(camera.forward, 0.5).any()
    camera.hold("up", False)
    assert np.allclose(camera.asked(camera.forward, 0.5), [0, 0, -4])
