"""The stored error is never below what sampling finds, and not far above it on smooth surfaces."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.detail.bounds.closest import closest, distance2
from jobs.detail.bounds.hausdorff import hausdorff_bound, one_sided_bound
from storage.model.tables import GRID_LIMIT
from tests.jobs.detail.sampling import distances, measured, sample
from tests.jobs.detail.shapes import (
    Shape,
    box,
    grid,
    joined,
    leaves_of,
    level_mesh,
    model_of,
    original,
    sphere,
    surface_of,
    torus,
)

ROUNDING = 1 + 1e-9


def noise(n: int, height: float) -> np.ndarray:
    return np.random.default_rng(5).random((n, n)) * height


def waves(n: int) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    return 0.1 * np.sin(9 * x) * np.cos(7 * y)


def slivers() -> Shape:
    """A fan of needles around a ring of very thin strips."""
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0.05 * np.sin(5 * angle)], axis=1)
    points = np.concatenate([[[0, 0, 0.0]], ring, ring * 1.00002 + [0, 0, 1e-5]])
    a = np.arange(200)
    b = (a + 1) % 200
    fan = np.stack([0 * a, 1 + a, 1 + b], axis=1)
    strip = np.concatenate([np.stack([1 + a, 201 + a, 201 + b], 1), np.stack([1 + a, 201 + b, 1 + b], 1)])
    return points, np.concatenate([fan, strip])


def with_back(sheet: Shape) -> Shape:
    return joined([sheet, (sheet[0], sheet[1][:, ::-1])])


SHAPES: dict[str, Callable[[], Shape]] = {
    "box": box,
    "sphere": lambda: sphere(14),
    "bumpy sphere": lambda: sphere(20, bumps=0.1),
    "torus": torus,
    "open waves": lambda: grid(30, waves(30)),
    "noisy terrain": lambda: grid(30, noise(30, 0.1)),
    "flat sheet": lambda: grid(30, np.zeros((30, 30))),
    "slivers": slivers,
    "boxes that touch": lambda: joined([box((i, 0, 0), (i + 1, 1, 1)) for i in range(4)]),
    "a sheet seen from both sides": lambda: joined(
        [grid(12, waves(12)), (grid(12, waves(12))[0], grid(12, waves(12))[1][:, ::-1])]
    ),
}
SMOOTH = ("sphere", "bumpy sphere", "torus", "open waves")


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("limit", [10_000, 400])
def test_measured_error_is_below_the_stored_one(tmp_path: Path, name: str, limit: int) -> None:
    model = model_of(tmp_path, SHAPES[name]())
    rng = np.random.default_rng(1)
    for piece in leaves_of(model, most=limit):
        errors = [level.error for level in piece.levels]
        assert all(a < b for a, b in pairwise(errors))
        for k, level in enumerate(piece.levels):
            found = measured(original(model, piece), level_mesh(piece, k), 1500, rng)
            assert found <= level.error * ROUNDING
            if name in SMOOTH and k > 0:
                assert level.error <= 2 * found


def test_chains_are_worth_having(tmp_path: Path) -> None:
    """Each level about half of the one before, down to a few triangles, with errors as small as they can be."""
    (piece,) = leaves_of(model_of(tmp_path, sphere(28)))
    counts = [len(level.triangles) for level in piece.levels]
    assert counts[0] == 12 * 28**2
    assert len(counts) >= 9
    assert counts[-1] <= 20
    assert all(b <= 0.75 * a for a, b in pairwise(counts))
    # a sphere of n triangles is off by about 2.4 / n at best; half of that is what snug placement inside and out gives
    assert piece.levels[3].error < 4 * 2.4 / counts[3]


def test_sheets_keep_their_rim(tmp_path: Path) -> None:
    """A flat sheet, one-sided or with a back of its own, shrinks to a few triangles and loses nothing."""
    points, triangles = grid(20, np.zeros((20, 20)))
    for shape in ((points, triangles), with_back((points, triangles))):
        folder = tmp_path / str(len(shape[1]))
        folder.mkdir()
        (piece,) = leaves_of(model_of(folder, shape))
        assert len(piece.levels[-1].triangles) <= len(triangles) / 8
        assert piece.levels[-1].error < 1e-5


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 40), st.sampled_from([1.0, 1e-3, 1e-6]))
def test_bound_holds_between_random_soups(seed: int, m: int, k: int, flatness: float) -> None:
    rng = np.random.default_rng(seed)
    scale = np.array([1.0, 1.0, flatness]) * 1e5
    a = (rng.random((3 * m, 3)) * scale, np.arange(3 * m).reshape(-1, 3).astype(np.int32))
    b = (rng.random((3 * k, 3)) * scale, np.arange(3 * k).reshape(-1, 3).astype(np.int32))
    bound, lower = hausdorff_bound(surface_of(*a), surface_of(*b), 0.0, 1.0, 1.1)
    found = measured((a[0], a[1]), (b[0], b[1]), 300, rng)
    assert found <= bound * ROUNDING + 1e-4
    assert lower <= bound * ROUNDING
    assert bound <= max(1.1 * lower, 1.0) * ROUNDING + 1e-3


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.booleans())
def test_closest_triangle_agrees_with_trying_all(seed: int, m: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(-1000, 1000, (3 * m, 3)).astype(np.float64)
    if flat:  # triangles without area are allowed: all corners on a line
        points[:, 1:] = points[:, :1] * [2, -1]
    triangles = np.arange(3 * m).reshape(-1, 3).astype(np.int32)
    surface = surface_of(points, triangles)
    queries = rng.uniform(-1500, 1500, (20, 3))
    expected = distances(queries, points, triangles)
    room = np.empty(128, np.int32)
    for query, distance in zip(queries, expected, strict=True):
        _, squared = closest(surface.tree, room, *query, 0, 0.0)
        assert np.sqrt(squared) == pytest.approx(distance, rel=1e-7, abs=1e-6)
        # where something near is enough, that is what it is, or else the closest
        found, squared = closest(surface.tree, room, *query, 0, 250_000.0)
        assert squared <= max(250_000.0, (distance * (1 + 1e-7) + 1e-6) ** 2)
        own = distances(query[None], surface.points, surface.triangles[found : found + 1])[0]
        assert np.sqrt(squared) == pytest.approx(own, rel=1e-7, abs=1e-6)


def exact_distance2(point: list[int], corners: list[list[int]]) -> Fraction:
    """The squared distance of a point to a triangle, both in whole numbers."""

    def dot(a: list[Fraction], b: list[Fraction]) -> Fraction:
        return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))

    p, a, b, c = ([Fraction(x) for x in corner] for corner in (point, *corners))
    ab, ac, ap = ([x - y for x, y in zip(corner, a, strict=True)] for corner in (b, c, p))
    aa, bb, cc, d, e = dot(ab, ab), dot(ab, ac), dot(ac, ac), dot(ab, ap), dot(ac, ap)
    area = aa * cc - bb * bb
    if area > 0:
        v, w = (cc * d - bb * e) / area, (aa * e - bb * d) / area
        if v >= 0 and w >= 0 and v + w <= 1:
            away = [z - v * x - w * y for x, y, z in zip(ab, ac, ap, strict=True)]
            return dot(away, away)
    found = []
    for start, end in ((a, b), (b, c), (c, a)):
        along, away = ([x - y for x, y in zip(to, start, strict=True)] for to in (end, p))
        length2 = dot(along, along)
        s = min(max(dot(along, away) / length2, Fraction(0)), Fraction(1)) if length2 else Fraction(0)
        rest = [x - s * y for x, y in zip(away, along, strict=True)]
        found.append(dot(rest, rest))
    return min(found)


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_distances_hold_for_needles_on_the_whole_grid(data: st.DataObject) -> None:
    near, far = st.integers(-3, 3), st.integers(-GRID_LIMIT, GRID_LIMIT)
    a, direction = (data.draw(st.lists(far, min_size=3, max_size=3)) for _ in range(2))
    share = data.draw(st.integers(0, 1000))
    # the third corner lies near the line through the others, or anywhere
    line = [x + share * y // 1000 for x, y in zip(a, direction, strict=True)]
    shift = data.draw(st.lists(near | far, min_size=3, max_size=3))
    corners = [a, [x + y for x, y in zip(a, direction, strict=True)], [x + y for x, y in zip(line, shift, strict=True)]]
    corners = [corners[i] for i in data.draw(st.permutations(range(3)))]
    p = data.draw(st.lists(far, min_size=3, max_size=3))
    points = np.array(corners, np.float64)
    found = distance2(surface_of(points, np.array([[0, 1, 2]])).tree.frames, 0, *map(float, p))
    assert np.sqrt(found) == pytest.approx(float(exact_distance2(p, corners)) ** 0.5, rel=1e-9, abs=1e-5)


def test_bound_in_one_direction_is_not_the_other() -> None:
    small = surface_of(np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0.0]]), np.array([[0, 1, 2]], np.int32))
    large = surface_of(np.array([[0, 0, 0], [90, 0, 0], [0, 90, 0.0]]), np.array([[0, 1, 2]], np.int32))
    assert one_sided_bound(small, large, 1e-3, 1.1) <= 1e-3
    assert 80 <= one_sided_bound(large, small, 1e-3, 1.1) <= 88


def test_a_spike_thinner_than_a_grid_step_is_drawn(tmp_path: Path) -> None:
    sheet = grid(8, np.zeros((8, 8)))
    tip = len(sheet[0])
    points = np.concatenate([sheet[0], [[0.0, 1 / 7, 0.5], [0.0, 1 / 7 + 1e-12, 0.0]]])
    triangles = np.concatenate([sheet[1], [[1, tip + 1, tip]]])
    model = model_of(tmp_path, (points, triangles), box((0, 0, -1), (1, 1, -0.5)))
    sheet_piece = next(p for p in leaves_of(model) if p.mesh == 0)
    assert len(sheet_piece.levels[0].triangles) == len(triangles)
    assert level_mesh(sheet_piece, 0)[0].max(axis=0)[2] == pytest.approx(0.5)
    assert sheet_piece.levels[0].error <= 3 * sheet_piece.scale


def test_sampling_oracle_on_known_distances() -> None:
    points, triangles = box()
    queries = np.array([[0.5, 0.5, 3.0], [2, 2, 2], [0.5, 0.5, 0.25], [-1, 0.5, 0.5], [2, 2, 0.5]])
    assert distances(queries, points, triangles) == pytest.approx([2, 3**0.5, 0.25, 1, 2**0.5])
    assert distances(sample(points, triangles, 200, np.random.default_rng(0)), points, triangles).max() < 1e-12
