"""A camera that is steered: where it is, where it looks, how fast it is, and which keys are held. Knows no windows."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from player.camera.view import (
    Vector,
    direction_yaw_pitch,
    looking,
    rotation_matrix,
    up_vector,
    yaw_pitch_direction,
)

#: What a held key asks for, as a direction: right, up, forward.
MOVES: dict[str, tuple[float, float, float]] = {
    "forward": (0, 0, 1),
    "back": (0, 0, -1),
    "right": (1, 0, 0),
    "left": (-1, 0, 0),
    "up": (0, 1, 0),
    "down": (0, -1, 0),
}

#: What is held to move four times as fast.
FAST = "fast"

_STEEPEST = math.radians(89)


@dataclass
class Camera:
    """A camera that is steered."""

    position: Vector  # (3,) model units
    yaw: float  # radians, around the up axis
    pitch: float  # radians above the horizon
    up: str  # the model's up axis
    speed: float  # model units per second
    held: set[str] = field(default_factory=set)  # names of MOVES, and FAST

    @property
    def forward(self) -> Vector:
        """Unit direction (3,) of sight."""
        return yaw_pitch_direction(self.yaw, self.pitch, self.up)

    @property
    def level(self) -> Vector:
        """Unit direction (3,) of sight without its rise or fall."""
        return yaw_pitch_direction(self.yaw, 0.0, self.up)

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

    def hold(self, name: str, down: bool) -> None:
        """A key that stands for one of MOVES, or for FAST, went down or up."""
        if down:
            self.held.add(name)
        else:
            self.held.discard(name)

    def asked(self, ahead: Vector, seconds: float) -> Vector:
        """Displacement (3,) in model units that the held keys ask for in this time; ahead (3,): where forward is."""
        right, up, forward = (sum(MOVES[name][axis] for name in self.held & MOVES.keys()) for axis in range(3))
        up_direction = up_vector(self.up)
        direction = right * np.cross(self.level, up_direction) + up * up_direction + forward * ahead
        length = float(np.sqrt((direction * direction).sum()))
        if length == 0:
            return np.zeros(3)
        return direction / length * self.speed * seconds * (4 if FAST in self.held else 1)
