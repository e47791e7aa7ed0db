"""Ways to steer: flying goes where one looks, walking stays level, stops at what is in the way and stands on floors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from player.camera.camera import Camera
from player.camera.steering import STEERINGS
from player.camera.steering.fly import Fly
from player.camera.steering.walk import Walk
from player.camera.view import Vector

EYES = 1.6


class Hall:
    """A floor at 0, a wall at x = 4 from `bottom` up, a ceiling at `height`."""

    def __init__(self, *, bottom: float = -math.inf, height: float = math.inf) -> None:
        self.floor, self.bottom, self.height = 0.0, bottom, height

    def distance(self, position: Vector, direction: Vector, up: Vector) -> float:
        """Along an axis, to whichever plane lies there."""
        if direction[0] > 0.99 and position[2] >= self.bottom:
            return 4 - float(position[0])
        if abs(direction[2]) > 0.99:
            plane = self.height if direction[2] > 0 else self.floor
            return (plane - float(position[2])) * float(direction[2])
        return math.inf


def _camera(*held: str, **pose: float) -> Camera:
    return Camera(np.array([0.0, 0, EYES]), yaw=0.0, pitch=pose.get("pitch", 0.0), up="z", speed=2.0, held=set(held))


def test_flying_goes_where_one_looks() -> None:
    camera = _camera("forward", pitch=0.5)
    Fly(Hall(), eye_height=EYES).move(camera, 0.5)
    assert np.allclose(camera.position, [math.cos(0.5), 0, EYES + math.sin(0.5)])


def test_walking_stays_level_and_goes_sideways() -> None:
    walk = Walk(Hall(), eye_height=EYES)
    camera = _camera("forward", pitch=0.5)
    walk.move(camera, 0.5)
    assert np.allclose(camera.position, [1, 0, EYES])
    camera.held = {"right"}
    walk.move(camera, 0.5)
    assert np.allclose(camera.position, [1, -1, EYES])


@pytest.mark.parametrize(("bottom", "stopped"), [(-math.inf, True), (0.8 * EYES, True), (1.2 * EYES, False)])
def test_walls_stop_knees_and_eyes_but_nothing_above_the_head_does(bottom: float, stopped: bool) -> None:
    camera = _camera("forward")
    walk = Walk(Hall(bottom=bottom), eye_height=EYES)
    for _ in range(100):
        walk.move(camera, 0.1)
    assert camera.position[0] == pytest.approx(4 - 0.2 * EYES if stopped else 20)


def test_standing_follows_the_floor() -> None:
    hall = Hall()
    camera = _camera()
    camera.position[2] = 5
    walk = Walk(hall, eye_height=EYES)
    for _ in range(100):
        walk.move(camera, 0.05)
    assert camera.position[2] == pytest.approx(EYES, abs=1e-3)
    hall.floor = -math.inf  # over an abyss one stays where one is
    walk.move(camera, 0.05)
    assert camera.position[2] == pytest.approx(EYES, abs=1e-3)


@pytest.mark.parametrize(("height", "rises"), [(2.5 * EYES, True), (1.4 * EYES, False)])
def test_what_is_higher_than_a_step_is_climbed_only_where_there_is_room_overhead(height: float, rises: bool) -> None:
    hall = Hall(height=height)
    hall.floor = 0.5 * EYES
    camera = _camera()
    Walk(hall, eye_height=EYES).move(camera, 0.05)
    assert (camera.position[2] > EYES) == rises


def test_every_way_to_steer_turns_and_moves() -> None:
    for offer in STEERINGS:
        camera = _camera("forward")
        steering = offer.load()(Hall(), eye_height=EYES)
        steering.turn(camera, 0.2, 0.0)
        assert camera.yaw == pytest.approx(-0.2)
        steering.move(camera, 0.1)
        assert np.linalg.norm(camera.position[:2]) == pytest.approx(0.2)
