"""What a way to steer is: it moves and turns a camera by what is held and dragged."""

from __future__ import annotations

from typing import Protocol

from player.camera.camera import Camera
from player.camera.view import Vector


class Surroundings(Protocol):
    """What is around a camera."""

    def distance(self, position: Vector, direction: Vector, up: Vector) -> float:
        """Distance in model units from `position` (3,) to the nearest surface along a unit direction (3,).

        Infinite where there is none. up: any direction (3,) across it.
        """
        ...


class Steering(Protocol):
    """A way to steer."""

    def turn(self, camera: Camera, right: float, up: float) -> None:
        """The mouse was dragged by angles in radians."""
        ...

    def move(self, camera: Camera, seconds: float) -> None:
        """So much time has passed with the camera's keys held."""
        ...


class MakeSteering(Protocol):
    """How a way of player.camera.steering.STEERINGS is made."""

    def __call__(self, surroundings: Surroundings, *, eye_height: float) -> Steering:
        """eye_height: of a walker, in model units."""
        ...
