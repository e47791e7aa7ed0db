"""The service floor of a large building: pipes, rods, cables and ducts along walls and ceilings, of many radii.

Bays stand in rows between two slabs, with columns and pieces of wall but no facade, and every fourth is open above:
what is thin is seen against the sky. A million triangles are 20,000 pipes, rods, cables and ducts; a larger request
adds bays. All are parts of their own or small bundles; hangers, clamps, lamps and sprinklers are instances.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jobs.scenes.things import equipment
from jobs.scenes.things.draft import EYE_HEIGHT, Point, SceneDraft, SceneKind, Walk
from jobs.scenes.things.furnishings import Pairs, blocks
from jobs.scenes.things.solids import Floats, Mesh, boxes, cylinders, join, lathe, ring, tube_triangles, tubes

LENGTH, DEPTH, HEIGHT = 12.0, 9.0, 4.5  # of a bay, and its clear height, in metres
SLAB = 0.3
EACH = 10_000.0  # triangles of a bay, about
AISLE = 0.8  # half of the width that stays free along the middle of each row, and beside the columns across it
FREE = 2.4  # how high it is free
LOWEST, HIGHEST = 2.6, 4.35  # where runs hang
TOUR_ROWS = 10
SIDES = 8  # of what fills up: the thinnest pipes
COLOURS = ("galvanised", "insulation", "green", "blue", "yellow", "red", "grey", "orange", "brass", "white")


@dataclass(frozen=True)
class _Bay:
    """One place in the grid."""

    number: int
    column: int
    row: int

    @property
    def name(self) -> str:
        """Its name in the scene."""
        return f"bay {self.number + 1}"


def _bays(triangles: int) -> list[_Bay]:
    """The grid of bays, row by row."""
    count = max(2, round(triangles / EACH))
    columns = max(2, round((count * DEPTH / LENGTH) ** 0.5))
    return [_Bay(k, k % columns, k // columns) for k in range(count)]


def walk(triangles: int, seed: int) -> Walk:  # noqa: ARG001
    """View points along the aisles, and a tour that takes up to ten of them in a snake."""
    bays = _bays(triangles)
    spots = (1.0, 3.5, 6.0, 8.5, 11.0)
    points = [(bay.column * LENGTH + x, (bay.row + 0.5) * DEPTH, EYE_HEIGHT) for bay in bays for x in spots]
    ends: dict[int, float] = {}
    for bay in bays:
        ends[bay.row] = (bay.column + 1) * LENGTH - AISLE
    tour: list[Point] = []
    for row, end in sorted(ends.items())[:TOUR_ROWS]:
        y = (row + 0.5) * DEPTH
        way = (AISLE, end)
        if row % 2:  # from where the row before ended, or from this one's end where it is shorter
            way = (min(ends[row - 1], end), AISLE)
            if way[0] < ends[row - 1]:
                tour.append((way[0], y - DEPTH, EYE_HEIGHT))
        tour += [(x, y, EYE_HEIGHT) for x in way]
    return Walk(np.array(points, np.float64), np.array(tour, np.float64))


def build(draft: SceneDraft, triangles: int, seed: int) -> None:
    """Make the whole scene on `draft`."""
    bays = _bays(triangles)
    draft.writer.begin("services")
    for done, bay in enumerate(bays):
        goal = draft.writer.triangles + draft.left // (len(bays) - done)
        draft.writer.begin(bay.name, (bay.column * LENGTH, bay.row * DEPTH, 0.0))
        _Builder(draft, bay, goal, np.random.default_rng([seed, 21, bay.number])).build()
        draft.writer.end()
        draft.report()
    draft.writer.end()


@dataclass
class _Builder:
    """Fills one bay in its own coordinates, within a goal of triangles counted over the whole scene."""

    draft: SceneDraft
    bay: _Bay
    goal: int
    rng: np.random.Generator
    _made: int = 0

    @property
    def left(self) -> int:
        """Triangles that may still be spent in this bay."""
        return self.goal - self.draft.writer.triangles

    def build(self) -> None:
        """Slabs, columns and wall first; then kinds of services by turns, until only a few triangles are left."""
        self._structure()
        turns = self._turns()
        while self.left > 1500:
            next(turns)
        self._fill()

    def _turns(self) -> Iterator[None]:
        while True:
            for work in (
                self._pipes, self._conduits, self._cables, self._hangers, self._risers, self._pipes, self._ducts,
                self._cables, self._rods, self._lines, self._ceiling,
            ):  # fmt: skip
                yield work()

    def _add(self, what: str, mesh: Mesh, material: str | None = None) -> None:
        self._made += 1
        colour = material or COLOURS[int(self.rng.integers(len(COLOURS)))]
        self.draft.add(f"{self.bay.name} {what} {self._made}", mesh, colour)

    def _put(self, thing: str, at: Point) -> None:
        self._made += 1
        self.draft.put(f"{self.bay.name} {thing} {self._made}", thing, at)

    def _structure(self) -> None:
        self.draft.writer.begin(f"{self.bay.name} structure")
        slabs = [((0.0, 0.0, -SLAB), (LENGTH, DEPTH, 0.0))]
        if self.bay.number % 4 == 1:  # open to the sky
            slabs += [((x, 0.0, HEIGHT), (x + 0.2, DEPTH, HEIGHT + SLAB)) for x in np.arange(0.0, LENGTH, 3.0).tolist()]
        else:
            slabs.append(((0.0, 0.0, HEIGHT), (LENGTH, DEPTH, HEIGHT + SLAB)))
        self._add("slabs", boxes([lo for lo, _ in slabs], [hi for _, hi in slabs]), "concrete")
        column = boxes([(0.0, 0.0, 0.0)], [(0.3, 0.3, HEIGHT)])
        self._add("column", column, "dark concrete")
        if self.bay.number % 3:
            self._add("wall", boxes([(3.0, 0.0, 0.0)], [(LENGTH - 2.5, 0.15, HEIGHT)]), "plaster")
        self.draft.writer.end()

    def _across(self, count: int) -> Floats:
        """Where runs lie across the row: (count,)."""
        return self.rng.uniform(0.5, DEPTH - 0.3, count)

    def _runs(self, count: int) -> tuple[Floats, Floats]:
        """Straight ways (count, 3) below the ceiling from here to there; one in three leads across the row."""
        y, z = self._across(count), self.rng.uniform(LOWEST, HIGHEST, count)
        long = self.rng.uniform(2.0, LENGTH - 0.6, count)
        x = 0.3 + self.rng.uniform(size=count) * (LENGTH - 0.6 - long)
        starts, ends = np.stack([x, y, z], axis=1), np.stack([x + long, y, z], axis=1)
        if self.rng.uniform() < 1 / 3:
            at = self.rng.uniform(0.5, LENGTH - 0.5, count)
            part = long / LENGTH * (DEPTH - 0.6)
            begin = 0.3 + self.rng.uniform(size=count) * (DEPTH - 0.6 - part)
            starts, ends = np.stack([at, begin, z], axis=1), np.stack([at, begin + part, z], axis=1)
        return starts, ends

    def _pipes(self) -> None:
        """Four pipes with an offset each, which carry clamps."""
        starts, ends = self._runs(4)
        radii = np.exp(self.rng.uniform(np.log(0.015), np.log(0.12), 4))
        shift = np.where(starts[:, 2] > (LOWEST + HIGHEST) / 2, -0.8, 0.8)[:, None] * np.array([0.0, 0.0, 1.0])
        middle = starts + (ends - starts) * self.rng.uniform(0.35, 0.65, (4, 1))
        routes = np.stack([starts, middle, middle + shift, ends + shift], axis=1)
        for route, radius in zip(routes, radii, strict=True):
            self._add("pipe", tubes(route[None], [radius], 1.8, 12, 3))
        for start, radius in zip(starts.tolist(), radii.tolist(), strict=True):
            if radius < 0.05:
                self._put("clamp", (start[0], start[1], start[2]))

    def _lines(self) -> None:
        """Twelve straight pipes."""
        starts, ends = self._runs(12)
        radii = np.exp(self.rng.uniform(np.log(0.01), np.log(0.08), 12))
        for start, end, radius in zip(starts, ends, radii, strict=True):
            self._add("line", cylinders([start], [end], radius, 10))

    def _conduits(self) -> None:
        """A bundle of conduits side by side."""
        count = int(self.rng.integers(4, 13))
        start, end = (np.repeat(at, count, axis=0) for at in self._runs(1))
        along_y = start[0, 0] == end[0, 0]
        shift = np.zeros((count, 3))
        shift[:, 0 if along_y else 1] = np.arange(count) * 0.05 - 0.025 * count
        self._add("conduits", cylinders(start + shift, end + shift, 0.008 + 0.002 * (count % 5), SIDES), "galvanised")

    def _cables(self) -> None:
        """Cables that hang through a little between their ends."""
        count = int(self.rng.integers(3, 10))
        starts, ends = self._runs(count)
        radii = np.exp(self.rng.uniform(np.log(0.003), np.log(0.012), count))
        sag = np.zeros((count, 3))
        sag[:, 2] = -self.rng.uniform(0.03, 0.15, count)
        routes = np.stack([starts, starts + (ends - starts) / 3 + sag, ends - (ends - starts) / 3 + sag, ends], axis=1)
        self._add("cables", tubes(routes, radii, 2.0, 6, 1), "black")

    def _rods(self) -> None:
        """Threaded rods from the ceiling."""
        count = 10
        at = np.stack([self.rng.uniform(0.4, LENGTH - 0.4, count), self._across(count), np.full(count, HEIGHT)], axis=1)
        low = at.copy()
        low[:, 2] -= self.rng.uniform(0.3, HEIGHT - LOWEST, count)
        self._add("rods", cylinders(low, at, 0.003 + 0.002 * float(self.rng.integers(3)), 6), "steel")

    def _risers(self) -> None:
        """Pipes that stand along the row's border, away from where one walks."""
        count = int(self.rng.integers(2, 7))
        x = self.rng.uniform(2 * AISLE, LENGTH - 2 * AISLE) + np.arange(count) * 0.14
        x = x[x < LENGTH - 2 * AISLE]
        y = np.full(len(x), 0.35 if self.rng.uniform() < 0.5 else DEPTH - 0.2)
        radii = np.exp(self.rng.uniform(np.log(0.008), np.log(0.06), len(x)))
        low, high = (np.stack([x, y, np.full(len(x), z)], axis=1) for z in (0.0, HEIGHT))
        for start, end, radius in zip(low, high, radii, strict=True):
            self._add("riser", cylinders([start], [end], radius, 10))

    def _ducts(self) -> None:
        """Two ducts, of sheet metal."""
        starts, ends = self._runs(2)
        half = np.stack([self.rng.uniform(0.1, 0.35, 2), self.rng.uniform(0.08, 0.18, 2)], axis=1)
        across = np.where((starts[:, 0] == ends[:, 0])[:, None], [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        reach = across * half[:, :1] + np.array([0.0, 0.0, 1.0]) * half[:, 1:]
        for lo, hi in zip(starts - reach, ends + reach, strict=True):
            self._add("duct", boxes([lo], [hi]), "galvanised")

    def _hangers(self) -> None:
        """A row of hangers for what runs along the row."""
        y = float(self._across(1)[0])
        for x in np.arange(1.0, LENGTH, 2.5).tolist():
            self._put("hanger", (x, y, HEIGHT))

    def _ceiling(self) -> None:
        """A lamp, sprinklers and a junction box."""
        x, y = self.rng.uniform(0.5, LENGTH - 0.5, 4).tolist(), self._across(4).tolist()
        for thing, at, across in zip(("lamp", "sprinkler", "sprinkler", "junction box"), x, y, strict=True):
            self._put(thing, (at, across, HEIGHT))

    def _fill(self) -> None:
        """Straight thin pipes: what is left of the triangles."""
        count = self.left // tube_triangles(2, SIDES, 1)
        if count > 0:
            starts, ends = self._runs(count)
            self._add("small pipes", cylinders(starts, ends, 0.008, SIDES), "brass")


def _hanger() -> Pairs:
    """Two rods and a channel, from a ceiling at the origin."""
    rods = cylinders([[0, -0.3, -1.2], [0, 0.3, -1.2]], [[0, -0.3, 0], [0, 0.3, 0]], 0.005, 6)
    return [(join([rods, blocks((0, 0, -1.2, 0.04, 0.7, 0.04))]), "steel")]


def _clamp() -> Pairs:
    """A ring about a pipe along x at the origin."""
    return [(ring(0.06, 0.008, 12, 4).turned(equipment.X_UP), "steel")]


def _lamp() -> Pairs:
    """A batten lamp below a ceiling at the origin."""
    return [(blocks((0, 0, -0.5, 1.2, 0.08, 0.05)), "glow"), (blocks((0, 0, -0.45, 0.01, 0.01, 0.45)), "steel")]


def _sprinkler() -> Pairs:
    """A sprinkler head below a ceiling at the origin."""
    profile: list[list[float]] = [
        [0, -0.42],
        [0.03, -0.42],
        [0.03, -0.41],
        [0.012, -0.4],
        [0.012, -0.36],
        [0.008, -0.35],
        [0.008, 0],
        [0, 0],
    ]
    return [(lathe(profile, 10), "brass")]


def _junction_box() -> Pairs:
    """A box on a rod, below a ceiling at the origin."""
    return [(blocks((0, 0, -0.6, 0.2, 0.15, 0.12), (0, 0, -0.48, 0.012, 0.012, 0.48)), "grey")]


RECIPES = {
    "clamp": _clamp,
    "hanger": _hanger,
    "junction box": _junction_box,
    "lamp": _lamp,
    "sprinkler": _sprinkler,
}

SCENE = SceneKind(build, walk, RECIPES)
