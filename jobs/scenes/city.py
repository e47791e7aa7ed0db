"""A city: blocks with streets between them, buildings one can walk into, parks, cars and trees.

Buildings have facades with window openings, storeys with corridors, rooms, stairs and furniture, and roofs with
parapets. The storeys of a building share their shell (an instance); so do cars, trees, lamps, window frames and
furniture. A larger request adds blocks. In the middle of the city the buildings are taller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jobs.scenes.things import street
from jobs.scenes.things.draft import EYE_HEIGHT, Point, SceneDraft, SceneKind, Walk
from jobs.scenes.things.furnish import Plan, furnish
from jobs.scenes.things.furnishings import FURNISHINGS
from jobs.scenes.things.rooms import CLEAR, DOOR_HEIGHT, DOOR_WIDTH, INNER, OUTER, STOREY, Room
from jobs.scenes.things.solids import Floats, Mesh, boxes, cylinders, join, openings, plate, tubes, turn_z, vec

BLOCK, STREET = 56.0, 12.0  # metres: a block with its pavements, a street between kerbs
PITCH = BLOCK + STREET
KERB = 0.125
PAVEMENT = 3.0  # metres between the kerb and the lots
LOT = 25.0
WALKING_LINE = 2.125  # metres from the kerb: nothing stands there
CORRIDOR = 2.0
SHELL_SHARE, SHELL_TRIANGLES = 0.32, 3_200  # of all triangles for the buildings' shells; a storey's shell takes about
CORE = 4.75  # metres: the stair core's length along the building
FACADES = ("brick", "cream", "sandstone", "terracotta", "light grey", "ochre", "plaster")
HOMES = ("lounge", "kitchen", "bedroom", "lounge", "bedroom", "bath", "office")
WORK = ("office", "open", "meeting", "library", "office")


@dataclass(frozen=True)
class Building:
    """One building; its own frame has the corner at the origin, x along the corridor, the entrance at x = 0."""

    number: int
    at: tuple[float, float]  # its origin in the block's frame
    flipped: bool  # turned by 180 degrees
    width: float  # along x
    depth: float  # along y
    storeys: int
    home: bool
    facade: str
    rooms: tuple[Room, ...]

    def place(self, x: float, y: float) -> tuple[float, float]:
        """A point of the building's frame in the block's."""
        return (self.at[0] - x, self.at[1] - y) if self.flipped else (self.at[0] + x, self.at[1] + y)

    @property
    def middle(self) -> float:
        """The middle (y) of the corridor."""
        return self.depth / 2


@dataclass(frozen=True)
class Block:
    """One place in the city's grid."""

    number: int
    column: int
    row: int
    buildings: tuple[Building, ...]  # none in a park

    @property
    def name(self) -> str:
        """Its name in the scene."""
        return f"{'block' if self.buildings else 'park'} {self.number + 1}"


def _rooms(width: float, depth: float, home: bool, rng: np.random.Generator) -> tuple[Room, ...]:
    """The rooms of every storey of a building."""
    south, north = depth / 2 - CORRIDOR / 2 - INNER, depth / 2 + CORRIDOR / 2 + INNER
    rooms: list[Room] = []
    for side, end in ((False, width - OUTER), (True, width - OUTER - CORE - INNER)):
        count = max(2, round((end - OUTER) / 5.5))
        edges = np.round(np.linspace(OUTER, end + INNER, count + 1) * 8) / 8
        for k in range(count):
            x0, x1 = float(edges[k]), float(edges[k + 1]) - INNER
            rooms.append(
                Room(
                    number=len(rooms) + 1,
                    north=side,
                    x0=x0,
                    x1=x1,
                    y0=north if side else OUTER,
                    y1=depth - OUTER if side else south,
                    door=round((x0 + x1) * 4) / 8,
                    open=bool(k == 0 or rng.uniform() < 0.6),
                    angle=float(rng.integers(80, 96)),
                    hinge_east=k % 2 == 1 or k == count - 1,
                    kind=str(rng.choice(HOMES if home else WORK)),
                )
            )
    return tuple(rooms)


def _blocks(triangles: int, seed: int) -> dict[tuple[int, int], Block]:
    """The grid of blocks by (column, row)."""
    each = min(250_000.0, 40_000.0 * max(1.0, triangles / 100_000) ** 0.5)
    count = max(1, round(triangles / each))
    columns = max(1, round(count**0.5))
    rows = -(-count // columns)
    number = np.arange(count)
    row, column = number // columns, number % columns
    park = (number % 7 == 3) & (number + 1 < count) & (count > 3)
    off = np.hypot(column - (columns - 1) / 2, row - (rows - 1) / 2) / max(1.0, columns / 2)
    weight = np.where(park, 0.0, 1.45 - 0.75 * np.minimum(1.2, off))
    storeys = SHELL_SHARE * triangles / SHELL_TRIANGLES * weight / weight.sum()
    return {
        (int(column[k]), int(row[k])): Block(
            number=k,
            column=int(column[k]),
            row=int(row[k]),
            buildings=() if park[k] else _buildings(float(storeys[k]), np.random.default_rng([seed, 31, k])),
        )
        for k in range(count)
    }


def _buildings(storeys: float, rng: np.random.Generator) -> tuple[Building, ...]:
    """Four buildings, or fewer if there are not enough storeys to go round."""
    lots = rng.permutation(4)[: int(np.clip(storeys // 1.5, 1, 4))]
    shares = rng.uniform(0.4, 1.0, len(lots)) ** 2
    shares *= storeys / shares.sum()
    buildings = []
    for lot, share in sorted(zip(lots.tolist(), shares.tolist(), strict=True)):
        east, north = lot % 2 == 1, lot >= 2
        width, depth = float(rng.integers(36, 49)) / 2, float(rng.integers(28, 41)) / 2
        home = bool(rng.uniform() < 0.6)
        inset = PAVEMENT
        x = BLOCK - inset if east else inset
        if north:
            y = BLOCK - inset if east else BLOCK - inset - depth
        else:
            y = inset + depth if east else inset
        buildings.append(
            Building(
                number=lot + 1,
                at=(x, y),
                flipped=east,
                width=width,
                depth=depth,
                storeys=max(1, round(share)),
                home=home,
                facade=str(rng.choice(FACADES)),
                rooms=_rooms(width, depth, home, rng),
            )
        )
    return tuple(buildings)


def walk(triangles: int, seed: int) -> Walk:
    """View points on pavements, in streets, corridors and rooms, and a tour through up to eight blocks."""
    blocks = _blocks(triangles, seed)
    eye = KERB + EYE_HEIGHT
    points: list[Point] = []
    for block in blocks.values():
        x0, y0 = block.column * PITCH, block.row * PITCH
        line = (WALKING_LINE, BLOCK / 2, BLOCK - WALKING_LINE)
        points += [(x0 + x, y0 + y, eye) for x in line for y in line if not (x == y == BLOCK / 2)]
        points += [(x0 + BLOCK / 2, y0 - STREET / 2, EYE_HEIGHT), (x0 - STREET / 2, y0 + BLOCK / 2, EYE_HEIGHT)]
        for building in block.buildings:
            spots = [(x, building.middle) for x in (1.5, building.width / 2, building.width - 1.5)]
            spots += [(room.door, room.strip) for room in building.rooms]
            places = [building.place(*spot) for spot in spots]
            points += [(x0 + x, y0 + y, k * STOREY + eye) for k in range(building.storeys) for x, y in places]
    tour: list[Point] = []
    columns = 1 + max(column for column, _ in blocks)
    for step in range(min(len(blocks), 8)):
        row, along = divmod(step, columns)
        place = (along if row % 2 == 0 else columns - 1 - along, row)
        if place not in blocks:
            break
        tour += [(place[0] * PITCH + x, row * PITCH + y, eye) for x, y in _block_tour(blocks[place], row % 2 == 1)]
    return Walk(np.array(points, np.float64), np.array(tour, np.float64))


def _block_tour(block: Block, westwards: bool) -> list[tuple[float, float]]:
    """Along a block's southern and side pavements and into one building, in the block's frame.

    It starts at the southern corner where the one before ends and finishes at the other southern corner; at the end of
    a row of blocks the leg to the next row passes along the side pavement.
    """
    low, high = WALKING_LINE, BLOCK - WALKING_LINE
    start, end = (high, low) if westwards else (low, high)
    if not block.buildings:
        return [(start, low), (end, low)]
    building = min(block.buildings, key=lambda each: each.flipped != westwards)
    side = high if building.flipped else low
    door = building.place(0.0, building.middle)[1]
    room = building.rooms[0]
    inside = [(1.5, building.middle), (room.door, building.middle), (room.door, room.strip)]
    inside += [(room.door, building.middle), (building.width - 1.5, building.middle), (1.5, building.middle)]
    points = [(start, low), (side, low), (side, door), *(building.place(*spot) for spot in inside)]
    points += [(side, door), (side, low), (end, low)]
    return [point for k, point in enumerate(points) if k == 0 or point != points[k - 1]]


def build(draft: SceneDraft, triangles: int, seed: int) -> None:
    """Make the whole scene on `draft`."""
    blocks = _blocks(triangles, seed)
    columns, rows = (1 + max(key[axis] for key in blocks) for axis in (0, 1))
    draft.writer.begin("city")
    edge = 2 * STREET
    ground = boxes(
        [(-edge, -edge, -0.5)], [((columns - 1) * PITCH + BLOCK + edge, (rows - 1) * PITCH + BLOCK + edge, 0.0)]
    )
    draft.add("streets", ground, "asphalt")
    for done, block in enumerate(blocks.values()):
        goal = draft.writer.triangles + draft.left // (len(blocks) - done)
        rng = np.random.default_rng([seed, 32, block.number])
        draft.writer.begin(block.name, (block.column * PITCH, block.row * PITCH, 0.0))
        draft.add(f"{block.name} pavement", boxes([(0.0, 0.0, 0.0)], [(BLOCK, BLOCK, KERB)]), "pavement")
        for building in block.buildings:
            _shell(draft, block, building, goal, rng)
        _streets(draft, block, goal, rng)
        if block.buildings:
            _interiors(draft, block, goal, rng)
        else:
            _park(draft, block, goal, rng)
        draft.writer.end()
        draft.report()
    draft.writer.end()


# -------------------------------------------------------------------------------------------------- streets


def _streets(draft: SceneDraft, block: Block, goal: int, rng: np.random.Generator) -> None:
    """Markings, and what stands on the pavements and by the kerb, as far as a third of the triangles left goes."""
    name = block.name
    draft.writer.begin(f"{name} street")
    draft.put(f"{name} dashes south", "dashes", (BLOCK / 2, -STREET / 2, 0.0))
    draft.put(f"{name} dashes west", "dashes", (-STREET / 2, BLOCK / 2, 0.0), turn_z(90.0))
    draft.put(f"{name} crossing west", "crossing", (-STREET / 2, WALKING_LINE, 0.0))
    draft.put(f"{name} crossing south", "crossing", (WALKING_LINE, -STREET / 2, 0.0), turn_z(90.0))
    spots: list[tuple[float, str, Point, float]] = []
    far = BLOCK - 0.75
    sides = [
        (0.0, (0.0, 0.75), (1, 0)),
        (180.0, (0.0, far), (1, 0)),
        (270.0, (0.75, 0.0), (0, 1)),
        (90.0, (far, 0.0), (0, 1)),
    ]
    paints = [thing for thing in street.RECIPES if thing.startswith(("car", "van"))]
    for degrees, (x0, y0), (dx, dy) in sides:
        for u in np.arange(8.0, BLOCK - 7.0, 8.0).tolist():
            tree = "conifer" if rng.uniform() < 0.15 else f"tree {rng.integers(0, 3)}"
            furniture = str(rng.choice(["bench", "litter bin"]))
            spots.append((rng.uniform() + 0.35, tree, (x0 + u * dx, y0 + u * dy, KERB), float(rng.integers(0, 360))))
            for rank, thing, step in ((0.6, "street lamp", 4.0), (0.9, furniture, 2.0)):
                if u % 16 == 0:
                    at = (x0 + (u + step) * dx, y0 + (u + step) * dy, KERB)
                    spots.append((rng.uniform() * rank, thing, at, degrees))
    for lane in range(2):
        for u in np.arange(10.0, BLOCK - 9.0, 6.0).tolist():
            place = u + float(rng.uniform(-0.5, 0.5))
            paint = paints[int(rng.integers(0, len(paints)))]
            x, y, degrees = (place, -1.1, 180.0) if lane == 0 else (-1.1, place, 90.0)
            spots.append((rng.uniform() + 0.3, paint, (x, y, 0.0), degrees))
            if rng.uniform() < 0.15:
                x, y, degrees = (place, -STREET / 2 - 1.8, 0.0) if lane == 0 else (-STREET / 2 - 1.8, place, 270.0)
                spots.append((rng.uniform() + 0.3, paint, (x, y, 0.0), degrees))
    left = (goal - draft.writer.triangles) // 3
    for number, (_, thing, at, degrees) in enumerate(sorted(spots)):
        cost = draft.cost(thing)
        if cost <= left:
            left -= cost
            draft.put(f"{name} {thing} {number + 1}", thing, at, turn_z(degrees))
    draft.writer.end()


def _park(draft: SceneDraft, block: Block, goal: int, rng: np.random.Generator) -> None:
    """Lawns, paths, a fountain, and trees as far as the triangles go."""
    name = block.name
    grid = np.array([PAVEMENT, 14.0, 17.0, BLOCK / 2 - 6, BLOCK / 2 + 6, BLOCK - 17.0, BLOCK - 14.0, BLOCK - PAVEMENT])
    lawn = np.ones((7, 7), bool)
    lawn[[1, 5], :] = lawn[:, [1, 5]] = False
    lawn[3, :] = lawn[:, 3] = False
    draft.add(f"{name} lawns", plate("z", grid, grid, lawn, KERB, KERB + 0.0625), "grass")
    if goal - draft.writer.triangles > draft.cost("fountain"):
        draft.put(f"{name} fountain", "fountain", (BLOCK / 2, BLOCK / 2, KERB))
    for k in range(12):
        angle = 30.0 * k
        at = turn_z(angle) @ np.array([0.0, -5.0, 0.0])
        if goal - draft.writer.triangles > draft.cost("bench"):
            draft.put(
                f"{name} bench {k + 1}",
                "bench",
                (BLOCK / 2 + float(at[0]), BLOCK / 2 + float(at[1]), KERB),
                turn_z(angle + 180),
            )
    for number in range(160):
        u, v = rng.uniform(5.0, BLOCK - 5.0, 2).tolist()
        thing = str(rng.choice(["tree 0", "tree 1", "tree 2", "conifer"]))
        on_lawn = lawn[np.searchsorted(grid, u) - 1, np.searchsorted(grid, v) - 1]
        if on_lawn and goal - draft.writer.triangles > draft.cost(thing):
            draft.put(f"{name} tree {number + 1}", thing, (u, v, KERB), turn_z(float(rng.integers(0, 360))))


# ------------------------------------------------------------------------------------------------ buildings


def _windows(length: float, home: bool) -> Floats:
    """Windows (k, 2) of one storey along a wall of `length`: from, to."""
    bay, wide = (3.0, 1.25) if home else (2.5, 1.75)
    count = int((length - 1.5) // bay)
    start = (length - count * bay) / 2 + (bay - wide) / 2 + np.arange(count) * bay
    return np.stack([start, start + wide], axis=1)


def _shell(draft: SceneDraft, block: Block, building: Building, goal: int, rng: np.random.Generator) -> None:
    """Facades, roof, and the storeys' shells."""
    name = f"{block.name} building {building.number}"
    wide, deep, storeys = building.width, building.depth, building.storeys
    high = storeys * STOREY
    low_sill, head = (0.875, 2.5) if building.home else (0.75, 2.75)
    draft.writer.begin(name, (*building.at, KERB), turn_z(180.0) if building.flipped else None)
    along, across = _windows(wide, building.home), _windows(deep, building.home)
    rows = [(k * STOREY + low_sill, k * STOREY + head) for k in range(storeys)]
    holes = [(u0, u1, v0, v1) for v0, v1 in rows for u0, u1 in along.tolist()]
    for side, y in (("south", 0.0), ("north", deep - OUTER)):
        draft.add(
            f"{name} {side} wall", plate("y", *openings((0.0, wide), (0.0, high), holes), y, y + OUTER), building.facade
        )
    middle = building.middle
    entrance = (middle - 0.75, middle + 0.75, 0.0, 2.5)
    clear = [(u0, u1) for u0, u1 in across.tolist() if u1 < middle - 1.125 or u0 > middle + 1.125]
    holes = [(u0, u1, v0, v1) for v0, v1 in rows for u0, u1 in clear]
    ends = [(middle - 0.5, middle + 0.5, v0, v1) for v0, v1 in rows]
    for side, x, extra in (("west", 0.0, [entrance, *ends[1:]]), ("east", wide - OUTER, ends)):
        wall = plate("x", *openings((OUTER, deep - OUTER), (0.0, high), [*holes, *extra]), x, x + OUTER)
        draft.add(f"{name} {side} wall", wall, building.facade)
    z = np.arange(1, storeys + 1) * STOREY - 0.1875
    bands = []
    for a, b, c, d in (
        (-0.125, wide + 0.125, -0.125, 0.0),
        (-0.125, wide + 0.125, deep, deep + 0.125),
        (-0.125, 0.0, 0.0, deep),
        (wide, wide + 0.125, 0.0, deep),
    ):
        ones = np.ones(storeys)
        bands.append(boxes(np.stack([a * ones, c * ones, z], 1), np.stack([b * ones, d * ones, z + 0.1875], 1)))
    draft.add(f"{name} bands", join(bands), "light grey")
    _roof(draft, name, building, goal, rng)
    shell = draft.writer.mesh(
        f"{name} storey shell", [(mesh, draft.material(what)) for mesh, what in _storey_shell(building)]
    )
    frames = draft.writer.mesh(
        f"{name} window frames", [(_frames(building, along, clear, low_sill, head), draft.material("slate"))]
    )
    stairs = (
        draft.writer.mesh(f"{name} stairs", [(_stairs(building), draft.material("concrete"))]) if storeys > 1 else None
    )
    draft.add(f"{name} ground floor", boxes([(0.0, 0.0, 0.0)], [(wide, deep, 1 / 64)]), "dark concrete")
    for k in range(storeys):
        at = (0.0, 0.0, k * STOREY)
        draft.writer.place(f"{name} storey {k + 1} shell", shell, at)
        draft.writer.place(f"{name} storey {k + 1} window frames", frames, at)
        if stairs is not None and k + 1 < storeys:
            draft.writer.place(f"{name} storey {k + 1} stairs", stairs, at)
            slab = plate(
                "z",
                *openings((OUTER, wide - OUTER), (OUTER, deep - OUTER), [_stair_well(building)]),
                (k + 1) * STOREY - 0.25,
                (k + 1) * STOREY,
            )
            draft.add(f"{name} slab {k + 1}", slab, "concrete")
    _street_front(draft, name, building, along, goal, rng)
    draft.writer.end()


def _stair_well(building: Building) -> tuple[float, float, float, float]:
    """The opening in the slabs."""
    x1 = building.width - OUTER
    y0 = building.middle + CORRIDOR / 2 + INNER
    return (x1 - 3.5, x1, y0 + 1.0, building.depth - OUTER)


def _stairs(building: Building) -> Mesh:
    """Two flights beside each other with a landing, filling the well, and a railing."""
    x0, x1, y0, y1 = _stair_well(building)
    run = (y1 - y0 - 1.0) / 10
    rise, half = STOREY / 20, (x1 - x0) / 2
    k = np.arange(10)
    one = np.ones(10)
    up = boxes(
        np.stack([x0 * one, y0 + k * run, np.maximum(k * rise - 0.125, 0.0)], 1),
        np.stack([(x0 + half - 0.1) * one, y0 + (k + 1) * run, (k + 1) * rise], 1),
    )
    landing = boxes([(x0, y1 - 1.0, STOREY / 2 - 0.2)], [(x1, y1, STOREY / 2)])
    down = boxes(
        np.stack([(x0 + half + 0.1) * one, y1 - 1.0 - (k + 1) * run, STOREY / 2 + k * rise - 0.125], 1),
        np.stack([x1 * one, y1 - 1.0 - k * run, STOREY / 2 + (k + 1) * rise], 1),
    )
    x = x0 + half
    rail = tubes(
        [[[x, y0, 0.1], [x, y0, 1.0], [x, y1 - 1.0, STOREY / 2 + 1.0], [x, y1 - 1.0, STOREY / 2 + 0.05]]],
        0.03,
        2.0,
        10,
        4,
    )
    t = np.linspace(0.1, 0.9, 7)
    low = np.stack([np.full(7, x), y0 + (y1 - 1.0 - y0) * t, STOREY / 2 * t + 0.1], axis=1)
    return join([up, landing, down, rail, cylinders(low, low + vec(0, 0, 0.88), 0.01, 6)])


def _storey_shell(building: Building) -> list[tuple[Mesh, str]]:
    """Inner walls, door frames and floors of one storey."""
    wide = building.width
    south, north = building.middle - CORRIDOR / 2 - INNER, building.middle + CORRIDOR / 2
    walls = []
    for side, y in ((False, south), (True, north)):
        holes = [
            (r.door - DOOR_WIDTH / 2, r.door + DOOR_WIDTH / 2, 0.0, DOOR_HEIGHT)
            for r in building.rooms
            if r.north == side
        ]
        if side:
            holes.append((wide - OUTER - CORE + 0.25, wide - OUTER - CORE + 1.5, 0.0, DOOR_HEIGHT))
        walls.append(plate("y", *openings((OUTER, wide - OUTER), (0.0, CLEAR), holes), y, y + INNER))
    last = {side: max(r.x1 for r in building.rooms if r.north == side) for side in (False, True)}
    cross = [r for r in building.rooms if r.north or r.x1 < last[False]]
    walls.append(boxes([(r.x1, r.y0, 0.0) for r in cross], [(r.x1 + INNER, r.y1, CLEAR) for r in cross]))
    lo, hi, floor_lo, floor_hi = [], [], [], []
    for r in building.rooms:
        near, far = (north - 1 / 32, north + INNER + 1 / 32) if r.north else (south - 1 / 32, south + INNER + 1 / 32)
        left, right = r.door - DOOR_WIDTH / 2, r.door + DOOR_WIDTH / 2
        lo += [(left - 1 / 16, near, 0.0), (right - 1 / 64, near, 0.0), (left + 1 / 64, near, DOOR_HEIGHT - 1 / 64)]
        hi += [
            (left + 1 / 64, far, DOOR_HEIGHT + 1 / 16),
            (right + 1 / 16, far, DOOR_HEIGHT + 1 / 16),
            (right - 1 / 64, far, DOOR_HEIGHT + 1 / 16),
        ]
        floor_lo.append((r.x0, r.y0, 0.0))
        floor_hi.append((r.x1, r.y1, 1 / 32))
    carpet = boxes([(OUTER, south + INNER, 0.0)], [(wide - OUTER, north, 1 / 32)])
    return [
        (join(walls), "plaster"),
        (boxes(lo, hi), "wood dark"),
        (boxes(floor_lo, floor_hi), "wood" if building.home else "carpet light"),
        (carpet, "fabric red" if building.home else "carpet"),
    ]


def _frames(building: Building, along: Floats, clear: list[tuple[float, float]], low: float, high: float) -> Mesh:
    """The frames of one storey's windows."""
    lo, hi = [], []
    sets = [
        (along.tolist(), 0, 0.0625),
        (along.tolist(), 0, building.depth - 0.125),
        (clear, 1, 0.0625),
        (clear, 1, building.width - 0.125),
    ]
    for windows, axis, at in sets:
        for u0, u1 in windows:
            middle = (u0 + u1) / 2
            for a, b, c, d in (
                (u0, u1, low, low + 0.0625),
                (u0, u1, high - 0.0625, high),
                (middle - 0.03125, middle + 0.03125, low + 0.0625, high - 0.0625),
            ):
                lo.append((a, at, c) if axis == 0 else (at, a, c))
                hi.append((b, at + 0.0625, d) if axis == 0 else (at + 0.0625, b, d))
    return boxes(lo, hi)


def _roof(draft: SceneDraft, name: str, building: Building, goal: int, rng: np.random.Generator) -> None:
    """Roof slab, parapet, stair hut and what stands on the roof."""
    wide, deep, z = building.width, building.depth, building.storeys * STOREY
    slab = boxes([(OUTER, OUTER, z - 0.25)], [(wide - OUTER, deep - OUTER, z)])
    grid_x, grid_y = [0.0, OUTER, wide - OUTER, wide], [0.0, OUTER, deep - OUTER, deep]
    parapet = plate("z", grid_x, grid_y, [[1, 1, 1], [1, 0, 1], [1, 1, 1]], z, z + 0.875)
    x0, x1, y0, y1 = _stair_well(building)
    hut = boxes(
        [(x0, y0, z), (x0 - 0.15, y0 - 0.15, z + 2.5)], [(x1 - 0.5, y1 - 0.5, z + 2.5), (x1 - 0.35, y1 - 0.35, z + 2.7)]
    )
    draft.add(f"{name} roof", slab, "slate")
    draft.add(f"{name} parapet", parapet, building.facade)
    draft.add(f"{name} roof hut", hut, "light grey")
    if building.storeys > 1:
        for k in range(int(rng.integers(1, 4))):
            if goal - draft.writer.triangles > 12_000:
                draft.put(
                    f"{name} air conditioner {k + 1}",
                    "air conditioner",
                    (2.5 + 3.6 * k, deep * 0.35, z),
                    turn_z(90.0 * (k % 2)),
                )
    if building.storeys > 3 and rng.uniform() < 0.6 and goal - draft.writer.triangles > 12_000:
        draft.put(f"{name} water tank", "water tank", (3.0, deep - 3.5, z))


def _street_front(
    draft: SceneDraft, name: str, building: Building, along: Floats, goal: int, rng: np.random.Generator
) -> None:
    """Awnings over the ground floor or balconies above it, on the southern and northern sides, and a canopy."""
    canopy = boxes([(-1.2, building.middle - 1.25, 2.6)], [(0.0, building.middle + 1.25, 2.75)])
    draft.add(f"{name} canopy", canopy, "slate")
    for k, (u0, u1) in enumerate(along.tolist()):
        middle = (u0 + u1) / 2
        if goal - draft.writer.triangles < 9_000:
            return
        if not building.home:
            draft.put(f"{name} awning {k + 1}", "awning", (middle, 0.0, 3.25))
        elif rng.uniform() < 0.5:
            for storey in range(1, building.storeys):
                at = (middle, 0.0, storey * STOREY + 0.5)
                if storey % 2:
                    draft.put(f"{name} balcony {k + 1} {storey}", "balcony", at)


def _interiors(draft: SceneDraft, block: Block, goal: int, rng: np.random.Generator) -> None:
    """Furnish all storeys of a block evenly, up to `goal` triangles of the scene."""
    left = sum(building.storeys for building in block.buildings)
    for building in block.buildings:
        name = f"{block.name} building {building.number}"
        plan = Plan.of(draft, building.rooms)
        draft.writer.begin(f"{name} interior", (*building.at, KERB), turn_z(180.0) if building.flipped else None)
        for k in range(building.storeys):
            label = f"{name} storey {k + 1}"
            draft.writer.begin(label, (0.0, 0.0, k * STOREY + 1 / 32))
            furnish(draft, draft.writer.triangles + (goal - draft.writer.triangles) // left, plan, rng, label)
            draft.writer.end()
            left -= 1
        draft.writer.end()


SCENE = SceneKind(build, walk, FURNISHINGS | street.RECIPES)
