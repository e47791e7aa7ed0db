"""Facets: what a cell is said to see only from behind shows none of its fronts to any point of the cell, exactly."""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from storage.meshes.facets import find_turned_away, part_meshes
from storage.meshes.placement import transform_points
from storage.store import Store
from tests.storage.tiny_store import box_part, make_store, room_parts

#: Points of a cell at which triangles are looked at: its corners, and some in between.
POINTS = 40


def ball(rng: np.random.Generator, size: float) -> tuple[np.ndarray, np.ndarray]:
    """A closed surface around the origin, wound outward: an octahedron divided, then stretched and dented at random."""
    points = [tuple(p) for p in np.concatenate([np.eye(3), -np.eye(3)]).tolist()]
    faces = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    for _ in range(int(rng.integers(0, 4))):
        between: dict[tuple[int, int], int] = {}

        def middle(a: int, b: int, between: dict[tuple[int, int], int] = between) -> int:
            key = (min(a, b), max(a, b))
            if key not in between:
                p = np.add(points[a], points[b])
                between[key] = len(points)
                points.append(tuple((p / np.linalg.norm(p)).tolist()))
            return between[key]

        faces = [
            face
            for a, b, c in faces
            for d, e, f in [(middle(a, b), middle(b, c), middle(c, a))]
            for face in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))
        ]
    shape = np.array(points) * rng.uniform(0.02, 1, 3)
    shape *= 1 + rng.choice([0.0, 0.02, 0.3]) * rng.uniform(-1, 1, (len(shape), 1))
    return np.rint(size * shape).astype(np.int32), np.array(faces, np.uint32)


class Parted(NamedTuple):
    """A mesh, its triangles facet by facet."""

    positions: np.ndarray  # (n, 3) int32
    triangles: np.ndarray  # (m, 3) uint32
    facets: np.ndarray  # (f,) triangles of each
    cones: np.ndarray  # (f, CONE)

    def away(self, lo: np.ndarray, hi: np.ndarray, scale: float, matrix: np.ndarray | None, step: float) -> np.ndarray:
        """Which triangles (m,) a cell sees from behind."""
        matrices = np.zeros((0, 3, 4)) if matrix is None else matrix[None]
        away = find_turned_away(
            np.zeros(1, np.int64), np.array([len(self.facets)]), np.array([-1 if matrix is None else 0]),
            np.array([scale]), self.cones, matrices, step, np.asarray(lo, np.float64), np.asarray(hi, np.float64),
        )  # fmt: skip
        return np.repeat(away, self.facets)


def parted(points: np.ndarray, triangles: np.ndarray, one_sided: bool = True) -> Parted:
    order, counts, facets, cones = part_meshes(
        points, triangles, np.array([len(points)]), np.array([len(triangles)]), np.array([one_sided])
    )
    assert counts.tolist() == [len(facets)] == [len(cones)]
    return Parted(points, triangles[order], facets, cones)


def away_in_space(mesh: Parted, lo: np.ndarray, hi: np.ndarray) -> np.ndarray:
    """Which triangles of a mesh in model space, in grid units, a cell sees from behind."""
    return mesh.away(lo, hi, 1.0, None, 1.0)


def points_of(rng: np.random.Generator, lo: np.ndarray, hi: np.ndarray) -> np.ndarray:
    corners = np.array([np.where(which, hi, lo) for which in product((False, True), repeat=3)])
    return np.concatenate([corners, lo + rng.random((POINTS, 3)) * (hi - lo)])


def ahead(point: np.ndarray, corners: np.ndarray) -> Fraction:
    """How far a point lies before a triangle's plane, times twice its area, without rounding."""
    a, b, c, p = ([Fraction(float(value)) for value in row] for row in (*corners, point))
    u, v, w = ([y - x for x, y in zip(a, other, strict=True)] for other in (b, c, p))
    return (u[1] * v[2] - u[2] * v[1]) * w[0] + (u[2] * v[0] - u[0] * v[2]) * w[1] + (u[0] * v[1] - u[1] * v[0]) * w[2]


def fronts(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Which of triangles (m, 3, 3) some of the points (n, 3) see the front of, exactly: double precision where it is
    certain, fractions where it is not."""
    a, b, c = (corners[:, k].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    offset = points[:, None] - a
    value = (offset * normal).sum(axis=2)
    doubt = np.abs(value) <= 1e-12 * (np.abs(offset).max(axis=2) + np.abs(corners).max(initial=0)) * np.abs(normal).sum(
        axis=1
    )
    doubt &= (normal != 0).any(axis=1)
    seen = (value > 0) & ~doubt
    for p, t in np.argwhere(doubt).tolist():
        seen[p, t] = ahead(points[p], corners[t]) > 0
    return np.asarray(seen.any(axis=0))


@given(st.lists(st.tuples(st.integers(0, 2**32 - 1), st.booleans()), max_size=4))
def test_facets_hold_all_triangles_of_each_mesh_once(given: list[tuple[int, bool]]) -> None:
    meshes = [ball(np.random.default_rng(seed), 1000.0) for seed, _ in given]
    points = np.concatenate([np.zeros((0, 3), np.int32), *(points for points, _ in meshes)])
    triangles = np.concatenate([np.zeros((0, 3), np.uint32), *(triangles for _, triangles in meshes)])
    sizes = np.array([(len(points), len(triangles)) for points, triangles in meshes], np.int64).reshape(-1, 2)
    one_sided = np.array([sided for _, sided in given], np.bool_)
    order, counts, facets, cones = part_meshes(
        points, triangles, np.ascontiguousarray(sizes[:, 0]), np.ascontiguousarray(sizes[:, 1]), one_sided
    )
    assert len(facets) == len(cones) == counts.sum()
    assert (counts[~one_sided] == 1).all()
    triangle = facet = 0
    for number, (own_points, own) in enumerate(meshes):
        last, end = triangle + len(own), facet + counts[number]
        assert np.array_equal(np.sort(order[triangle:last]), np.arange(triangle, last))
        assert facets[facet:end].sum() == len(own)
        alone = parted(own_points, own, bool(one_sided[number]))
        assert np.array_equal(alone.triangles, own[order[triangle:last] - triangle])
        assert np.array_equal(alone.cones, cones[facet:end])
        triangle, facet = last, end


@given(st.integers(0, 2**32 - 1), st.sampled_from([5.0, 1e3, 3e6]), st.sampled_from([0.0, 1e-9, 0.05, 1.0]))
@example(0, 1e3, 0.0)
def test_no_front_of_a_turned_facet_is_seen_from_the_cell(seed: int, size: float, nearness: float) -> None:
    """Random closed surfaces and cells, near ones whose corners lie right on the border of what a cone says."""
    rng = np.random.default_rng(seed)
    points, triangles = ball(rng, size)
    points += rng.integers(-4_000_000, 4_000_000, 3).astype(np.int32)
    mesh = parted(points, triangles)
    cone = mesh.cones[rng.integers(0, len(mesh.cones))]
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if nearness < 1 and cone[6] <= 1:  # a cell right inside the border of a cone: nothing to spare
        axis, sine = cone[3:6], float(cone[6])
        across = direction - axis * (direction @ axis)
        across /= np.linalg.norm(across)
        direction = -(sine + nearness) * axis + np.sqrt(max(0.0, 1 - (sine + nearness) ** 2)) * across
        direction /= np.linalg.norm(direction)
    start = cone[:3] if cone[6] <= 1 else points.mean(axis=0)
    centre = start + direction * size * 10.0 ** rng.uniform(-3, 2)
    half = rng.uniform(0, 1, 3) * size * 10.0 ** rng.uniform(-6, 1)
    lo, hi = centre - half, centre + half
    away = away_in_space(mesh, lo, hi)
    corners = mesh.positions[mesh.triangles[away]].astype(np.float64)
    assert not fronts(points_of(rng, lo, hi), corners).any()


def test_cells_at_the_border_of_a_cone_are_told_apart() -> None:
    """The test above has teeth: it meets cells on both sides of the border, and a test without margin would fail."""
    points = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0]], np.int32)
    mesh = parted(points, np.array([[0, 1, 2]], np.uint32))
    below, at, above = (np.array([1.0, 1.0, z]) for z in (-0.1, 0.0, 0.1))
    assert away_in_space(mesh, below, below).all()
    assert not away_in_space(mesh, at, at).any()
    assert not away_in_space(mesh, above, above).any()
    assert not away_in_space(mesh, below, above).any()


def test_a_box_shows_a_far_cell_at_most_three_of_its_sides() -> None:
    part = box_part("box", (-1, -1, -1), (1, 1, 1), segments=(8,))
    positions, triangles = part.levels[0]
    mesh = parted(np.rint(positions * 1000).astype(np.int32), triangles)
    assert mesh.facets.tolist() == [128] * 6
    for cell, sides in (((5, 0, 0), 1), ((5, 5, 0), 2), ((5, 5, 5), 3), ((0, 0, 0), 0)):
        lo = 1000.0 * np.array(cell) - 100
        assert (~away_in_space(mesh, lo, lo + 200)).sum() == 128 * sides


def test_triangles_without_area_are_in_nobodys_way() -> None:
    part = box_part("box", (-1, -1, -1), (1, 1, 1), segments=(8,))
    positions, triangles = part.levels[0]
    flat = np.repeat(triangles[:4, :1], 3, axis=1)
    points = np.rint(positions * 1000).astype(np.int32)
    mesh = parted(points, np.concatenate([triangles, flat]))
    away = away_in_space(mesh, np.array([5000.0, 0, 0]), np.array([5001.0, 1, 1]))
    assert away.sum() >= 5 * 128


@given(st.integers(0, 2**32 - 1))
def test_placed_facets_show_no_front_as_stored_or_as_drawn(seed: int) -> None:
    """Instances: positions snapped to the grid, and in single precision as the player draws them."""
    rng = np.random.default_rng(seed)
    points, triangles = ball(rng, 10.0 ** rng.uniform(1, 6))
    mesh = parted(points, triangles)
    step, scale = 2.0**-10, 2.0 ** -int(rng.integers(10, 13))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    stretch = rng.choice([1.0, 0.3]) * rng.uniform(0.2, 1, 3) ** rng.integers(0, 3)
    matrix = np.concatenate([turn * stretch, 100 * rng.normal(size=(3, 1))], axis=1)
    placed = transform_points(matrix, mesh.positions * scale)
    reach = float(np.abs(placed - matrix[:, 3]).max())
    direction = rng.normal(size=3)
    centre = matrix[:, 3] + direction / np.linalg.norm(direction) * reach * rng.uniform(0.2, 4)
    half = rng.uniform(0, 0.3, 3) * reach
    lo, hi = centre - half, centre + half
    chosen = mesh.triangles[mesh.away(lo, hi, scale, matrix, step)]
    if np.linalg.det(matrix[:, :3]) < 0:
        chosen = chosen[:, [0, 2, 1]]
    eyes = points_of(rng, lo, hi)
    snapped = np.rint(placed / step) * step
    assert not fronts(eyes, snapped[chosen]).any()
    whole = np.rint(matrix[:, 3] / step)
    local = (mesh.positions * (scale / step)).astype(np.float32)
    drawn = local @ matrix[:, :3].astype(np.float32).T + (matrix[:, 3] / step - whole).astype(np.float32)
    assert not fronts((eyes / step - whole), drawn[chosen].astype(np.float64)).any()


def test_flattened_placements_are_always_drawn() -> None:
    part = box_part("box", (-1, -1, -1), (1, 1, 1), segments=(4,))
    mesh = parted(np.rint(part.levels[0][0] * 1000).astype(np.int32), part.levels[0][1])
    matrix = np.zeros((3, 4))
    matrix[0, 0] = matrix[1, 1] = 1
    far = np.array([0.0, 0.0, 1e6])
    assert not mesh.away(far, far + 1, 1.0, matrix, 1.0).any()
    matrix[2, 2] = 1
    assert mesh.away(far, far + 1, 1.0, matrix, 1.0).any()


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return make_store(tmp_path_factory.mktemp("facets") / "store", room_parts(), depth=2)


def test_stores_say_which_triangles_turn_their_backs(room: Store) -> None:
    """Whole chain on a small store, mirrored instances included."""
    rng = np.random.default_rng(5)
    dropped = 0
    for cell in range(0, len(room.cells), 5):
        row, ids = room.cells[cell], room.vlod(cell)
        found = room.facets(ids).turned_away(ids, row["lo"], row["hi"])
        surfaces = room.surfaces(ids)
        assert np.array_equal(np.add.reduceat(found.triangles, found.starts), surfaces.triangle_counts)
        away = np.concatenate([room.turned_away(drawable, row["lo"], row["hi"]) for drawable in ids.tolist()])
        chosen = surfaces.triangles[away]
        corners = surfaces.points[chosen] * room.grid.step
        assert not fronts(points_of(rng, row["lo"], row["hi"]), corners).any()
        assert found.triangle_counts.sum() == len(chosen) == row["turned_triangles"]
        dropped += len(chosen)
    assert dropped > 0.3 * room.cells["triangles"][::5].sum()


def test_what_is_seen_from_both_sides_is_never_left_out(tmp_path: Path) -> None:
    part = box_part("box", (0, 0, 0), (1, 1, 1))
    both = make_store(tmp_path / "both", [type(part)("box", part.levels, part.errors)], depth=1)
    assert not both.cells["turned_triangles"].any()
    assert not both.one_sided.any()
