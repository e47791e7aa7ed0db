"""The paper's shrunk occluders: their polygons, their projection points, and what they hide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from jobs.visibility.engine import Engine
from jobs.visibility.settings import EngineSettings
from jobs.visibility.shrunk.planar_polygons import convex_polygons
from jobs.visibility.shrunk.projection_point import greatest_height, projection_point
from jobs.visibility.shrunk.shrunk_depths import find_occluders
from jobs.visibility.surfaces.soup import Soup
from tests.jobs.visibility.nasty import misses, nasty_scene
from tests.jobs.visibility.scenes import Mesh, box, rooms, sheet, soup_of

SHRUNK = EngineSettings(method="shrunk-occluders", resolution=64, proof_resolution=32)


def polygons_of(mesh: Mesh) -> list[list[int]]:
    soup = soup_of([mesh])
    corners, counts, _ = convex_polygons(soup.vertices, soup.triangles, soup.triangle_drawable)
    return [row[:n].tolist() for row, n in zip(corners, counts, strict=True)]


def visible(soup: Soup, half: float) -> list[int]:
    found = Engine(soup, SHRUNK).visible_from(np.full(3, -half), np.full(3, half), soup.drawables)
    assert found is not None
    return found.visible.tolist()


@pytest.mark.parametrize("cells", [1, 2, 5, 40])
def test_a_flat_sheet_becomes_one_polygon(cells: int) -> None:
    assert [len(polygon) for polygon in polygons_of(sheet((0, 0, 7), (400, 800, 7), cells))] == [4]


def test_a_box_becomes_its_six_sides() -> None:
    assert [len(polygon) for polygon in polygons_of(box((0, 0, 0), (30, 20, 10)))] == [4] * 6


def test_polygons_cover_what_the_triangles_do_and_are_convex() -> None:
    rng = np.random.default_rng(4)
    points, triangles = sheet((0, 0, 0), (900, 900, 0), 9)
    points = (points @ np.array([[1, 0, 1], [0, 1, 2], [0, 0, 1]])).astype(np.int32)  # a slope that the grid can hold
    soup = soup_of([(points, triangles[rng.random(len(triangles)) < 0.8])])
    corners, counts, first = convex_polygons(soup.vertices, soup.triangles, soup.triangle_drawable)
    assert len(first) < 0.6 * len(soup.triangles)

    def area(loop: np.ndarray) -> np.ndarray:
        return sum(np.cross(a, b) for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True))

    whole = sum(area(soup.vertices[t].astype(float)) for t in soup.triangles)
    loops = [soup.vertices[row[:n]].astype(float) for row, n in zip(corners, counts, strict=True)]
    np.testing.assert_array_equal(sum(area(loop) for loop in loops), whole)
    for loop in loops:
        ahead = np.roll(loop, -1, axis=0) - loop
        assert (np.cross(ahead, np.roll(ahead, -1, axis=0)) @ whole > 0).all()


def occluders(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rectangles before the cell, larger than it, most of them slanted."""
    q = np.zeros((4 * count, 3))
    for k in range(count):
        q[4 * k : 4 * k + 4, 0] = rng.uniform(4, 9)
        u, v = rng.uniform(-3, 3, 2)
        size = rng.uniform(1.2, 5, 2)
        q[4 * k : 4 * k + 4, 1] = u + size[0] * np.array([-1, 1, 1, -1])
        q[4 * k : 4 * k + 4, 2] = v + size[1] * np.array([-1, -1, 1, 1])
        q[4 * k : 4 * k + 4, 0] += (q[4 * k : 4 * k + 4, 1:] - (u, v)) @ rng.uniform(-0.2, 0.2, 2)
    corners = np.arange(4 * count, dtype=np.int32).reshape(-1, 4)
    return q, *find_occluders(q, corners, np.full(count, 4, np.int32), np.arange(count))[1:]


@pytest.mark.parametrize("seed", range(5))
def test_the_greatest_height_is_the_linear_programmes(seed: int) -> None:
    _, faces, heights, sides = occluders(np.random.default_rng(seed), 20)
    assert len(faces) > 5
    for face, height, planes in zip(faces, heights, sides, strict=True):
        expected = linprog(-face[:3], planes[:, :3], planes[:, 3], bounds=(None, None))
        assert height == pytest.approx(-expected.fun, rel=1e-6)
    # one side less holds the height of no rectangle
    assert greatest_height(sides[0], 2, *faces[0, :3]) == np.inf


@pytest.mark.parametrize("seed", range(5))
def test_the_projection_point_is_inside_all_frusta_and_the_best_there(seed: int) -> None:
    _, faces, heights, sides = occluders(np.random.default_rng(seed), 12)
    v = projection_point(faces, heights, sides, np.arange(len(faces)))
    planes = sides.reshape(-1, 4)
    assert (planes[:, :3] @ v < planes[:, 3]).all()
    assert (faces[:, :3] @ v > faces[:, 3]).all()

    def loss(x: np.ndarray) -> float:
        return float(((faces[:, :3] @ x - heights) ** 2).sum())

    best = minimize(
        loss,
        np.zeros(3),
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda x: planes[:, 3] - planes[:, :3] @ x},
        options={"maxiter": 500},
    )
    assert best.success
    assert loss(v) - best.fun < 1e-2 * (loss(np.zeros(3)) - best.fun) + 1e-6


@pytest.mark.parametrize("cells", [1, 7, 40])
def test_a_wall_hides_what_is_behind_it(cells: int) -> None:
    soup = soup_of([sheet((1000, -4000, -4000), (1000, 4000, 4000), cells), box((2000, -90, -90), (2100, 90, 90))])
    assert visible(soup, 50) == [0]


def test_occluders_smaller_than_the_cell_hide_nothing() -> None:
    soup = soup_of([sheet((1000, -40, -40), (1000, 40, 40), 2), box((1010, -2, -2), (1012, 2, 2))])
    assert visible(soup, 50) == [0, 1]
    assert visible(soup, 5) == [0]


def test_both_methods_hide_other_rooms_and_shrinking_hides_less() -> None:
    soup = soup_of(rooms(np.random.default_rng(1), 5))
    lo, hi = np.array([9800.0, 9800, 1400]), np.array([10000.0, 10000, 1600])
    shrunk = Engine(soup, SHRUNK).visible_from(lo, hi, soup.drawables)
    flooded = Engine(soup, replace(SHRUNK, method="flooded-occluders")).visible_from(lo, hi, soup.drawables)
    assert shrunk is not None
    assert flooded is not None
    assert len(flooded.visible) < len(shrunk.visible) < 0.6 * len(soup.drawables)


def attack(first: int, scenes: int, rays: int) -> None:
    for number in range(first, first + scenes):
        scene = nasty_scene(np.random.default_rng([78, number]))
        scene = scene._replace(settings=replace(scene.settings, method="shrunk-occluders"))
        assert misses(scene, rays, number) == [], f"scene {number}"


def test_no_drawable_is_ever_missed() -> None:
    attack(0, 60, 600)


@pytest.mark.slow
def test_no_drawable_is_missed_in_many_scenes() -> None:
    attack(60, 250, 2000)
