"""Rooms, for offices and for the city's buildings.

A room lies north or south of a corridor that runs along x. Along the corridor's wall a strip stays free, so that a
person can step in and walk on to the next room.
"""

from __future__ import annotations

from dataclasses import dataclass

STOREY, CLEAR = 3.5, 3.25  # metres floor to floor, floor to ceiling
OUTER, INNER = 0.25, 0.125  # metres, thickness of outer and inner walls
DOOR_WIDTH, DOOR_HEIGHT = 1.0, 2.125  # metres
STRIP = 1.25  # metres along the corridor wall, inside the rooms, where nothing stands


@dataclass(frozen=True)
class Room:
    """One room; lengths in metres in the storey's coordinates."""

    number: int
    north: bool  # of the corridor
    x0: float  # the floor's bounds
    x1: float
    y0: float
    y1: float
    door: float  # the door's middle (x)
    open: bool  # the door
    angle: float  # of the open door's leaf, in degrees
    hinge_east: bool  # on which side the leaf is hung
    kind: str

    @property
    def strip(self) -> float:
        """The middle (y) of the strip along the corridor wall."""
        return self.y0 + STRIP / 2 if self.north else self.y1 - STRIP / 2
