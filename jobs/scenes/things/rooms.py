"""Rooms and what stands in them, for offices and for the city's buildings.

A room lies north or south of a corridor that runs along x. Along the corridor's wall a strip stays free, so that a
person can step in and walk on to the next room.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jobs.scenes.things.furnishings import BOOK_CAPACITY, BOOK_VARIANTS, books
from jobs.scenes.things.solids import turn_z
from jobs.scenes.things.stage import Point, Stage

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


@dataclass(frozen=True)
class Item:
    """Something to be placed in a room if the triangles last: a thing of the stock and where it stands."""

    room: int
    priority: int
    thing: str
    at: Point
    degrees: float


def _workplace(room: Room, x: float, y: float, degrees: float) -> Iterator[Item]:
    """A desk at (x, y) with what stands on it; the person sits on its -y side, turned by `degrees`."""
    turn = turn_z(degrees)

    def at(dx: float, dy: float, z: float) -> Point:
        ox, oy, _ = turn @ (dx, dy, 0.0)
        return (x + float(ox), y + float(oy), z)

    yield Item(room.number, 0, "desk", at(0, 0, 0), degrees)
    yield Item(room.number, 1, "chair", at(0.05, -0.72, 0), degrees + 180)
    yield Item(room.number, 2, "monitor", at(-0.1, 0.22, 0.75), degrees)
    yield Item(room.number, 2, "computer", at(-0.62, 0.08, 0), degrees)
    yield Item(room.number, 4, "keyboard", at(-0.1, -0.12, 0.75), degrees)
    yield Item(room.number, 6, "desk lamp", at(0.62, 0.2, 0.75), degrees)
    yield Item(room.number, 3, "desk things", at(0.3, -0.05, 0.75), degrees)
    yield Item(room.number, 7, "cup", at(-0.5, -0.2, 0.75), degrees + 40)


@dataclass(frozen=True)
class Plan:
    """What the rooms of a storey may hold."""

    rooms: tuple[Room, ...]
    items: tuple[Item, ...]
    priorities: NDArray[np.int64]  # of each item; the lowest number comes first
    costs: tuple[int, ...]  # triangles of each item

    @classmethod
    def of(cls, stage: Stage, rooms: tuple[Room, ...]) -> Plan:
        """The plan for `rooms`; it serves any number of storeys."""
        items = tuple(item for room in rooms for item in _room_items(room))
        priorities = np.array([item.priority for item in items])
        return cls(rooms, items, priorities, tuple(stage.cost(item.thing) for item in items))


def _room_items(room: Room) -> Iterator[Item]:
    """What the room may hold. Nothing stands in the strip along the corridor wall."""
    number, facing = room.number, 180.0 if room.north else 0.0
    outer = room.y1 if room.north else room.y0  # the facade's inner face
    inward = -1.0 if room.north else 1.0
    deep = room.y1 - room.y0 - STRIP  # of the part that may be filled
    middle, width = (room.x0 + room.x1) / 2, room.x1 - room.x0

    def y(distance: float) -> float:
        return outer + inward * distance

    hand = 1.0 if room.hinge_east else -1.0
    hinge = (room.door + hand * (DOOR_WIDTH / 2 - 0.02), room.y0 - 0.02 if room.north else room.y1 + 0.02, 0.0)
    swing = room.angle * hand * (-1.0 if room.north else 1.0) if room.open else 0.0
    yield Item(number, 0, "door leaf", hinge, (180.0 if room.hinge_east else 0.0) + swing)
    for k in range(max(1, round(width / 2.5))):
        x = room.x0 + (k + 0.5) * width / max(1, round(width / 2.5))
        yield Item(number, 1, "ceiling lamp", (x, y(1.6), CLEAR), 90.0)
        yield Item(number, 2, "ceiling lamp", (x, y(3.8), CLEAR), 90.0)
        yield Item(number, 2, "radiator", (x, y(0.08), 0.0), 0.0)
    yield Item(number, 2, "bin", (room.x0 + 0.3, y(deep - 0.2), 0.0), 0.0)
    yield Item(number, 5, "pot plant", (room.x1 - 0.35, y(0.5), 0.0), float(room.number * 67 % 360))
    if room.kind in ("office", "open"):
        pairs = max(1, int((width - 1.8) / 3.4))
        for k in range(pairs):
            x = room.x0 + 0.4 + (k + 0.5) * (width - 0.8) / pairs
            for side in (-1.0, 1.0):
                yield from _workplace(room, x + side * 0.42, y(1.5), -90.0 * side)
                if deep > 3.8:
                    yield from _workplace(room, x + side * 0.42, y(3.3), -90.0 * side)
    elif room.kind == "meeting":
        yield Item(number, 0, "meeting table", (middle, y(2.4), 0.0), 90.0 if width < 4.9 else 0.0)
        for k in range(3):
            for side in (-1.0, 1.0):
                offset = (k - 1) * 1.1
                at, turn = (
                    ((middle + side * 0.95, y(2.4) + offset, 0.0), 90.0 * side + 180)
                    if width < 4.9
                    else ((middle + offset, y(2.4) + side * 0.95, 0.0), 0.0 if side > 0 else 180.0)
                )
                yield Item(number, 1, "visitor chair", at, turn - 180.0 if width < 4.9 else turn)
                yield Item(
                    number,
                    7,
                    "cup",
                    (
                        middle + (0.4 * side if width < 4.9 else offset),
                        y(2.4) + (offset if width < 4.9 else 0.4 * side),
                        0.75,
                    ),
                    20.0 * k,
                )
        yield Item(number, 1, "whiteboard", (room.x1 - 0.02, y(2.4), 0.0), -90.0)
    elif room.kind == "lounge":
        for k, x in enumerate(np.arange(room.x0 + 1.3, room.x1 - 1.0, 2.4).tolist()):
            yield Item(number, 0, "sofa blue" if k % 2 else "sofa red", (x, y(0.75), 0.0), 180.0 + facing)
            yield Item(number, 3, "cushion", (x - 0.5, y(0.75), 0.42), 0.0)
            yield Item(number, 1, "visitor chair", (x, y(3.2), 0.0), facing)
        yield Item(number, 5, "pot plant", (room.x0 + 0.4, y(3.9), 0.0), 30.0)
    elif room.kind == "bedroom":
        yield Item(number, 0, "bed", (middle, y(1.15), 0.0), facing + 180.0)
        yield Item(number, 3, "cushion", (middle + 0.3, y(1.0), 0.5), 0.0)
        if deep > 3.2:
            yield Item(number, 1, "wardrobe", (room.x1 - 0.35, y(2.9), 0.0), -90.0)
        yield from _workplace(room, room.x0 + 1.3, y(deep - 0.5), facing)
    elif room.kind == "bath":
        yield Item(number, 0, "toilet", (room.x0 + 0.9, y(0.45), 0.0), facing + 180.0)
        yield Item(number, 0, "basin", (room.x0 + 2.0, y(0.3), 0.0), facing + 180.0)
        yield Item(number, 2, "basin", (room.x0 + 2.8, y(0.3), 0.0), facing + 180.0)
        yield Item(number, 3, "cabinet", (room.x1 - 0.3, y(1.6), 0.0), -90.0)
    elif room.kind == "kitchen":
        yield Item(number, 0, "kitchen", (room.x0 + 0.36, y(2.2), 0.0), 90.0)
        for k in range(2):
            yield Item(number, 0, "desk", (room.x0 + 2.4, y(1.2 + 2.1 * k), 0.0), 0.0)
            for side in (-1.0, 1.0):
                for dx in (-0.4, 0.4):
                    yield Item(
                        number,
                        1,
                        "visitor chair",
                        (room.x0 + 2.4 + dx, y(1.2 + 2.1 * k) + 0.65 * side, 0.0),
                        0.0 if side > 0 else 180.0,
                    )
                    yield Item(number, 7, "cup", (room.x0 + 2.4 + dx, y(1.2 + 2.1 * k) + 0.2 * side, 0.75), 0.0)
    else:
        for row in range(2 if width < 5.5 else 3):
            for k in range(4):
                x = room.x0 + 1.4 + row * (width - 2.6) / (1 if width < 5.5 else 2)
                for side in (-1.0, 1.0):
                    yield Item(number, 1 + row, "shelf", (x + 0.16 * side, y(0.75 + 1.0 * k), 0.0), 90.0 * side)
    for k in range(int((deep - 0.3) / 1.02)):
        if room.kind not in ("kitchen", "bath", "bedroom"):
            yield Item(
                number, 4 + k % 3, "shelf" if k < 3 else "cabinet", (room.x0 + 0.18, y(0.9 + 1.02 * k), 0.0), 90.0
            )
        if room.kind not in ("meeting", "bath", "bedroom") and width > 4.5:
            yield Item(number, 4 + k % 3, "shelf", (room.x1 - 0.18, y(1.3 + 1.02 * k), 0.0), -90.0)


def furnish(stage: Stage, goal: int, plan: Plan, rng: np.random.Generator, name: str) -> None:
    """Furnish the rooms up to `goal` triangles (of the scene); books fill what is left."""
    rooms, items = plan.rooms, plan.items
    order = np.argsort(plan.priorities + rng.uniform(size=len(items))).tolist()
    left = goal - stage.writer.triangles
    chosen: list[int] = []
    shelves: dict[int, int] = {}  # item to the variant of books on it
    spare = 0 if left < 4000 else 12 * BOOK_CAPACITY
    for k in order:
        cost = plan.costs[k]
        if cost > left - spare:
            continue
        if items[k].thing == "shelf":
            variant = int(rng.integers(0, BOOK_VARIANTS))
            if cost + stage.cost(f"books {variant}") > left - spare:
                continue
            cost += stage.cost(f"books {variant}")
            shelves[k] = variant
        left -= cost
        chosen.append(k)
    fresh: dict[int, int] = {}  # item to the number of books of its own; they take up what is left
    for k in [k for k in order if items[k].thing == "shelf"]:
        extra = left // 12
        if extra < 1:
            break
        if k in shelves:
            owned = stage.cost(f"books {shelves[k]}") // 12
            if owned == BOOK_CAPACITY and extra < 8:
                continue
            fresh[k] = min(BOOK_CAPACITY, owned + extra)
            left -= 12 * (fresh[k] - owned)
            del shelves[k]
        elif stage.cost("shelf") + 12 <= left:
            left -= stage.cost("shelf")
            fresh[k] = min(BOOK_CAPACITY, left // 12)
            left -= 12 * fresh[k]
            chosen.append(k)
    by_room: dict[int, list[int]] = {room.number: [] for room in rooms}
    for k in sorted(chosen):
        by_room[items[k].room].append(k)
    for room in rooms:
        stage.writer.begin(f"{name} room {room.number} ({room.kind})")
        for k in by_room[room.number]:
            item = items[k]
            label = f"{name} room {room.number} {item.thing} {k}"
            turn = turn_z(item.degrees)
            stage.put(label, item.thing, item.at, turn)
            if k in shelves:
                stage.put(f"{label} books", f"books {shelves[k]}", item.at, turn)
            elif k in fresh:
                pairs = [(mesh, stage.material(material)) for mesh, material in books(fresh[k], rng)]
                stage.writer.place(f"{label} books", stage.writer.mesh(f"{label} books", pairs), item.at, turn)
        stage.writer.end()
