"""Flying: where one looks, through everything."""

from __future__ import annotations

from player.camera.camera import Camera
from player.camera.steering.steering import Surroundings


class Fly:
    """Moves along the line of sight."""

    def __init__(self, surroundings: Surroundings, *, eye_height: float) -> None:
        """Neither matters to one who flies."""

    def turn(self, camera: Camera, right: float, up: float) -> None:
        """Looks elsewhere."""
        camera.turn(right, up)

    def move(self, camera: Camera, seconds: float) -> None:
        """Goes where the held keys say, and nothing stops it."""
        camera.position = camera.position + camera.asked(camera.forward, seconds)
