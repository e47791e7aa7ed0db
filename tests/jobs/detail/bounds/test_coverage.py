"""No thing gets thinner than half of its width in a level that may be shown where this is wide."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jobs.detail.bounds.coverage import PART, lost_width, shown_error
from jobs.detail.levels import Mesh, things_of
from jobs.objects.weld import twins
from tests.jobs.detail.shapes import Shape, box, leaves_of, level_mesh, model_of

STATIONS = (0.1, 0.3, 0.5, 0.7, 0.9)
DIRECTIONS = 16


def pipe(sides: int, radius: float, length: float) -> Shape:
    """A closed pipe along z, from 0."""
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(sides)], axis=1)
    a = np.arange(sides)
    b = (a + 1) % sides
    wall = np.concatenate([np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1)])
    fan = np.stack([np.zeros(sides - 2, int), a[1:-1], a[2:]], axis=1)
    return np.concatenate([ring, ring + np.array([0, 0, length])]), np.concatenate([wall, fan[:, ::-1], fan + sides])


def turned(shape: Shape, seed: int) -> Shape:
    """The shape in another direction."""
    return shape[0] @ np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0], shape[1]


def on_grid(shape: Shape) -> Mesh:
    triangles = shape[1].astype(np.int32)
    return Mesh(np.rint(shape[0] * 1e5).astype(np.int32), triangles, twins(triangles))


def lost(before: Shape, after: Shape) -> float:
    """What is lost where all of `after` comes from the first triangle of `before`, in units."""
    mesh, left = on_grid(before), on_grid(after)
    return lost_width(things_of(mesh), left.points, left.triangles, np.zeros(len(left.triangles), np.int32)) / 1e5


def reaches(points: np.ndarray, triangles: np.ndarray, height: float) -> np.ndarray:
    """How far a section at a height along z reaches in each of the directions across: (DIRECTIONS,)."""
    corners = points[triangles]
    cut = []
    for edge in range(3):
        a, b = corners[:, edge], corners[:, (edge + 1) % 3]
        over = (a[:, 2] - height) * (b[:, 2] - height) < 0
        a, b = a[over], b[over]
        cut.append(a + (b - a) * ((a[:, 2] - height) / (a[:, 2] - b[:, 2]))[:, None])
    angle = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    ways = np.stack([np.cos(angle), np.sin(angle), 0 * angle])
    return np.asarray((np.concatenate(cut) @ ways).max(axis=0))


@pytest.mark.parametrize("seed", range(6))
def test_a_flattened_pipe_is_lost_by_its_diameter(seed: int) -> None:
    radius, length = 0.02, 2.0
    whole = pipe(12, radius, length)
    rungs = [[[-radius, 0, z], [radius, 0, z]] for z in (0.0, 1.0, length)]
    halves = np.array([[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]])
    strip = np.array(rungs).reshape(-1, 3), np.concatenate([halves, halves[:, ::-1]])
    found = lost(turned(whole, seed), turned(strip, seed))
    assert found == pytest.approx(2 * radius, rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_what_keeps_its_section_is_not_lost(seed: int) -> None:
    for sides in (3, 4, 6):
        found = lost(turned(pipe(12, 0.02, 2.0), seed), turned(pipe(sides, 0.02, 2.0), seed))
        assert found <= 0.001  # seen from its end, what is left of a round pipe with three sides is less than half


def test_a_plate_that_becomes_a_sheet_is_lost_by_its_thickness() -> None:
    plate = box((0, 0, 0), (1, 1, 0.01))
    sheet = box((0, 0, 0), (1, 1, 1e-9))
    assert 0.3 * 0.01 < lost(turned(plate, 1), turned(sheet, 1)) < 0.02


def test_what_ends_in_an_edge_is_lost() -> None:
    ends = np.array([[-0.02, 0, 0], [0.02, 0, 0], [0, -0.02, 2], [0, 0.02, 2]])
    wedge = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    assert lost(pipe(12, 0.02, 2.0), (ends, wedge)) == pytest.approx(0.04, rel=0.1)


def test_a_level_may_be_shown_where_its_loss_is_small() -> None:
    assert shown_error(1.0, 0.0) == shown_error(1.0, PART) == 1.0
    assert shown_error(1.0, 1.5) == 1.5 / PART
    assert shown_error(1.0, 100.0) == 2.0 / PART  # what is wider than that cannot be lost


@pytest.mark.parametrize("sides", [6, 8, 10, 12, 16, 24])
@pytest.mark.parametrize("radius", [0.005, 0.05])
def test_levels_of_pipes_keep_their_width_or_say_so(tmp_path: Path, sides: int, radius: float) -> None:
    """Seen from anywhere, at every height: at least six tenths of the radius, or the level says what it lost."""
    length = 3.0
    (leaf,) = leaves_of(model_of(tmp_path, pipe(sides, radius, length)))
    assert len(leaf.levels) >= 2
    for number, level in enumerate(leaf.levels):
        points, triangles = level_mesh(leaf, number)
        least = min(float(reaches(points, triangles, part * length).min()) for part in STATIONS)
        assert least >= 0.6 * radius or level.error >= 0.9 * 2 * radius
