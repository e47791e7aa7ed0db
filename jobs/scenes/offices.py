"""Offices: towers of storeys; each storey has a corridor with rooms on both sides, doors, furniture and a stair core.

Walls come in the three manners that real models have: one long slab with openings; boxes that abut, their touching
coordinates exactly equal; and boxes that run into one another. A larger request adds storeys, then towers.
Coordinates are multiples of 1/64 m wherever walls, floors and stairs meet.
"""

from __future__ import annotations

import numpy as np

from jobs.scenes.things.draft import EYE_HEIGHT, Point, SceneDraft, SceneKind, Walk
from jobs.scenes.things.furnish import Plan, furnish
from jobs.scenes.things.furnishings import FURNISHINGS
from jobs.scenes.things.rooms import CLEAR, DOOR_HEIGHT, DOOR_WIDTH, INNER, OUTER, STOREY, Room
from jobs.scenes.things.solids import Mesh, boxes, cylinders, join, openings, plate, tubes, vec

STOREY_TRIANGLES = 60_000  # aimed at per storey
ROOF_TRIANGLES = 12 + 8 * 4 + 16 * 2  # slab and parapet
TOWER_STOREYS = 24
TOWER_SPACING = (60.0, 48.0)

WIDTH, DEPTH = 36.0, 15.0
SOUTH_WALL, NORTH_WALL = 6.25, 8.625  # the corridor's walls start here (y)
CORRIDOR_Y = 7.5
CORE = 4.75  # the stair core ends here (x)
ROOM_WIDTHS = (4.0, 5.0, 6.0, 7.5)
KINDS = ("office", "office", "meeting", "library", "open", "kitchen", "lounge")


def _storeys(triangles: int) -> int:
    return max(1, round(triangles / STOREY_TRIANGLES))


def _towers(triangles: int) -> list[int]:
    """Storeys of each tower, as even as can be."""
    storeys = _storeys(triangles)
    towers = -(-storeys // TOWER_STOREYS)
    return [storeys // towers + (k < storeys % towers) for k in range(towers)]


def _tower_place(tower: int, towers: int) -> tuple[float, float]:
    columns = max(1, round(towers**0.5))
    row, column = divmod(tower, columns)
    return column * TOWER_SPACING[0], row * TOWER_SPACING[1]


def _rooms(seed: int, tower: int) -> tuple[Room, ...]:
    """The rooms of every storey of a tower, from west to east, the southern ones first."""
    rng = np.random.default_rng([seed, 1, tower])
    rooms: list[Room] = []
    for north in (False, True):
        start = CORE + INNER if north else OUTER
        left = WIDTH - OUTER - start
        widths: list[float] = []
        while left - sum(widths) - INNER * len(widths) > 8.5:
            widths.append(float(rng.choice(ROOM_WIDTHS)))
        widths.append(left - sum(widths) - INNER * len(widths))
        x = start
        for k, width in enumerate(widths):
            linked = k % 2 == 0 and k + 1 < len(widths)
            door = x + width / 2 + round(float(rng.uniform(-0.2, 0.2)) * width * 8) / 8
            rooms.append(
                Room(
                    number=len(rooms) + 1,
                    north=north,
                    x0=x,
                    x1=x + width,
                    y0=NORTH_WALL + INNER if north else OUTER,
                    y1=DEPTH - OUTER if north else SOUTH_WALL,
                    door=door,
                    open=bool(k % 2 == 0 or rng.uniform() < 0.4),
                    angle=float(rng.integers(80, 96)),
                    hinge_east=not linked,
                    kind="open" if width > 7 else str(rng.choice(KINDS)),
                )
            )
            x += width + INNER
    return tuple(rooms)


def walk(triangles: int, seed: int) -> Walk:
    """View points in every room and corridor, and a tour through up to three storeys of the first tower."""
    towers = _towers(triangles)
    points: list[Point] = []
    for tower, storeys in enumerate(towers):
        dx, dy = _tower_place(tower, len(towers))
        spots = [(x, CORRIDOR_Y) for x in (1.5, 9.5, 18.0, 26.5, 34.5)]
        for room in _rooms(seed, tower):
            spots += [(room.door, room.strip), (room.x0 + 0.875 if room.hinge_east else room.x1 - 0.875, room.strip)]
        points += [(x + dx, y + dy, k * STOREY + EYE_HEIGHT) for k in range(storeys) for x, y in spots]
    rooms = _rooms(seed, 0)
    tour: list[Point] = []
    for storey in range(min(3, towers[0])):
        z = storey * STOREY + EYE_HEIGHT
        tour += [(2.5, CORRIDOR_Y, z)] if storey == 0 else []
        chosen = [room for room in rooms if room.open][storey % 2 :: 2]
        for room in sorted(chosen, key=lambda each: each.door):
            tour += [(room.door, CORRIDOR_Y, z), (room.door, room.strip, z)]
            if not room.hinge_east:  # an opening leads to the next room
                partner = rooms[room.number]
                tour += [(partner.door, room.strip, z), (room.door, room.strip, z)]
            tour += [(room.door, CORRIDOR_Y, z)]
        tour += [(34.5, CORRIDOR_Y, z), (2.5, CORRIDOR_Y, z)]
        if storey + 1 < min(3, towers[0]):
            tour += [
                (2.5, 9.5, z),
                (1.25, 9.5, z),
                (1.25, 10.25, z),
                (1.25, 13.25, z + STOREY / 2),
                (1.25, 14.0, z + STOREY / 2),
            ]
            tour += [
                (3.6875, 14.0, z + STOREY / 2),
                (3.6875, 13.25, z + STOREY / 2),
                (3.6875, 10.25, z + STOREY),
                (3.6875, 9.5, z + STOREY),
                (2.5, 9.5, z + STOREY),
                (2.5, CORRIDOR_Y, z + STOREY),
            ]
    return Walk(np.array(points, np.float64), np.array(tour, np.float64))


def build(draft: SceneDraft, triangles: int, seed: int) -> None:
    """Make the whole scene on `draft`."""
    towers = _towers(triangles)
    storeys_left = sum(towers)
    columns = max(1, round(len(towers) ** 0.5))
    rows = -(-len(towers) // columns)
    draft.writer.begin("offices")
    lo = (-24.0, -24.0, -0.75)
    hi = ((columns - 1) * TOWER_SPACING[0] + WIDTH + 24, (rows - 1) * TOWER_SPACING[1] + DEPTH + 24, -0.25)
    draft.add("ground", boxes([lo], [hi]), "pavement")
    for tower, storeys in enumerate(towers):
        plan = Plan.of(draft, _rooms(seed, tower))
        draft.writer.begin(f"tower {tower + 1}", (*_tower_place(tower, len(towers)), 0.0))
        for storey in range(storeys):
            goal = draft.writer.triangles + draft.left // storeys_left
            _storey(draft, goal, plan, np.random.default_rng([seed, 2, tower, storey]), tower, storey, storeys)
            storeys_left -= 1
            draft.report()
        _roof(draft, tower, storeys)
        draft.writer.end()
    draft.writer.end()


# ------------------------------------------------------------------------------------------------ structure


def _roof(draft: SceneDraft, tower: int, storeys: int) -> None:
    """Roof slab and parapet. They belong to the tower; the last storey has left triangles for them."""
    z = storeys * STOREY
    slab = boxes([(0.0, 0.0, z - 0.25)], [(WIDTH, DEPTH, z)])
    parapet = plate(
        "z",
        [0.0, OUTER, WIDTH - OUTER, WIDTH],
        [0.0, OUTER, DEPTH - OUTER, DEPTH],
        [[1, 1, 1], [1, 0, 1], [1, 1, 1]],
        z,
        z + 0.75,
    )
    draft.add(f"tower {tower + 1} roof", join([slab, parapet]), "dark concrete")


def _storey(
    draft: SceneDraft, goal: int, plan: Plan, rng: np.random.Generator, tower: int, storey: int, storeys: int
) -> None:
    """One storey; it ends within a few triangles of `goal`, counted over the whole scene."""
    name, rooms = f"tower {tower + 1} storey {storey + 1}", plan.rooms
    draft.writer.begin(name, (0.0, 0.0, storey * STOREY))
    draft.writer.begin(f"{name} structure")
    _floor(draft, name, rooms, storey)
    _facades(draft, name, storey)
    for north in (False, True):
        _corridor_wall(draft, name, rooms, north, ("slab", "abutting", "interpenetrating")[(storey + 2 * north) % 3])
    _cross_walls(draft, name, rooms, storey)
    if storey + 1 < storeys:
        _stairs(draft, name)
    _services(draft, name, rooms)
    for x in np.arange(3.0, WIDTH - 2.0, 4.0).tolist():
        draft.put(f"{name} corridor lamp {x:g}", "ceiling lamp", (x, 8.375, CLEAR))
    draft.writer.end()
    reserve = ROOF_TRIANGLES if storey + 1 == storeys else 0
    furnish(draft, goal - reserve, plan, rng, name)
    draft.writer.end()


def _floor(draft: SceneDraft, name: str, rooms: tuple[Room, ...], storey: int) -> None:
    if storey == 0:
        slab = boxes([(0.0, 0.0, -0.25)], [(WIDTH, DEPTH, 0.0)])
    else:
        slab = plate("z", *openings((0.0, WIDTH), (0.0, DEPTH), [(OUTER, CORE, 10.25, DEPTH - OUTER)]), -0.25, 0.0)
    draft.add(f"{name} floor", slab, "concrete")
    carpet = boxes([(OUTER, SOUTH_WALL + INNER, 0.0)], [(WIDTH - OUTER, NORTH_WALL, 1 / 64)])
    draft.add(f"{name} corridor carpet", carpet, "carpet")
    lo, hi = (np.array([[getattr(r, x), getattr(r, y), 0.0] for r in rooms]) for x, y in (("x0", "y0"), ("x1", "y1")))
    soft = np.array([room.kind in ("office", "open", "meeting", "library") for room in rooms])
    draft.add(f"{name} room carpets", boxes(lo[soft], hi[soft] + (0, 0, 1 / 64)), "carpet light")
    draft.add(f"{name} parquet", boxes(lo[~soft], hi[~soft] + (0, 0, 1 / 64)), "wood")
    draft.add(f"{name} ceilings", boxes(lo + vec(0, 0, CLEAR - 1 / 32), hi + vec(0, 0, CLEAR)), "white")


def _facades(draft: SceneDraft, name: str, storey: int) -> None:
    """The outer walls with windows, and the windows' frames."""
    starts = np.arange(1.0, WIDTH - 2.0, 2.5)
    holes = np.stack([starts, starts + 1.75, np.full_like(starts, 0.875), np.full_like(starts, 2.75)], axis=1)
    for side, y in (("south", 0.0), ("north", DEPTH - OUTER)):
        wall = plate("y", *openings((0.0, WIDTH), (0.0, CLEAR), holes), y, y + OUTER)
        draft.add(f"{name} {side} wall", wall, "cream")
    ends = [(SOUTH_WALL + 0.25, NORTH_WALL - 0.125, 0.0 if storey == 0 else 0.875, 2.75)]
    for side, x in (("west", 0.0), ("east", WIDTH - OUTER)):
        wall = plate("x", *openings((OUTER, DEPTH - OUTER), (0.0, CLEAR), ends), x, x + OUTER)
        draft.add(f"{name} {side} wall", wall, "cream")
    u0, u1, v0, v1 = holes.T
    bars_lo, bars_hi = [], []
    for y in (0.09375, DEPTH - 0.15625):
        for a0, a1, b0, b1 in (
            (u0, u0 + 0.0625, v0, v1),
            (u1 - 0.0625, u1, v0, v1),
            (u0 + 0.0625, u1 - 0.0625, v0, v0 + 0.0625),
            (u0 + 0.0625, u1 - 0.0625, v1 - 0.0625, v1),
            ((u0 + u1) / 2 - 0.03125, (u0 + u1) / 2 + 0.03125, v0 + 0.0625, v1 - 0.0625),
        ):
            bars_lo.append(np.stack([a0, np.full_like(a0, y), b0], axis=1))
            bars_hi.append(np.stack([a1, np.full_like(a0, y + 0.0625), b1], axis=1))
    draft.add(f"{name} window frames", boxes(np.concatenate(bars_lo), np.concatenate(bars_hi)), "slate")
    sills = [(u0 - 0.0625, u1 + 0.0625, y0, y1) for y0, y1 in ((-0.0625, 0.0625), (DEPTH - 0.0625, DEPTH + 0.0625))]
    lo = np.concatenate([np.stack([a, np.full_like(a, y), v0 - 0.0625], axis=1) for a, _, y, _ in sills])
    hi = np.concatenate([np.stack([b, np.full_like(b, y), v0], axis=1) for _, b, _, y in sills])
    draft.add(f"{name} window sills", boxes(lo, hi), "light grey")


def _wall(
    axis: str,
    span: tuple[float, float],
    holes: list[tuple[float, float, float, float]],
    near: float,
    far: float,
    manner: str,
) -> Mesh:
    """A wall with openings down to the floor, built in one of the three manners."""
    us, vs, solid = openings(span, (0.0, CLEAR), holes)
    if manner == "slab":
        return plate(axis, us, vs, solid, near, far)
    columns = [(float(us[k]), float(us[k + 1]), bool(solid[k].all())) for k in range(len(us) - 1)]
    ranges: list[tuple[float, float, float, float, float]] = []
    if manner == "abutting":
        for u0, u1, whole in columns:
            ranges.append((u0, u1, 0.0 if whole else DOOR_HEIGHT, CLEAR, 0.0))
    else:
        for u0, u1, whole in columns:
            if whole:
                ranges.append((u0, u1, 0.0, DOOR_HEIGHT + 0.5, 1 / 64))
        ranges.append((us[0] - 0.0625, us[-1] + 0.0625, DOOR_HEIGHT, CLEAR, 0.0))
    lo, hi = [], []
    for u0, u1, z0, z1, inset in ranges:
        low, high = (
            ([u0, near + inset, z0], [u1, far - inset, z1])
            if axis == "y"
            else ([near + inset, u0, z0], [far - inset, u1, z1])
        )
        lo.append(low)
        hi.append(high)
    return boxes(lo, hi)


def _corridor_wall(draft: SceneDraft, name: str, rooms: tuple[Room, ...], north: bool, manner: str) -> None:
    y = NORTH_WALL if north else SOUTH_WALL
    holes = [(r.door - DOOR_WIDTH / 2, r.door + DOOR_WIDTH / 2, 0.0, DOOR_HEIGHT) for r in rooms if r.north == north]
    if north:
        holes.append((1.75, 3.25, 0.0, DOOR_HEIGHT))
    side = "north" if north else "south"
    draft.add(
        f"{name} {side} corridor wall ({manner})",
        _wall("y", (OUTER, WIDTH - OUTER), holes, y, y + INNER, manner),
        "plaster",
    )


def _cross_walls(draft: SceneDraft, name: str, rooms: tuple[Room, ...], storey: int) -> None:
    core = boxes([(CORE, NORTH_WALL + INNER, 0.0)], [(CORE + INNER, DEPTH - OUTER, CLEAR)])
    draft.add(f"{name} core wall", core, "concrete")
    for room in rooms:
        if room.x1 >= WIDTH - OUTER:
            continue
        middle = room.strip
        holes = [] if room.hinge_east else [(middle - DOOR_WIDTH / 2, middle + DOOR_WIDTH / 2, 0.0, DOOR_HEIGHT)]
        manner = ("abutting", "slab", "interpenetrating")[(storey + room.number) % 3]
        wall = _wall("x", (room.y0, room.y1), holes, room.x1, room.x1 + INNER, manner)
        draft.add(f"{name} wall {room.number} ({manner})", wall, "plaster")


def _stairs(draft: SceneDraft, name: str) -> None:
    """Two flights of ten steps and a landing: boxes that abut; railings of round bars."""
    rise, run, first = STOREY / 20, 0.3, 10.25
    k = np.arange(10)
    up_lo = np.stack([np.full(10, 0.375), first + k * run, np.maximum(k * rise - 0.125, 0.0)], axis=1)
    up_hi = np.stack([np.full(10, 2.125), first + (k + 1) * run, (k + 1) * rise], axis=1)
    landing = ([(OUTER, 13.25, STOREY / 2 - 0.25)], [(CORE, DEPTH - OUTER, STOREY / 2)])
    down_lo = np.stack([np.full(10, 2.75), 13.25 - (k + 1) * run, STOREY / 2 + k * rise - 0.125], axis=1)
    down_hi = np.stack([np.full(10, 4.625), 13.25 - k * run, STOREY / 2 + (k + 1) * rise], axis=1)
    steps = boxes(np.concatenate([up_lo, landing[0], down_lo]), np.concatenate([up_hi, landing[1], down_hi]))
    draft.add(f"{name} stairs", steps, "concrete")
    high = 1.0
    rails = tubes(
        [
            [[2.0, first, 0.2], [2.0, first, high], [2.0, 13.25, STOREY / 2 + high], [2.0, 13.25, STOREY / 2 + 0.1]],
            [
                [2.875, first, STOREY + 0.0],
                [2.875, first, STOREY + high],
                [2.875, 13.25, STOREY / 2 + high],
                [2.875, 13.25, STOREY / 2 + 0.1],
            ],
        ],
        0.025,
        2.0,
        12,
        4,
    )
    along = first + np.arange(1, 20) * run / 2
    t = (along - first) / 3.0
    bars_lo = np.concatenate(
        [
            np.stack([np.full(19, x), along, base + 0.05], axis=1)
            for x, base in ((2.0, t * STOREY / 2), (2.875, STOREY - t * STOREY / 2))
        ]
    )
    bars = cylinders(bars_lo, bars_lo + vec(0, 0, high - 0.05), 0.009, 6)
    draft.add(f"{name} stair railings", join([rails, bars]), "black")


def _services(draft: SceneDraft, name: str, rooms: tuple[Room, ...]) -> None:
    """A duct and pipes under the corridor's ceiling, door frames, skirting boards."""
    x0, x1 = OUTER + 0.25, WIDTH - OUTER - 0.25
    draft.add(f"{name} duct", boxes([(x0, 6.75, 2.8125)], [(x1, 7.25, 3.125)]), "galvanised")
    ys = np.array([7.75, 7.90625, 8.0625])
    pipes = cylinders(
        np.stack([np.full(3, x0), ys, np.full(3, 2.9375)], axis=1),
        np.stack([np.full(3, x1), ys, np.full(3, 2.9375)], axis=1),
        [0.05, 0.04, 0.03],
        16,
    )
    hangers = np.arange(2.0, x1, 3.0)
    straps = boxes(
        np.stack([hangers, np.full_like(hangers, 7.6875), np.full_like(hangers, 2.84375)], axis=1),
        np.stack([hangers + 0.03125, np.full_like(hangers, 8.125), np.full_like(hangers, 2.875)], axis=1),
    )
    draft.add(f"{name} corridor pipes", join([pipes, straps]), "brass")
    frames_lo, frames_hi, boards_lo, boards_hi = [], [], [], []
    for room in rooms:
        near, far = (NORTH_WALL, NORTH_WALL + INNER) if room.north else (SOUTH_WALL, SOUTH_WALL + INNER)
        near, far = near - 1 / 32, far + 1 / 32
        left, right = room.door - DOOR_WIDTH / 2, room.door + DOOR_WIDTH / 2
        frames_lo += [
            (left - 1 / 16, near, 0.0),
            (right - 1 / 64, near, 0.0),
            (left + 1 / 64, near, DOOR_HEIGHT - 1 / 64),
        ]
        frames_hi += [
            (left + 1 / 64, far, DOOR_HEIGHT + 1 / 16),
            (right + 1 / 16, far, DOOR_HEIGHT + 1 / 16),
            (right - 1 / 64, far, DOOR_HEIGHT + 1 / 16),
        ]
        y = room.y1 if room.north else room.y0
        low, high = (y - 1 / 64, y) if room.north else (y, y + 1 / 64)
        boards_lo.append((room.x0, low, 0.0))
        boards_hi.append((room.x1, high, 0.125))
    draft.add(f"{name} door frames", boxes(frames_lo, frames_hi), "wood dark")
    draft.add(f"{name} skirting boards", boxes(boards_lo, boards_hi), "white")


SCENE = SceneKind(build, walk, FURNISHINGS)
