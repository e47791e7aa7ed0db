"""An oracle for visibility: Embree rays from a cell's surface into its full cut.

Shares no code with the visibility engine: it knows triangles, rays and boxes only. Every hit that would accuse the
engine is confirmed in double precision first, because Embree's single precision lets rays slip between triangles that
meet along an edge.

Rays go on through what can be seen through, and note it on their way. A ray that has noted something starts again a
little behind it, so of two panes in the very same place it notes one; but whoever aims at a pane knows where it is, and
needs to ask only how far the ray gets.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

#: A ray goes through at most this many backs of one-sided drawables.
MOST_PASSES = 64
#: A ray goes through at most this many triangles that can be seen through.
MOST_PANES = 256
#: A ray that is aimed at a pane sees it where nothing stops the ray up to this much behind it, in ray lengths.
BEHIND = 1e-5
#: Triangles of which it is found out at once to which side they face.
SIDES_AT_ONCE = 1 << 16
#: Rays per suspected drawable that are confirmed in double precision before it is let go.
CONFIRMATIONS = 8


@dataclass(frozen=True)
class Sight:
    """A drawable as seen by a ray. Model units."""

    drawable: int
    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    distance: float


class Triangles(Protocol):
    """What rays from a cell can meet: the triangles of things, numbered on from one thing to the next."""

    @property
    def things(self) -> np.ndarray:
        """(k,) int64 names of the things, increasing."""
        ...

    @property
    def starts(self) -> np.ndarray:
        """(k + 1,) int64: triangles starts[i] ... starts[i + 1] - 1 are those of thing i."""
        ...

    @property
    def see_through(self) -> np.ndarray:
        """(k,) bool which things can be seen through: they stop no ray."""
        ...

    def corners(self, numbers: np.ndarray) -> np.ndarray:
        """The corners (n, 3, 3) float32 of triangles (n,), in model units."""
        ...

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where rays from origins (n, 3) float32 along directions (n, 3) float32 are stopped.

        Returns the triangles (n,) int64, -1 where nothing stops them, and the distances (n,) float64 in ray lengths.
        """
        ...

    def passed(self, origins: np.ndarray, directions: np.ndarray, until: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What such rays go through before they have gone `until` (n,) float64 ray lengths.

        Returns the numbers of rays (k,) int64 and of triangles (k,) int64, in no particular order. Of what lies in the
        very same place only one is sure to be there.
        """
        ...

    def confirmed(self, origins: np.ndarray, directions: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """Distances (n,) float64 at which rays (n, 3) float32 meet triangles (n,), in double precision and ray lengths.

        nan where another thing's triangle that stops them comes first, or lies at the very same place.
        """
        ...


class _Scene:
    """Some of the triangles, as Embree holds them."""

    def __init__(self, triangles: np.ndarray, chosen: np.ndarray) -> None:
        self._chosen = chosen
        self._scene = rtcore_scene.EmbreeScene()
        if len(chosen):
            TriangleMesh(self._scene, np.ascontiguousarray(triangles[chosen], np.float32))

    def hit(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The triangles (n,) int64 that rays hit first, -1 for none, and the distances (n,) float64 in ray lengths."""
        if not len(self._chosen) or not len(origins):
            return np.full(len(origins), -1, np.int64), np.full(len(origins), np.inf)
        # copies: Embree is given plain rows
        hit = self._scene.run(np.array(origins, np.float32), np.array(directions, np.float32), output=True)
        struck = hit["primID"].astype(np.int64) >= 0
        return (
            np.where(struck, self._chosen[np.where(struck, hit["primID"], 0).astype(np.int64)], -1),
            np.where(struck, hit["tfar"].astype(np.float64), np.inf),
        )


class Oracle:
    """All triangles of one cell's cut, ready for rays."""

    def __init__(
        self,
        triangles: np.ndarray,
        owner: np.ndarray,
        one_sided: np.ndarray,
        see_through: np.ndarray | None = None,
        cell: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> None:
        """Take the cut.

        Args:
            triangles: (m, 3, 3) float32 corners in model units.
            owner: (m,) int64 drawable of each triangle.
            one_sided: (m,) bool: hits on the triangle's back do not count; the ray goes on.
            see_through: (m,) bool, the same for all of a drawable: the ray goes on as well, but has seen it; None: no
                triangle.
            cell: lo and hi (3,) float64 of the box in which all rays begin, in model units; None: they begin anywhere.

        Which side of a triangle a ray meets is known from where it begins. So triangles that turn their backs to the
        whole cell are left out, and of those that turn their fronts to all of it every hit counts.
        """
        self._triangles = triangles
        self._owner = owner
        self._one_sided = one_sided
        self._see_through = np.zeros(len(triangles), np.bool_) if see_through is None else see_through
        fronts, backs = ~one_sided, np.zeros(len(triangles), np.bool_)
        if cell is not None:
            for first in range(0, len(triangles), SIDES_AT_ONCE):
                some = slice(first, first + SIDES_AT_ONCE)
                in_front, behind = _sides(triangles[some], *cell)
                fronts[some] |= in_front
                backs[some] = behind & one_sided[some]
        self._fronts = np.flatnonzero(fronts & ~self._see_through)
        self._mixed = np.flatnonzero(~fronts & ~backs & ~self._see_through)
        self._panes = np.flatnonzero(~backs & self._see_through)

    @cached_property
    def things(self) -> np.ndarray:
        """See `Triangles`."""
        return np.unique(self._owner)

    @cached_property
    def starts(self) -> np.ndarray:
        """See `Triangles`."""
        return np.append(np.searchsorted(self._owner, self.things), len(self._owner))

    @cached_property
    def see_through(self) -> np.ndarray:
        """See `Triangles`."""
        return self._see_through[self.starts[:-1]]

    def corners(self, numbers: np.ndarray) -> np.ndarray:
        """See `Triangles`."""
        return self._triangles[numbers]

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where rays from origins (n, 3) float32 along directions (n, 3) float32 are stopped.

        Returns the triangles (n,) int64, -1 where nothing stops them, and the distances (n,) float64 in ray lengths.

        A ray that passes a back starts again a little behind it, and would step over a front in the very same place,
        such as that of a slab which touches a wall that the ray leaves. So rays that meet a back first are cast again,
        in scenes of which none holds two one-sided triangles that lie back to back.
        """
        found, distance = self._front_scene.hit(origins, directions)
        if not len(self._mixed):
            return found, distance
        other, along = self._mixed_scene.hit(origins, directions)
        back = np.flatnonzero(self._backs(other, directions) & (along < distance))
        if len(back):
            other[back], along[back] = self._cast_through_backs(origins[back], directions[back], distance[back])
        nearer = along < distance
        return np.where(nearer, other, found), np.where(nearer, along, distance)

    def passed(self, origins: np.ndarray, directions: np.ndarray, until: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Triangles`."""
        rays, triangles = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        waiting = np.arange(len(origins) if len(self._panes) else 0)
        gone = np.zeros(len(origins))
        # rounding the next start to float32 must not put it before what was met
        least = 2.0**-21 * np.abs(origins).max(axis=1) / np.maximum(np.abs(directions).max(axis=1), 1e-30)
        for _ in range(MOST_PANES):
            if not len(waiting):
                break
            start = (origins[waiting] + gone[waiting, None] * directions[waiting]).astype(np.float32)
            triangle, along = self._pane_scene.hit(start, directions[waiting])
            met = (triangle >= 0) & (gone[waiting] + along < until[waiting])
            waiting, triangle, along = waiting[met], triangle[met], along[met]
            shown = ~self._backs(triangle, directions[waiting])
            rays.append(waiting[shown])
            triangles.append(triangle[shown])
            gone[waiting] = (gone[waiting] + along) * (1 + 1e-6) + least[waiting]
        return np.concatenate(rays), np.concatenate(triangles)

    @cached_property
    def _pane_scene(self) -> _Scene:
        """Triangles that can be seen through."""
        return _Scene(self._triangles, self._panes)

    @cached_property
    def _front_scene(self) -> _Scene:
        """Triangles whose hits all count."""
        return _Scene(self._triangles, self._fronts)

    @cached_property
    def _mixed_scene(self) -> _Scene:
        """Triangles whose fronts count and whose backs do not."""
        return _Scene(self._triangles, self._mixed)

    @cached_property
    def _turned_scenes(self) -> list[_Scene]:
        """The same, parted so that no two of a scene lie back to back."""
        corners = self._triangles[self._mixed].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        axis = np.abs(normal).argmax(axis=1)
        # the six directions into which normals point most: opposite normals never share one
        turn = 2 * axis + (normal[np.arange(len(axis)), axis] < 0)
        return [_Scene(self._triangles, self._mixed[turn == k]) for k in range(6)]

    def _backs(self, triangles: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(n,) bool: which hits are on backs that do not count, of triangles (n,), -1 for none."""
        corners = self._triangles[triangles].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        back: np.ndarray = (triangles >= 0) & self._one_sided[triangles] & ((normal * directions).sum(axis=1) > 0)
        return back

    def _cast_through_backs(
        self, origins: np.ndarray, directions: np.ndarray, farthest: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """As `cast`, scene by scene, of triangles that show fronts or backs; nothing beyond `farthest` (n,)."""
        nearest = np.full(len(origins), -1, np.int64)
        distance = farthest.copy()
        for scene in self._turned_scenes:
            waiting = np.arange(len(origins))
            gone = np.zeros(len(origins))
            for _ in range(MOST_PASSES):
                start = (origins[waiting] + gone[waiting, None] * directions[waiting]).astype(np.float32)
                triangle, along = scene.hit(start, directions[waiting])
                back = self._backs(triangle, directions[waiting])
                nearer = (triangle >= 0) & ~back & (gone[waiting] + along < distance[waiting])
                nearest[waiting[nearer]] = triangle[nearer]
                distance[waiting[nearer]] = gone[waiting[nearer]] + along[nearer]
                waiting, along = waiting[back], along[back]
                gone[waiting] = (gone[waiting] + along) * (1 + 1e-6)
                ahead = gone[waiting] < distance[waiting]
                waiting = waiting[ahead]
                if not len(waiting):
                    break
        distance[nearest < 0] = np.inf
        return nearest, distance

    @cached_property
    def _boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """The triangles' boxes: their lowest and their highest corners (m, 3) float32."""
        return self._triangles.min(axis=1), self._triangles.max(axis=1)

    def confirm(self, origin: np.ndarray, direction: np.ndarray, triangle: int, *, alone: bool = True) -> float:
        """Whether a ray meets a triangle before all others that stop it, in double precision.

        Args:
            origin, direction: (3,) float32, taken as exact.
            alone: whether it must not meet another drawable at the same place, since of two coincident faces either
                may be the one that is seen.

        Returns:
            The distance in ray lengths, or nan where another drawable's triangle that stops it comes first.
        """
        distance = distance_to(self._triangles[triangle], origin, direction)
        owner = int(self._owner[triangle])
        if np.isnan(distance) or self.blocks(origin, direction, distance, owner, alone=alone):
            return float("nan")
        return distance

    def confirmed(self, origins: np.ndarray, directions: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """See `Triangles`."""
        rays = zip(origins, directions, numbers.tolist(), strict=True)
        return np.array([self.confirm(*ray) for ray in rays], np.float64)

    def blocks(
        self, origin: np.ndarray, direction: np.ndarray, distance: float, owner: int, *, alone: bool = True
    ) -> bool:
        """Whether a ray meets a triangle that stops it before it has gone `distance`, in double precision.

        owner: whose triangles do not count; the rest as in `confirm`.
        """
        o, d = origin.astype(np.float64), direction.astype(np.float64)
        reach = o + d * distance
        low, high = np.minimum(o, reach), np.maximum(o, reach)
        lowest, highest = self._boxes
        others = (self._owner != owner) & ~self._see_through
        near = np.flatnonzero(((lowest <= high) & (highest >= low)).all(axis=1) & others)
        blockers = self._triangles[near].astype(np.float64)
        at, met = _intersect(blockers, o, d, -1e-9)
        normal = np.cross(blockers[:, 1] - blockers[:, 0], blockers[:, 2] - blockers[:, 0])
        counts = ~(self._one_sided[near] & ((normal * d).sum(axis=1) > 0))
        scale = 1e-12 * max(float(np.abs(low).max()), float(np.abs(high).max())) / max(float(np.abs(d).max()), 1e-300)
        return bool((met & counts & (at >= 0) & (at <= distance + (scale if alone else -scale))).any())


def _sides(triangles: np.ndarray, lo: np.ndarray, hi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of triangles (m, 3, 3) float32: which show only fronts, and which only backs, to all of a box lo to hi (3,).

    Two arrays (m,) bool; both False where the box reaches through a triangle's plane, or rounding leaves it open.
    """
    corners = triangles.astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.abs(normal)
    middle, half = (lo + hi) / 2, (hi - lo) / 2
    above = ((middle - corners[:, 0]) * normal).sum(axis=1)
    farthest = max(float(np.abs(triangles).max(initial=0.0)), float(np.abs(lo).max()), float(np.abs(hi).max()))
    reach = size @ half + size.sum(axis=1) * (1e-9 * farthest)
    return above > reach, above < -reach


def distance_to(corners: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> float:
    """How far a ray goes until it meets a triangle (3, 3), in double precision and ray lengths; nan where it misses."""
    t, inside = _intersect(
        corners[None].astype(np.float64), origin.astype(np.float64), direction.astype(np.float64), -1e-7
    )
    return float(t[0]) if inside[0] else float("nan")


def _intersect(
    corners: np.ndarray, origin: np.ndarray, direction: np.ndarray, slack: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n,) along one ray to triangles (n, 3, 3) float64, and whether each is met.

    `slack` is the least barycentric coordinate that counts as inside. Based on: T. Möller, B. Trumbore: Fast, Minimum
    Storage Ray-Triangle Intersection, 1997.
    """
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    p = np.cross(direction, second)
    determinant = (first * p).sum(axis=1)
    flat = determinant == 0
    inverse = 1.0 / np.where(flat, 1.0, determinant)
    s = origin - corners[:, 0]
    u = (s * p).sum(axis=1) * inverse
    q = np.cross(s, first)
    v = (q @ direction) * inverse
    t = (second * q).sum(axis=1) * inverse
    return t, ~flat & (u >= slack) & (v >= slack) & (u + v <= 1 - slack)


def surface_points(lo: np.ndarray, hi: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) float32 points on a box's surface, its eight corners first; rounded so that all lie inside the box."""
    # two float32 steps inward at the largest coordinate, so that rounding cannot leave the box
    inward = np.minimum(np.maximum(np.maximum(np.abs(lo), np.abs(hi)) * 2.0**-22, (hi - lo) * 1e-7), (hi - lo) / 4)
    low, high = lo + inward, hi - inward
    points = low + rng.random((count, 3)) * (high - low)
    axis = rng.integers(0, 3, count)
    upper = rng.integers(0, 2, count) == 1
    rows = np.arange(count)
    points[rows, axis] = np.where(upper, high[axis], low[axis])
    corners = np.array([[high[k] if bit >> k & 1 else low[k] for k in range(3)] for bit in range(8)])
    points[: min(8, count)] = corners[: min(8, count)]
    rounded: np.ndarray = np.clip(points, lo, hi).astype(np.float32)
    return rounded


@dataclass(frozen=True)
class Findings:
    """What rays from one cell saw."""

    rays: int
    seen: np.ndarray  # (k,) sorted drawables
    missed: list[Sight]  # drawables seen but not reported, confirmed in double precision
    refuted: int  # suspected drawables whose hits double precision did not confirm
    uniform: int  # rays in uniform directions
    missed_rays: int  # of these, saw one of the missed drawables


def examine(
    triangles: Triangles,
    lo: np.ndarray,
    hi: np.ndarray,
    reported: np.ndarray,
    samples: int,
    rng: np.random.Generator,
) -> Findings:
    """Look for drawables that can be seen from a cell but are not reported.

    A third of the rays go in uniform directions, the rest are aimed at random points of drawables not seen so far:
    half of these at drawables that were not reported. The rays start on the cell's surface, its corners included. They
    see what they are stopped by, and what they go through before.

    Args:
        triangles: those of the cell's whole cut, drawables being the things.
        lo, hi: (3,) float64 the cell; reported: sorted drawable ids; samples: number of rays.
    """
    seen: set[int] = set()
    suspects: dict[int, list[tuple[np.ndarray, np.ndarray, int]]] = {}
    known = set(reported.tolist())
    drawables, starts = triangles.things, triangles.starts
    rays = 0

    def shoot(groups: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
        """Casts groups of rays, all at once: origins, directions, and the triangles that they are aimed at or -1.

        Returns rays (h,) of the last group, by their numbers, and drawables (h,) that they saw.
        """
        nonlocal rays
        origins, directions, aims = (np.concatenate(parts) for parts in zip(*groups, strict=True))
        rays += len(origins)
        found, along = triangles.cast(origins, directions)
        through, panes = triangles.passed(origins, directions, along)
        stopped = np.flatnonzero(found >= 0)
        aimed = np.flatnonzero((aims >= 0) & (along > 1 + BEHIND))
        aimed = aimed[triangles.see_through[np.searchsorted(starts, aims[aimed], side="right") - 1]]
        who = np.concatenate([stopped, through, aimed])
        numbers = np.concatenate([found[stopped], panes, aims[aimed]])
        whom = drawables[np.searchsorted(starts, numbers, side="right") - 1]
        ends = np.cumsum([len(group[0]) for group in groups])
        for begin, end in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=True):
            own = np.flatnonzero((who >= begin) & (who < end))
            _, once = np.unique(numbers[own], return_index=True)
            for hit in own[once].tolist():
                drawable = int(whom[hit])
                if drawable in known:
                    seen.add(drawable)
                else:
                    rows = suspects.setdefault(drawable, [])
                    if len(rows) < CONFIRMATIONS:
                        rows.append((origins[who[hit]], directions[who[hit]], int(numbers[hit])))
        return who[own] - begin, whom[own]

    uniform = samples - 2 * (samples // 3)
    points = surface_points(lo, hi, uniform, rng)
    who, whom = shoot([(points, rng.normal(size=(uniform, 3)).astype(np.float32), np.full(uniform, -1, np.int64))])
    left = samples - uniform
    rounds = 4
    for part in range(rounds):
        count = left // (rounds - part)
        left -= count
        unseen = ~np.isin(drawables, np.fromiter(seen, np.int64, len(seen)))
        hidden = unseen & ~np.isin(drawables, reported)
        groups = []
        for group, number in ((hidden, count // 2), (unseen & ~hidden, count - count // 2)):
            choices = np.flatnonzero(group)
            if not len(choices):
                choices = np.arange(len(drawables))
            if not number or not len(choices):
                continue
            chosen = choices[rng.integers(0, len(choices), number)]
            triangle = starts[chosen] + (rng.random(number) * (starts[chosen + 1] - starts[chosen])).astype(np.int64)
            weights = rng.dirichlet((1.0, 1.0, 1.0), number)
            targets = (triangles.corners(triangle).astype(np.float64) * weights[:, :, None]).sum(axis=1)
            origins = surface_points(lo, hi, number, rng)[rng.permutation(number)]
            groups.append((origins, (targets - origins).astype(np.float32), triangle))
        if groups:
            shoot(groups)

    missed = _confirmed(triangles, suspects)
    seen.update(sight.drawable for sight in missed)
    missed_rays = len(np.unique(who[np.isin(whom, [sight.drawable for sight in missed])]))
    refuted = len(suspects) - len(missed)
    return Findings(rays, np.array(sorted(seen), np.int64), missed, refuted, uniform, missed_rays)


def _confirmed(triangles: Triangles, suspects: dict[int, list[tuple[np.ndarray, np.ndarray, int]]]) -> list[Sight]:
    """The drawables that one of the rays (origin, direction, triangle) kept of each surely sees, sorted."""
    missed: dict[int, Sight] = {}
    for attempt in range(CONFIRMATIONS):
        asked = {d: rows[attempt] for d, rows in suspects.items() if d not in missed and attempt < len(rows)}
        if not asked:
            break
        origins, directions, numbers = (np.array(values) for values in zip(*asked.values(), strict=True))
        distances = triangles.confirmed(origins, directions, numbers)
        for (drawable, (origin, direction, _)), distance in zip(asked.items(), distances.tolist(), strict=True):
            if not np.isnan(distance):
                start, along = tuple(map(float, origin)), tuple(map(float, direction))
                missed[drawable] = Sight(drawable, start, along, distance)  # type: ignore[arg-type]
    return [missed[drawable] for drawable in sorted(missed)]
