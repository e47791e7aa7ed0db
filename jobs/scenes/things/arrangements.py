"""What may stand where in a room: a table, kind by kind.

An arrangement is one or more stands, repeated at every spot that a room has for it; a stand is a thing, or several that
belong together. Nothing stands in the strip along the corridor wall.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from jobs.scenes.things.draft import Point
from jobs.scenes.things.rooms import CLEAR, DOOR_WIDTH, STRIP, Room
from jobs.scenes.things.solids import turn_z


@dataclass(frozen=True)
class Item:
    """Something to be placed in a room if the triangles last: a thing of the stock and where it stands."""

    room: int
    priority: int
    thing: str
    at: Point
    degrees: float


@dataclass(frozen=True)
class _Thing:
    """A thing of the stock as a part of a stand: where it is from the stand's middle, in metres."""

    priority: int
    name: str
    dx: float = 0.0
    dy: float = 0.0
    z: float = 0.0  # above the floor
    degrees: float = 0.0


@dataclass(frozen=True)
class _Stand:
    """Things that stand together; lengths in metres."""

    things: tuple[_Thing, ...]
    dx: float = 0.0  # from the spot
    far: float = 0.0  # from the spot, away from the facade
    degrees: float = 0.0
    facing: bool = False  # it is turned with the room: half a turn more where the room lies north
    deeper: float = -np.inf  # it stands only in rooms whose depth, without the strip, is more


@dataclass(frozen=True)
class _Space:
    """What of a room may be filled; lengths in metres."""

    room: Room

    @property
    def width(self) -> float:
        return self.room.x1 - self.room.x0

    @property
    def deep(self) -> float:
        return self.room.y1 - self.room.y0 - STRIP

    @property
    def middle(self) -> float:
        return (self.room.x0 + self.room.x1) / 2

    def y(self, far: float) -> float:
        """The place at a distance from the facade's inner face."""
        return self.room.y1 + -far if self.room.north else self.room.y0 + far


#: Where in a room something may stand: x, and the distance from the facade.
_Spots = Callable[[_Space], Iterator[tuple[float, float]]]


@dataclass(frozen=True)
class _Arrangement:
    """Stands at each of a room's spots; where there are several groups of them, they take turns from spot to spot."""

    spots: _Spots
    groups: tuple[tuple[_Stand, ...], ...]


def _at(spots: _Spots, *stands: _Stand) -> _Arrangement:
    return _Arrangement(spots, (stands,))


def _one(
    priority: int,
    name: str,
    dx: float = 0.0,
    far: float = 0.0,
    z: float = 0.0,
    degrees: float = 0.0,
    *,
    facing: bool = False,
    deeper: float = -np.inf,
) -> _Stand:
    """A stand of a single thing."""
    return _Stand((_Thing(priority, name, z=z),), dx, far, degrees, facing, deeper)


def _west(space: _Space) -> Iterator[tuple[float, float]]:
    yield space.room.x0, 0.0


def _east(space: _Space) -> Iterator[tuple[float, float]]:
    yield space.room.x1, 0.0


def _middle(space: _Space) -> Iterator[tuple[float, float]]:
    yield space.middle, 0.0


def _west_by_the_strip(space: _Space) -> Iterator[tuple[float, float]]:
    yield space.room.x0, space.deep


def _narrow_middle(space: _Space) -> Iterator[tuple[float, float]]:
    if space.width < 4.9:
        yield space.middle, 0.0


def _wide_middle(space: _Space) -> Iterator[tuple[float, float]]:
    if space.width >= 4.9:
        yield space.middle, 0.0


def _along_the_facade(space: _Space) -> Iterator[tuple[float, float]]:
    """Every 2.5 metres or so."""
    count = max(1, round(space.width / 2.5))
    for k in range(count):
        yield space.room.x0 + (k + 0.5) * space.width / count, 0.0


def _between_desks(space: _Space) -> Iterator[tuple[float, float]]:
    """The middles of pairs of desks."""
    pairs = max(1, int((space.width - 1.8) / 3.4))
    for k in range(pairs):
        yield space.room.x0 + 0.4 + (k + 0.5) * (space.width - 0.8) / pairs, 0.0


def _seats(space: _Space) -> Iterator[tuple[float, float]]:
    for x in np.arange(space.room.x0 + 1.3, space.room.x1 - 1.0, 2.4).tolist():
        yield x, 0.0


def _shelf_rows(space: _Space) -> Iterator[tuple[float, float]]:
    """Two rows in narrow rooms, else three."""
    gaps = 1 if space.width < 5.5 else 2
    for row in range(gaps + 1):
        yield space.room.x0 + 1.4 + row * (space.width - 2.6) / gaps, 0.0


_SIDES = (-1.0, 1.0)

#: The person sits on the -y side.
_WORKPLACE = (
    _Thing(0, "desk"),
    _Thing(1, "chair", 0.05, -0.72, 0.0, 180.0),
    _Thing(2, "monitor", -0.1, 0.22, 0.75),
    _Thing(2, "computer", -0.62, 0.08),
    _Thing(4, "keyboard", -0.1, -0.12, 0.75),
    _Thing(6, "desk lamp", 0.62, 0.2, 0.75),
    _Thing(3, "desk things", 0.3, -0.05, 0.75),
    _Thing(7, "cup", -0.5, -0.2, 0.75, 40.0),
)

_MEETING_ALONG_Y = (
    _Thing(0, "meeting table", degrees=90.0),
    *(
        thing
        for k in range(3)
        for side in _SIDES
        for thing in (
            _Thing(1, "visitor chair", side * 0.95, (k - 1) * 1.1, 0.0, 90.0 * side),
            _Thing(7, "cup", side * 0.4, (k - 1) * 1.1, 0.75, 20.0 * k),
        )
    ),
)

_MEETING_ALONG_X = (
    _Thing(0, "meeting table"),
    *(
        thing
        for k in range(3)
        for side in _SIDES
        for thing in (
            _Thing(1, "visitor chair", (k - 1) * 1.1, side * 0.95, 0.0, 0.0 if side > 0 else 180.0),
            _Thing(7, "cup", (k - 1) * 1.1, side * 0.4, 0.75, 20.0 * k),
        )
    ),
)

_DINING = (
    _Thing(0, "desk"),
    *(
        thing
        for side in _SIDES
        for dx in (-0.4, 0.4)
        for thing in (
            _Thing(1, "visitor chair", dx, 0.65 * side, 0.0, 0.0 if side > 0 else 180.0),
            _Thing(7, "cup", dx, 0.2 * side, 0.75),
        )
    ),
)


def _back_to_back(row: int) -> tuple[_Thing, ...]:
    """Two shelves; those in the first rows come first."""
    return tuple(_Thing(1 + row, "shelf", 0.16 * side, degrees=90.0 * side) for side in _SIDES)


_DESKS = _at(
    _between_desks,
    *(
        stand
        for side in _SIDES
        for stand in (
            _Stand(_WORKPLACE, side * 0.42, 1.5, -90.0 * side),
            _Stand(_WORKPLACE, side * 0.42, 3.3, -90.0 * side, deeper=3.8),
        )
    ),
)

#: In every room.
_EVERYWHERE = (
    _at(
        _along_the_facade,
        _one(1, "ceiling lamp", far=1.6, z=CLEAR, degrees=90.0),
        _one(2, "ceiling lamp", far=3.8, z=CLEAR, degrees=90.0),
        _one(2, "radiator", far=0.08),
    ),
    _at(_west_by_the_strip, _one(2, "bin", 0.3, -0.2)),
)

#: By the room's kind.
_ARRANGEMENTS: dict[str, tuple[_Arrangement, ...]] = {
    "office": (_DESKS,),
    "open": (_DESKS,),
    "meeting": (
        _at(_narrow_middle, _Stand(_MEETING_ALONG_Y, far=2.4)),
        _at(_wide_middle, _Stand(_MEETING_ALONG_X, far=2.4)),
        _at(_east, _one(1, "whiteboard", -0.02, 2.4, degrees=-90.0)),
    ),
    "lounge": (
        _Arrangement(
            _seats,
            tuple(
                (
                    _one(0, sofa, far=0.75, degrees=180.0, facing=True),
                    _one(3, "cushion", -0.5, 0.75, 0.42),
                    _one(1, "visitor chair", far=3.2, facing=True),
                )
                for sofa in ("sofa red", "sofa blue")
            ),
        ),
        _at(_west, _one(5, "pot plant", 0.4, 3.9, degrees=30.0)),
    ),
    "bedroom": (
        _at(
            _middle,
            _one(0, "bed", far=1.15, degrees=180.0, facing=True),
            _one(3, "cushion", 0.3, 1.0, 0.5),
        ),
        _at(_east, _one(1, "wardrobe", -0.35, 2.9, degrees=-90.0, deeper=3.2)),
        _at(_west_by_the_strip, _Stand(_WORKPLACE, 1.3, -0.5, facing=True)),
    ),
    "bath": (
        _at(
            _west,
            _one(0, "toilet", 0.9, 0.45, degrees=180.0, facing=True),
            _one(0, "basin", 2.0, 0.3, degrees=180.0, facing=True),
            _one(2, "basin", 2.8, 0.3, degrees=180.0, facing=True),
        ),
        _at(_east, _one(3, "cabinet", -0.3, 1.6, degrees=-90.0)),
    ),
    "kitchen": (
        _at(
            _west,
            _one(0, "kitchen", 0.36, 2.2, degrees=90.0),
            *(_Stand(_DINING, 2.4, 1.2 + 2.1 * k) for k in range(2)),
        ),
    ),
    "library": (
        _Arrangement(
            _shelf_rows,
            tuple(tuple(_Stand(_back_to_back(row), far=0.75 + k) for k in range(4)) for row in range(3)),
        ),
    ),
}

#: Kinds of rooms with nothing along the west wall, and along the east wall.
_BARE_WEST, _BARE_EAST = ("kitchen", "bath", "bedroom"), ("meeting", "bath", "bedroom")


def room_items(room: Room) -> Iterator[Item]:
    """What the room may hold."""
    space = _Space(room)
    yield _door_leaf(room)
    for arrangement in _EVERYWHERE:
        yield from _items(arrangement, space)
    yield Item(room.number, 5, "pot plant", (room.x1 - 0.35, space.y(0.5), 0.0), float(room.number * 67 % 360))
    for arrangement in _ARRANGEMENTS[room.kind]:
        yield from _items(arrangement, space)
    yield from _along_the_walls(space)


def _door_leaf(room: Room) -> Item:
    hand = 1.0 if room.hinge_east else -1.0
    hinge = (room.door + hand * (DOOR_WIDTH / 2 - 0.02), room.y0 - 0.02 if room.north else room.y1 + 0.02, 0.0)
    swing = room.angle * hand * (-1.0 if room.north else 1.0) if room.open else 0.0
    return Item(room.number, 0, "door leaf", hinge, (180.0 if room.hinge_east else 0.0) + swing)


def _items(arrangement: _Arrangement, space: _Space) -> Iterator[Item]:
    room = space.room
    for k, (x, far) in enumerate(arrangement.spots(space)):
        for stand in arrangement.groups[k % len(arrangement.groups)]:
            if space.deep <= stand.deeper:
                continue
            degrees = stand.degrees + (180.0 if stand.facing and room.north else 0.0)
            turn = turn_z(degrees)
            at = x + stand.dx, space.y(far + stand.far)
            for thing in stand.things:
                dx, dy, _ = turn @ (thing.dx, thing.dy, 0.0)
                place = (at[0] + float(dx), at[1] + float(dy), thing.z)
                yield Item(room.number, thing.priority, thing.name, place, degrees + thing.degrees)


def _along_the_walls(space: _Space) -> Iterator[Item]:
    """Shelves and cabinets along the walls between rooms, as many as there is depth for."""
    room = space.room
    for k in range(int((space.deep - 0.3) / 1.02)):
        if room.kind not in _BARE_WEST:
            thing = "shelf" if k < 3 else "cabinet"
            yield Item(room.number, 4 + k % 3, thing, (room.x0 + 0.18, space.y(0.9 + 1.02 * k), 0.0), 90.0)
        if room.kind not in _BARE_EAST and space.width > 4.5:
            yield Item(room.number, 4 + k % 3, "shelf", (room.x1 - 0.18, space.y(1.3 + 1.02 * k), 0.0), -90.0)
