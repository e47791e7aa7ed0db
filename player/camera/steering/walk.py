"""Walking: level, over floors and up steps, stopped by walls and furniture."""

from __future__ import annotations

import math

import numpy as np

from player.camera.camera import Camera
from player.camera.steering.steering import Surroundings
from player.camera.view import AXES, Vector, up_vector

#: Height of a walker's knees, as a part of the eyes' height: what is lower is stepped on, what is higher is in the way.
_KNEE = 0.35

#: How near to what is in the way a walker comes, as a part of the eyes' height.
_NEAREST = 0.2

#: Room from the floor to the ceiling that a walker needs to rise, as a part of the eyes' height.
_HEADROOM = 1.1

#: How fast the eyes come to their height over the floor, per second.
_RISE = 10.0


class Walk:
    """Keeps the eyes at their height above the floor."""

    def __init__(self, surroundings: Surroundings, *, eye_height: float) -> None:
        self._surroundings = surroundings
        self._eyes = eye_height

    def turn(self, camera: Camera, right: float, up: float) -> None:
        """Looks elsewhere."""
        camera.turn(right, up)

    def move(self, camera: Camera, seconds: float) -> None:
        """Goes where the held keys say as far as nothing is in the way, and stands on what is below."""
        motion = camera.asked(camera.level, seconds)
        camera.position = camera.position + self._unhindered(camera, motion)
        self._stand(camera, seconds)

    def _unhindered(self, camera: Camera, motion: Vector) -> Vector:
        """The part of a motion (3,) that walls and furniture allow: what is in the way of eyes or knees stops it."""
        length = float(np.sqrt((motion * motion).sum()))
        if length == 0:
            return motion
        up = up_vector(camera.up)
        heights = [camera.position, camera.position - (1 - _KNEE) * self._eyes * up]
        free = min(self._surroundings.distance(height, motion / length, up) for height in heights)
        return motion * max(0.0, min(length, free - _NEAREST * self._eyes)) / length

    def _stand(self, camera: Camera, seconds: float) -> None:
        """Keeps the eyes above the floor; they rise by more than a step only where there is room overhead."""
        up = up_vector(camera.up)
        floor = self._surroundings.distance(camera.position, -up, camera.forward)
        if math.isinf(floor):
            return
        if floor < (1 - _KNEE) * self._eyes:
            overhead = self._surroundings.distance(camera.position, up, camera.forward)
            if floor + overhead < _HEADROOM * self._eyes:
                return
        camera.position[AXES[camera.up]] += (self._eyes - floor) * (1 - math.exp(-_RISE * seconds))
