"""An industrial plant: halls with solid walls and doors, pipe racks, tanks, vessels, pumps, platforms and stairs.

Halls stand wall to wall in a grid; some places are open yards with tall columns. A larger request adds halls.
Pipes are made to measure, each a part of its own; flanges, valves, pumps, gratings and lamps are instances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jobs.scenes.things import equipment
from jobs.scenes.things.draft import EYE_HEIGHT, Point, SceneDraft, SceneKind, Walk
from jobs.scenes.things.solids import (
    Floats,
    Mesh,
    beams,
    boxes,
    cylinders,
    frames_along,
    i_profile,
    join,
    lathe,
    openings,
    plate,
    sphere,
    tube_triangles,
    tubes,
    turn_z,
    vec,
)

LENGTH, DEPTH, HEIGHT = 36.0, 24.0, 9.0  # of a hall: between the walls' outer faces, and the clear height
WALL = 0.25
AISLE = 1.5  # the middle of the walkway along the walls, from the hall's outer edge
DOOR_WIDTH, DOOR_HEIGHT = 2.5, 3.0
FRAMES = np.arange(4.0, 33.0, 4.0)  # the racks' frames (x)
RACKS = (8.75, 14.5)  # the racks' middles (y)
RACK_HALF = 1.375
LEVELS = (3.25, 4.375, 5.5, 6.625)
LANES = np.arange(-4, 5) * 0.28125  # across a rack
MIDDLE_AISLE = 11.625
OUTSIDE_FROM = 250_000  # triangles of the whole plant
TANKS_Y, VESSELS_Y = 5.0, 18.75
PLATFORM = 4.0
BEND, BEND_STEPS = 2.2, 5  # bend radius over pipe radius; rings of facets in a bend
BORES = np.array([0.03, 0.0375, 0.05, 0.05, 0.0625, 0.08, 0.1])
PAINTS = ("galvanised", "insulation", "green", "blue", "yellow", "red", "grey", "orange")


@dataclass(frozen=True)
class Hall:
    """One place in the grid."""

    number: int
    column: int
    row: int
    yard: bool
    south_door: float  # the middle (x) of the door in the southern wall
    west_door: float  # the middle (y) of the door in the western wall

    @property
    def name(self) -> str:
        """Its name in the scene."""
        return f"{'yard' if self.yard else 'hall'} {self.number + 1}"


def _halls(triangles: int, seed: int) -> dict[tuple[int, int], Hall]:
    """The grid of halls by (column, row)."""
    each = min(125_000.0, 50_000.0 * max(1.0, triangles / 100_000) ** 0.4)
    count = max(1, round(triangles / each))
    columns = max(1, round((count * DEPTH / LENGTH) ** 0.5))
    rng = np.random.default_rng([seed, 11])
    doors = rng.uniform(size=(count, 2))
    return {
        (k % columns, k // columns): Hall(
            number=k,
            column=k % columns,
            row=k // columns,
            yard=k % 7 == 3,
            south_door=6.0 + 6.0 * int(doors[k, 0] * 5) + round((float(doors[k, 0]) * 5 % 1 - 0.5) * 10) / 4,
            west_door=4.0 + round(float(doors[k, 1]) * 16 * 4) / 4,
        )
        for k in range(count)
    }


def _ring(hall: Hall, start: Point, end: Point) -> list[Point]:
    """The corners passed on the shorter way along a hall's walkway from `start` to `end` (both on it)."""
    x0, y0 = hall.column * LENGTH, hall.row * DEPTH
    corners = [
        (x0 + AISLE, y0 + AISLE),
        (x0 + LENGTH - AISLE, y0 + AISLE),
        (x0 + LENGTH - AISLE, y0 + DEPTH - AISLE),
        (x0 + AISLE, y0 + DEPTH - AISLE),
    ]
    wide, deep = LENGTH - 2 * AISLE, DEPTH - 2 * AISLE
    total = 2 * (wide + deep)

    def distance(point: Point) -> float:
        x, y = point[0] - x0 - AISLE, point[1] - y0 - AISLE
        sides = [(abs(y), x), (abs(x - wide), wide + y), (abs(y - deep), wide + deep + wide - x), (abs(x), total - y)]
        return min(sides)[1] % total

    at = [0.0, wide, wide + deep, 2 * wide + deep]
    first, last = distance(start), distance(end)
    ahead = (last - first) % total
    if ahead <= total - ahead:
        passed = sorted(((d - first) % total, k) for k, d in enumerate(at) if 0 < (d - first) % total < ahead)
    else:
        passed = sorted(((first - d) % total, k) for k, d in enumerate(at) if 0 < (first - d) % total < total - ahead)
    return [(*corners[k], EYE_HEIGHT) for _, k in passed]


def walk(triangles: int, seed: int) -> Walk:
    """View points on every walkway, and a tour through up to twelve halls in a snake."""
    halls = _halls(triangles, seed)
    spots = [(x, y) for x in (AISLE, 12.0, 24.0, LENGTH - AISLE) for y in (AISLE, DEPTH - AISLE)]
    spots += [(x, MIDDLE_AISLE) for x in (AISLE, 10.0, 18.0, 26.0, LENGTH - AISLE)]
    points = [(h.column * LENGTH + x, h.row * DEPTH + y, EYE_HEIGHT) for h in halls.values() for x, y in spots]
    columns = 1 + max(column for column, _ in halls)
    tour: list[Point] = [(AISLE, MIDDLE_AISLE, EYE_HEIGHT), (LENGTH - AISLE, MIDDLE_AISLE, EYE_HEIGHT)]
    here = halls[0, 0]
    for step in range(1, min(len(halls), 12)):
        row, along = divmod(step, columns)
        place = (along if row % 2 == 0 else columns - 1 - along, row)
        if place not in halls:
            break
        there = halls[place]
        x0, y0 = max(here.column, there.column) * LENGTH, there.row * DEPTH
        if there.row != here.row:
            doorway = [(x0 + there.south_door, y0 - AISLE), (x0 + there.south_door, y0 + AISLE)]
        else:
            owner = there if there.column > here.column else here
            doorway = [(x0 - AISLE, y0 + owner.west_door), (x0 + AISLE, y0 + owner.west_door)]
            doorway = doorway if owner is there else doorway[::-1]
        before, after = ((x, y, EYE_HEIGHT) for x, y in doorway)
        tour += [*_ring(here, tour[-1], before), before, after]
        if step % 3 == 1:
            x0, y = there.column * LENGTH, there.row * DEPTH + MIDDLE_AISLE
            west = (x0 + AISLE, y, EYE_HEIGHT)
            tour += [*_ring(there, after, west), west, (x0 + LENGTH - AISLE, y, EYE_HEIGHT)]
        here = there
    return Walk(np.array(points, np.float64), np.array(tour, np.float64))


def build(draft: SceneDraft, triangles: int, seed: int) -> None:
    """Make the whole scene on `draft`."""
    halls = _halls(triangles, seed)
    columns, rows = (1 + max(key[axis] for key in halls) for axis in (0, 1))
    draft.writer.begin("plant")
    ground = boxes([(-20.0, -20.0, -0.75)], [(columns * LENGTH + 20, rows * DEPTH + 20, -0.25)])
    draft.add("ground", ground, "pavement")
    if triangles >= OUTSIDE_FROM:
        _outside(draft)
    for done, (place, hall) in enumerate(halls.items()):
        goal = draft.writer.triangles + draft.left // (len(halls) - done)
        _Builder(draft, hall, goal, np.random.default_rng([seed, 12, hall.number])).build(
            north_end=(place[0], place[1] + 1) not in halls, east_end=(place[0] + 1, place[1]) not in halls
        )
        draft.report()
    draft.writer.end()


def _outside(draft: SceneDraft) -> None:
    """Two chimneys and three spherical gas tanks west of the halls."""
    draft.writer.begin("outside")
    for k, y in enumerate((6.0, 13.0)):
        high = 26.0 - 4.0 * k
        edges = np.linspace(0.0, high, 8)
        shaft = [
            lathe([[0.0, a], [1.5 - 0.02 * a, a], [1.5 - 0.02 * b, b], [0.0, b]], 32).moved(-9.0, y, -0.25)
            for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
        ]
        draft.add(f"chimney {k + 1}", join([*shaft[:4], shaft[5]]), "light grey")
        draft.add(f"chimney {k + 1} bands", join([shaft[4], shaft[6]]), "red")
    for k in range(3):
        at = np.array([-11.0, 24.0 + 9.5 * k, 4.25])
        angle = np.arange(8) * (np.pi / 4)
        foot = at + np.stack([3.3 * np.cos(angle), 3.3 * np.sin(angle), np.full(8, -4.5)], axis=1)
        legs = cylinders(foot, foot + vec(0, 0, 5.2), 0.16, 12)
        braces = cylinders(foot + vec(0, 0, 0.2), np.roll(foot, 1, axis=0) + vec(0, 0, 3.6), 0.04, 8)
        draft.add(f"gas tank {k + 1}", sphere(3.5, 3).moved(*at.tolist()), "white")
        draft.add(f"gas tank {k + 1} legs", join([legs, braces]), "steel")
        edge = np.linspace(0.0, 2 * np.pi, 11)
        edge[-1] = 0.0
        rail = at + np.stack([1.2 * np.cos(edge), 1.2 * np.sin(edge), np.full(11, 3.3)], axis=1)
        draft.add(f"gas tank {k + 1} railing", equipment.handrail(rail), "yellow")
    draft.writer.end()


def _split(mesh: Mesh, count: int) -> list[Mesh]:
    """The `count` equal solids of a batch, one mesh each."""
    points, triangles = len(mesh.positions) // count, mesh.count // count
    first = mesh.triangles[:triangles]
    return [
        Mesh(mesh.positions[k * points : (k + 1) * points], mesh.normals[k * points : (k + 1) * points], first)
        for k in range(count)
    ]


@dataclass(frozen=True)
class _Fitting:
    """An instance on a pipe line."""

    name: str
    thing: str
    at: Point
    turn: Floats
    scale: float


@dataclass(frozen=True)
class _Line:
    """One pipe line and what sits on it."""

    name: str
    route: list[Point]
    radius: float
    fittings: list[_Fitting]


_ALONG = frames_along([[1.0, 0.0, 0.0]])[0]
_UPRIGHT = frames_along([[0.0, 0.0, 1.0]])[0]


@dataclass(frozen=True)
class _LineMaker:
    """Routes for one lane of a rack; `side` is +1 or -1, where the aisle is (y)."""

    name: str
    rack_y: float
    side: float
    y: float
    z: float
    radius: float

    @property
    def crossing(self) -> float:
        """The height at which the line crosses the other lanes."""
        return self.z + 0.52

    @property
    def outside(self) -> float:
        """Where legs go up and down (y)."""
        return self.rack_y + self.side * (RACK_HALF + 0.45)

    def _flange(self, number: int, at: Point, turn: Floats) -> _Fitting:
        return _Fitting(f"{self.name} flange {number}", "flange", at, turn, self.radius)

    def _valve(self, x: float, z: float) -> _Fitting:
        up, out = np.array([0.0, 0.0, 1.0]), np.array([0.0, self.side, 0.0])
        return _Fitting(
            f"{self.name} valve",
            "valve",
            (x, self.outside, z),
            np.stack([up, np.cross(out, up), out], axis=1),
            self.radius,
        )

    def pumped(self, x: float, target: Point) -> _Line | None:
        """From a pump under the rack at `x` up to the lane and down to `target`; None if they do not fit together."""
        if abs(x - target[0]) < 1.0 or target[2] > self.z + 0.2:
            return None
        route = [
            (x, self.rack_y + self.side * 0.45, 0.95), (x, self.outside, 0.95), (x, self.outside, self.crossing),
            (x, self.y, self.crossing), (x, self.y, self.z), (target[0], self.y, self.z),
            (target[0], self.y, self.crossing), (target[0], target[1], self.crossing), target,
        ]  # fmt: skip
        turn = turn_z(0.0 if self.side > 0 else 180.0)
        pump = _Fitting(f"{self.name} pump", "pump", (x + 0.25 * self.side, self.rack_y, 0.0), turn, 1.0)
        middle = self._flange(2, (x + (target[0] - x) * 0.43, self.y, self.z), _ALONG)
        high = self._flange(1, (target[0], target[1], (target[2] + self.crossing) / 2), _UPRIGHT)
        return _Line(self.name, route, self.radius, [pump, self._valve(x, 1.75), high, middle])

    def dropped(self, x: float) -> _Line:
        """From the rack's farther end to a leg at `x` that goes down to the floor."""
        end = 3.4 if x > LENGTH / 2 else LENGTH - 3.4
        route = [
            (end, self.y, self.z),
            (x, self.y, self.z),
            (x, self.y, self.crossing),
            (x, self.outside, self.crossing),
            (x, self.outside, 0.06),
        ]
        flanges = [self._flange(1, (x, self.outside, 0.12), _UPRIGHT), self._flange(2, (end, self.y, self.z), _ALONG)]
        return _Line(self.name, route, self.radius, [self._valve(x, 1.25), *flanges])

    def looped(self, x: float, half: float) -> _Line:
        """Straight through, with an expansion loop about `x`."""
        flat = [
            (3.4, self.z),
            (x - half, self.z),
            (x - half, self.crossing),
            (x + half, self.crossing),
            (x + half, self.z),
            (LENGTH - 3.4, self.z),
        ]
        route = [(along, self.y, high) for along, high in flat]
        flanges = [
            self._flange(k + 1, (end, self.y, self.z), _ALONG)
            for k, end in enumerate((3.4, x + half + 1.5, LENGTH - 3.4))
        ]
        return _Line(self.name, route, self.radius, flanges)


def _connections(ends: Floats, rack: int) -> list[Point]:
    """Where lines may end: on the tops of tanks (first rack) or vessels (second), as `_tanks`, `_vessels` give them."""
    found: list[Point] = []
    for x, y, top, size in ends.tolist():
        for offset in np.arange(-2, 3) * (0.3 * size if rack == 0 else 0.45 * size):
            drop = 0.08 + 0.12 * abs(offset) if rack == 0 else 0.05
            found.append((x + float(offset), y, top - float(drop)))
    return found


@dataclass
class _Builder:
    """Makes one hall in its own coordinates, within a goal of triangles counted over the whole scene."""

    draft: SceneDraft
    hall: Hall
    goal: int
    rng: np.random.Generator

    @property
    def left(self) -> int:
        """Triangles that may still be spent in this hall."""
        return self.goal - self.draft.writer.triangles

    def build(self, north_end: bool, east_end: bool) -> None:
        """Everything in the hall; walls to the north and east only where no other hall follows."""
        writer, name = self.draft.writer, self.hall.name
        share = self.left
        writer.begin(name, (self.hall.column * LENGTH, self.hall.row * DEPTH, 0.0))
        writer.begin(f"{name} structure")
        self._walls(north_end, east_end)
        self._steel()
        writer.end()
        tanks = self._tanks(share)
        vessels = self._vessels(share)
        if self.left > 0.45 * share:
            self._platform()
        for rack, y in enumerate(RACKS):
            if self.left < 4000:
                continue
            writer.begin(f"{name} rack {rack + 1}")
            self._rack(rack, y)
            spendable = self.left - 0.06 * share
            self._lines(rack, y, int(spendable * (0.42 if rack == 0 else 1.0)), tanks if rack == 0 else vessels)
            writer.end()
        self._fittings()
        self._conduits()
        writer.end()

    # ------------------------------------------------------------------------------------------ structure

    def _walls(self, north_end: bool, east_end: bool) -> None:
        hall, add, name = self.hall, self.draft.add, self.hall.name
        half = DOOR_WIDTH / 2
        high = HEIGHT + WALL
        outer = 3.5 if hall.yard else high  # a yard has low walls where it ends the plant
        clerestory = [(x, x + 3.0, 6.5, 7.5) for x in np.arange(3.0, LENGTH - 4.0, 5.0).tolist() if not hall.yard]
        lights = [(y, y + 2.5, 6.5, 7.5) for y in np.arange(3.0, DEPTH - 4.0, 4.0).tolist() if not hall.yard]
        add(f"{name} floor", boxes([(0.0, 0.0, -0.25)], [(LENGTH, DEPTH, 0.0)]), "concrete")
        door = (hall.south_door - half, hall.south_door + half, 0.0, DOOR_HEIGHT)
        holes = [door, *(clerestory if hall.row == 0 else [])]
        wall = plate("y", *openings((WALL, LENGTH), (0.0, outer if hall.row == 0 else high), holes), 0.0, WALL)
        add(f"{name} south wall", wall, "brick" if hall.row == 0 else "light grey")
        door = (hall.west_door - half, hall.west_door + half, 0.0, DOOR_HEIGHT)
        holes = [door, *(lights if hall.column == 0 else [])]
        wall = plate("x", *openings((0.0, DEPTH), (0.0, outer if hall.column == 0 else high), holes), 0.0, WALL)
        add(f"{name} west wall", wall, "brick" if hall.column == 0 else "light grey")
        if north_end:
            wall = plate("y", *openings((0.0, LENGTH), (0.0, outer), clerestory), DEPTH, DEPTH + WALL)
            add(f"{name} north wall", wall, "brick")
        if east_end:
            gate = (DEPTH / 2 - 2.0, DEPTH / 2 + 2.0, 0.0, 3.25)
            wall = plate("x", *openings((0.0, DEPTH), (0.0, outer), [gate, *lights]), LENGTH, LENGTH + WALL)
            add(f"{name} east wall", wall, "brick")
        self._lines_on_floor()
        frames_lo, frames_hi = [], []
        for at, across in ((hall.south_door, 1), (hall.west_door, 0)):
            for u0, u1, z0, z1 in (
                (at - half - 0.125, at - half + 0.03125, 0.0, 3.125),
                (at + half - 0.03125, at + half + 0.125, 0.0, 3.125),
                (at - half + 0.03125, at + half - 0.03125, DOOR_HEIGHT - 0.03125, 3.125),
            ):
                lo, hi = [u0, -0.0625, z0], [u1, WALL + 0.0625, z1]
                frames_lo.append(lo if across else [lo[1], lo[0], lo[2]])
                frames_hi.append(hi if across else [hi[1], hi[0], hi[2]])
        add(f"{name} door frames", boxes(frames_lo, frames_hi), "yellow")
        if hall.yard:
            return
        roof = boxes([(WALL, WALL, HEIGHT)], [(LENGTH, DEPTH, high)])
        domes_x, domes_y = np.meshgrid(np.arange(6.0, LENGTH - 3, 6.0), [6.0, 12.0, 18.0])
        domes = np.stack([domes_x.ravel(), domes_y.ravel(), np.full(domes_x.size, high)], axis=1)
        add(f"{name} roof", roof, "slate")
        add(f"{name} roof lights", boxes(domes - vec(0.75, 1.25, 0.0), domes + vec(0.75, 1.25, 0.375)), "light grey")
        if self.left > 20_000:
            for k, x in enumerate((9.0, 18.0, 27.0)):
                self.draft.put(f"{name} roof fan {k + 1}", "roof fan", (x, 9.0 + 6.0 * (k % 2), high))

    def _lines_on_floor(self) -> None:
        """Yellow lines along the walkways."""
        x0, x1, thin = 2.75, LENGTH - 2.5, 0.1
        lo = [(x0, y, 0.0) for y in (2.75, 10.5, 12.625, DEPTH - 2.5)] + [(x, 2.85, 0.0) for x in (x0, x1 - thin)]
        hi = [(x1, y + thin, 1 / 128) for y in (2.75, 10.5, 12.625, DEPTH - 2.5)] + [
            (x + thin, DEPTH - 2.5, 1 / 128) for x in (x0, x1 - thin)
        ]
        self.draft.add(f"{self.hall.name} floor lines", boxes(lo, hi), "yellow")

    def _steel(self) -> None:
        if self.hall.yard:
            return
        xs = np.array([3.0, 9.0, 15.0, 21.0, 27.0, 33.0])
        feet = np.array([[x, y, 0.0] for y in (0.45, DEPTH - 0.2) for x in xs])
        columns = beams(feet, feet + vec(0, 0, HEIGHT - 0.8), i_profile(0.25, 0.35), up=(0.0, 1.0, 0.0))
        pads = boxes(feet - vec(0.2, 0.2, 0.0), feet + vec(0.2, 0.2, 0.04))
        at = np.stack([xs, np.full(6, WALL), np.full(6, HEIGHT - 0.4)], axis=1)
        girders = beams(at, at + vec(0, DEPTH - WALL, 0), i_profile(0.3, 0.75))
        ys = np.arange(2.0, DEPTH - 1, 2.5)
        start = np.stack([np.full_like(ys, WALL), ys, np.full_like(ys, HEIGHT - 0.13)], axis=1)
        purlins = beams(start, start + vec(LENGTH - WALL, 0, 0), i_profile(0.14, 0.25))
        self.draft.add(f"{self.hall.name} columns", join([columns, pads]), "steel")
        self.draft.add(f"{self.hall.name} girders", girders, "steel")
        self.draft.add(f"{self.hall.name} purlins", purlins, "steel")

    def _rack(self, rack: int, y: float) -> None:
        name = f"{self.hall.name} rack {rack + 1}"
        high = LEVELS[-1] + 1.0
        feet = np.array([[x, y + side * (RACK_HALF + 0.1), 0.0] for x in FRAMES for side in (-1, 1)])
        columns = beams(feet, feet + vec(0, 0, high), i_profile(0.2, 0.2), up=(0.0, 1.0, 0.0))
        heights = [*(level - 0.21 for level in LEVELS), high - 0.1]
        start = np.array([[x, y - RACK_HALF, z] for x in FRAMES for z in heights])
        across = beams(start, start + vec(0, 2 * RACK_HALF, 0), i_profile(0.14, 0.2))
        start = np.array(
            [[FRAMES[0], y + side * (RACK_HALF + 0.1), z - 0.25] for side in (-1, 1) for z in heights[::2]]
        )
        along = beams(start, start + vec(FRAMES[-1] - FRAMES[0], 0, 0), i_profile(0.12, 0.16))
        self.draft.add(f"{name} frames", join([columns, across, along]), "steel")

    # ------------------------------------------------------------------------------------------ equipment

    def _tanks(self, share: int) -> Floats:
        """Vertical tanks in the southern strip; (k, 4): x, y, top, radius."""
        found: list[tuple[float, float, float, float]] = []
        name, rng = self.hall.name, self.rng
        self.draft.writer.begin(f"{name} tanks")
        x = 4.0
        while True:
            radius = float(np.round(rng.uniform(0.8, 1.6), 2))
            if x + 2 * radius > LENGTH - 4.0 or self.left < max(6000, 0.72 * share):
                break
            limit = 7.0 if not self.hall.yard else 17.0
            high = float(np.round(rng.uniform(3.0 + radius, limit), 2))
            centre = np.array([x + radius, TANKS_Y, 0.0])
            label = f"{name} tank {len(found) + 1}"
            body = equipment.tank(radius, high, 40).moved(*centre.tolist())
            zs = np.array([1.4, high * 0.45, high * 0.7])
            spouts = equipment.nozzles(centre, radius, zs, np.array([90.0, -90.0, 200.0]), 0.09)
            self.draft.add(label, join([body, spouts]), str(rng.choice(["insulation", "light grey", "cream", "white"])))
            foot = centre + vec(0.0, -radius - 0.22, 0.0)
            self.draft.add(f"{label} ladder", equipment.ladder(foot, high - radius / 2, 90.0), "yellow")
            for floor in np.arange(5.0, high - radius / 2 - 0.5, 4.0).tolist():
                if self.left > 0.5 * share:
                    grating, railing = equipment.gallery(centre, radius, floor)
                    self.draft.add(f"{label} gallery {floor:g}", grating, "galvanised")
                    self.draft.add(f"{label} gallery {floor:g} railing", railing, "yellow")
            found.append((x + radius, TANKS_Y, high, radius))
            x += 2 * radius + float(np.round(rng.uniform(0.8, 2.4), 2))
        self.draft.writer.end()
        return np.array(found, np.float64).reshape(-1, 4)

    def _vessels(self, share: int) -> Floats:
        """Horizontal vessels in the northern strip; (k, 4): x, y, top, usable half length."""
        found: list[tuple[float, float, float, float]] = []
        name, rng = self.hall.name, self.rng
        self.draft.writer.begin(f"{name} vessels")
        x = 11.0
        while True:
            radius, long = float(np.round(rng.uniform(0.6, 1.0), 2)), float(np.round(rng.uniform(3.0, 5.5), 2))
            if x + long + radius > LENGTH - 4.0 or self.left < max(5000, 0.62 * share):
                break
            label = f"{name} vessel {len(found) + 1}"
            shell, saddles = equipment.vessel(radius, long, 36)
            middle = x + radius / 2 + long / 2
            self.draft.add(
                label, shell.moved(middle, VESSELS_Y, 0.0), str(rng.choice(["insulation", "teal", "light grey"]))
            )
            self.draft.add(f"{label} saddles", saddles.moved(middle, VESSELS_Y, 0.0), "dark concrete")
            found.append((middle, VESSELS_Y, 2 * radius + 0.45, long / 2 - 0.2))
            x += long + radius + float(np.round(rng.uniform(0.8, 2.0), 2))
        self.draft.writer.end()
        return np.array(found, np.float64).reshape(-1, 4)

    def _platform(self) -> None:
        """A grating floor over the vessels with railings, on columns, and a stair up to it."""
        name = f"{self.hall.name} platform"
        panel = self.draft.cost("grating")
        rows, y0 = 4, 16.75
        columns = int(np.clip(0.16 * self.left / panel / rows, 4, 22))
        x0, x1 = 10.0, 10.0 + columns
        if self.left < panel * rows * columns + 4000:
            return
        self.draft.writer.begin(name)
        for k in range(rows * columns):
            self.draft.put(f"{name} grating {k + 1}", "grating", (x0 + k % columns, y0 + k // columns, PLATFORM))
        posts = np.array(
            [
                [x, y, 0.0]
                for x in np.linspace(x0 + 0.2, x1 - 0.2, 2 + columns // 6)
                for y in (y0 + 0.1, y0 + rows - 0.1)
            ]
        )
        columns_mesh = beams(posts, posts + vec(0, 0, PLATFORM - 0.235), i_profile(0.18, 0.18), up=(0.0, 1.0, 0.0))
        start = np.array([[x0, y, PLATFORM - 0.135] for y in (y0 + 0.1, y0 + rows / 2, y0 + rows - 0.1)])
        long = beams(start, start + vec(x1 - x0, 0, 0), i_profile(0.12, 0.2))
        start = np.array([[x, y0, PLATFORM - 0.135] for x in np.arange(x0 + 0.1, x1, 2.0)])
        short = beams(start, start + vec(0, rows, 0), i_profile(0.1, 0.18))
        self.draft.add(f"{name} steel", join([columns_mesh, long, short]), "steel")
        corners = np.array(
            [
                [x0, y0 + 1.1, PLATFORM],
                [x0, y0, PLATFORM],
                [x1, y0, PLATFORM],
                [x1, y0 + rows, PLATFORM],
                [x0, y0 + rows, PLATFORM],
                [x0, y0 + 2.4, PLATFORM],
            ]
        )
        self.draft.add(f"{name} railing", equipment.handrail(corners), "yellow")
        treads, rails = equipment.stairs(np.array([x0 - 5.5, y0 + 1.75, 0.0]), 5.5, PLATFORM, 0.9, 20)
        self.draft.add(f"{name} stairs", treads, "galvanised")
        self.draft.add(f"{name} stair railings", rails, "yellow")
        self.draft.writer.end()

    # ---------------------------------------------------------------------------------------------- pipes

    def _lines(self, rack: int, y: float, budget: int, ends: Floats) -> None:
        """Pipe lines on the rack's lanes, the lower levels first, as far as `budget` triangles go."""
        rng, draft = self.rng, self.draft
        lanes = [(level, lane) for level in range(len(LEVELS)) for lane in range(len(LANES))]
        order = np.argsort([level + 1.6 * rng.uniform() for level, _ in lanes], kind="stable")
        slots = np.arange(4.5, 32.0, 0.4)
        free = rng.permutation(slots[np.abs(slots[:, None] - FRAMES).min(axis=1) > 0.35]).tolist()
        targets = _connections(ends, rack)
        rng.shuffle(targets)
        batches: dict[tuple[int, int], list[_Line]] = {}
        fittings: list[_Fitting] = []
        for number, place in enumerate(order.tolist()):
            level, lane = lanes[place]
            radius = float(rng.choice(BORES))
            side = 1.0 if rack == 0 else -1.0  # where the aisle is
            maker = _LineMaker(
                f"{self.hall.name} rack {rack + 1} line {number + 1}",
                y,
                side,
                y + float(LANES[lane]),
                LEVELS[level] - 0.11 + radius,
                radius,
            )
            line = None
            if number % 3 == 0 and free and targets:
                line = maker.pumped(free[-1], targets[-1])
                targets.pop()
            if line is None and number % 3 < 2 and free:
                line = maker.dropped(free[-1])
            if line is None:
                line = maker.looped(float(rng.uniform(8.0, LENGTH - 8.0)), float(rng.uniform(0.6, 1.2)))
            elif free:
                free.pop()
            sides = 12 if radius < 0.06 else 16
            cost = tube_triangles(len(line.route), sides, BEND_STEPS) + sum(
                draft.cost(each.thing) for each in line.fittings
            )
            if cost > budget:
                break
            budget -= cost
            fittings += line.fittings
            batches.setdefault((len(line.route), sides), []).append(line)
        for (_, sides), lines in sorted(batches.items()):
            routes = np.array([line.route for line in lines])
            made = tubes(routes, np.array([line.radius for line in lines]), BEND, sides, BEND_STEPS)
            for line, mesh in zip(lines, _split(made, len(lines)), strict=True):
                draft.add(line.name, mesh, PAINTS[int(rng.integers(0, len(PAINTS)))])
        for each in fittings:
            draft.put(each.name, each.thing, each.at, each.turn, each.scale)

    # ------------------------------------------------------------------------------------------- the rest

    def _fittings(self) -> None:
        """Lamps, switch cabinets and cable ladders, as far as the triangles go."""
        draft, name, rng = self.draft, self.hall.name, self.rng
        if not self.hall.yard:
            for k in range(10):
                if self.left > draft.cost("hall lamp") + 1000:
                    at = (4.5 + 6.6 * (k % 5), 3.0 if k < 5 else MIDDLE_AISLE, HEIGHT - 0.78)
                    draft.put(f"{name} lamp {k + 1}", "hall lamp", at)
        for k in range(6):
            if self.left > draft.cost("switch cabinet") + 1000:
                draft.put(
                    f"{name} switch cabinet {k + 1}", "switch cabinet", (5.0 + 1.65 * k, 16.7, 0.0), turn_z(180.0)
                )
        for rack, y in enumerate(RACKS):
            for k in range(2):
                if self.left < 3500:
                    return
                offsets = np.arange(6) * 0.07 - 0.175
                cables = np.stack([offsets, rng.uniform(0.012, 0.03, 6)], axis=1)
                ladder, wires = equipment.tray(3.4, LENGTH - 3.4, y - 0.5 + k, LEVELS[-1] + 1.0, 0.5, cables)
                draft.add(f"{name} rack {rack + 1} cable ladder {k + 1}", ladder, "galvanised")
                draft.add(f"{name} rack {rack + 1} cables {k + 1}", wires, "black")

    def _conduits(self) -> None:
        """Small pipes high on the walls with drops, in groups of twelve: what is left of the triangles."""
        each = tube_triangles(4, 8, 4)
        count = self.left // each
        if count < 1:
            return
        k = np.arange(count)
        row, group = k % 12, k // 12
        south, column = group % 2 == 0, group // 2
        y = np.where(south, WALL + 0.06, DEPTH - 0.06)
        z = 4.0 + 0.08 * row + 1.0 * (column % 2)
        x0 = 3.6 + 0.06 * row + 1.9 * (column // 2 % 14)
        x1 = LENGTH - 3.6 - 0.06 * row - 0.9 * (column // 2 % 14)
        low = 1.2 + 0.02 * row
        corners = [(x0, low), (x0, z), (x1, z), (x1, low)]
        route = np.stack([np.stack([x, y, high], axis=1) for x, high in corners], axis=1)
        parts = _split(tubes(route, np.full(count, 0.016), 3.0, 8, 4), count)
        for first in range(0, count, 12):
            mesh = join(parts[first : first + 12])
            self.draft.add(f"{self.hall.name} conduits {first // 12 + 1}", mesh, "galvanised")


SCENE = SceneKind(build, walk, equipment.RECIPES)
