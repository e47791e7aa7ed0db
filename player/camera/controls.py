"""How keys and mouse move the camera: flying freely, or walking over floors. Knows nothing of windows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from player.camera.view import (
    AXES,
    Vector,
    direction_yaw_pitch,
    looking,
    rotation_matrix,
    up_vector,
    yaw_pitch_direction,
)

#: What a held key does, as a direction: right, up, forward.
MOVES: dict[str, tuple[float, float, float]] = {
    "forward": (0, 0, 1),
    "back": (0, 0, -1),
    "right": (1, 0, 0),
    "left": (-1, 0, 0),
    "up": (0, 1, 0),
    "down": (0, -1, 0),
}

_STEEPEST = math.radians(89)


@dataclass
class Camera:
    """A camera that is steered."""

    position: Vector  # (3,) model units
    yaw: float  # radians, around the up axis
    pitch: float  # radians above the horizon
    up: str  # the model's up axis
    speed: float  # model units per second
    walking: bool = False  # keeps to the horizontal, over floors
    held: set[str] = field(default_factory=set)  # names of MOVES, and "fast"

    @property
    def forward(self) -> Vector:
        """Unit direction (3,) of sight."""
        return yaw_pitch_direction(self.yaw, self.pitch, self.up)

    @property
    def orientation(self) -> Vector:
        """Unit quaternion (4,): camera to model."""
        return looking(self.forward, up_vector(self.up))

    def look_at(self, position: Vector, orientation: Vector) -> None:
        """Takes over a pose, but for any roll."""
        self.position = np.array(position, np.float64)
        self.yaw, self.pitch = direction_yaw_pitch(-rotation_matrix(orientation)[:, 2], self.up)

    def turn(self, right: float, up: float) -> None:
        """Turns by angles in radians."""
        self.yaw = (self.yaw - right + math.pi) % (2 * math.pi) - math.pi
        self.pitch = min(_STEEPEST, max(-_STEEPEST, self.pitch + up))

    def faster(self, notches: float) -> None:
        """Changes the speed by notches of the mouse wheel; negative ones slow down."""
        self.speed *= 1.2**notches

    def motion(self, seconds: float) -> Vector:
        """Displacement (3,) in model units that the held keys ask for in this time."""
        right, up, forward = (sum(MOVES[name][axis] for name in self.held & MOVES.keys()) for axis in range(3))
        up_direction = up_vector(self.up)
        ahead = yaw_pitch_direction(self.yaw, 0.0, self.up) if self.walking else self.forward
        sideways = np.cross(yaw_pitch_direction(self.yaw, 0.0, self.up), up_direction)
        direction = right * sideways + up * up_direction + forward * ahead
        length = float(np.sqrt((direction * direction).sum()))
        if length == 0:
            return np.zeros(3)
        return direction / length * self.speed * seconds * (4 if "fast" in self.held else 1)

    def stand(self, floor: float, eye_height: float, seconds: float) -> None:
        """Brings the eye towards `eye_height` above a floor that lies `floor` model units below it."""
        if math.isfinite(floor):
            axis = AXES[self.up]
            self.position[axis] += (eye_height - floor) * (1 - math.exp(-10 * seconds))
