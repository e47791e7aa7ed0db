"""Faces without area on the grid: left out where something else is drawn, one step wide elsewhere."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jobs.objects.flat_faces import with_area
from jobs.objects.weld import degenerate_triangles, weld
from tests.jobs.detail.sampling import distances

POINTS = np.array([[0, 0, 0], [10, 0, 0], [5, 0, 0], [0, 7, 0], [3, 0, 0], [2, 2, 2], [9, 9, 9], [4, 4, 4]], np.int32)


def of(triangles: list[list[int]]) -> tuple[list[int], list[int]]:
    drawn = with_area(POINTS, np.array(triangles, np.int32))
    assert not degenerate_triangles(drawn.points, drawn.triangles[drawn.kept].astype(np.int32)).any()
    return drawn.kept.tolist(), drawn.widened.tolist()


def test_all_faces_with_area_stay_as_they_are() -> None:
    triangles = np.array([[0, 1, 3], [3, 5, 6]], np.int32)
    drawn = with_area(POINTS, triangles)
    assert drawn.points is POINTS
    assert drawn.triangles is triangles
    assert drawn.kept.tolist() == [0, 1]


def test_a_face_along_a_side_of_another_is_left_out() -> None:
    assert of([[0, 1, 3], [0, 2, 1]]) == ([0], [])
    assert of([[0, 1, 3], [0, 4, 2], [0, 2, 1]]) == ([0], []), "it lies on a face that lies on a side"
    assert of([[0, 2, 3], [2, 1, 3], [0, 2, 1]]) == ([0, 1], []), "its long side is made up of two"


def test_a_face_that_nothing_covers_is_widened() -> None:
    assert of([[0, 2, 1]]) == ([0], [0])
    assert of([[0, 2, 3], [0, 2, 1]]) == ([0, 1], [1]), "half of it is covered"
    assert of([[0, 2, 1], [1, 0, 4]]) == ([0], [0]), "one of two in the same place"


def test_a_face_that_is_a_point_is_widened_where_nothing_else_is() -> None:
    assert of([[5, 5, 5], [5, 5, 5]]) == ([0], [0])
    assert of([[5, 5, 5], [5, 7, 6]]) == ([1], [1])
    assert of([[5, 5, 5], [0, 3, 5]]) == ([1], [])


def test_new_corners_stay_on_the_grid() -> None:
    limit = 1 << 23
    points = np.array([[limit, limit, limit], [-limit, -limit, -limit]], np.int32)
    for triangle in ([0, 0, 0], [1, 1, 1], [0, 0, 1]):
        drawn = with_area(points, np.array([triangle], np.int32))
        assert np.abs(drawn.points).max() <= limit
        assert not degenerate_triangles(drawn.points, drawn.triangles).any()


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 4))
def test_nothing_is_farther_than_a_step_from_what_is_drawn(seed: int, count: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.integers(-size, size + 1, (3 * count, 3)).astype(np.int32)
    corners[:, rng.random(3) < 0.3] = 0
    ids, first = weld(corners, np.zeros(len(corners), np.int32))
    points, triangles = corners[first], ids.reshape(-1, 3)
    drawn = with_area(points, triangles)
    assert (drawn.points[: len(points)] == points).all()
    shown = drawn.points.astype(np.float64), drawn.triangles[drawn.kept].astype(np.int64)
    assert not degenerate_triangles(drawn.points, drawn.triangles[drawn.kept]).any()
    whole = points[triangles].astype(np.float64)
    weights = rng.dirichlet((0.5, 0.5, 0.5), 20)
    probes = np.concatenate([whole.reshape(-1, 3), np.einsum("wc,tcx->twx", weights, whole).reshape(-1, 3)])
    assert distances(probes, *shown).max() < 1e-9, "what is left out, and what is widened, lies on what is drawn"
    same = np.setdiff1d(drawn.kept, drawn.widened)
    assert (drawn.triangles[same] == triangles[same]).all()
    for row in drawn.widened.tolist():
        wide = drawn.points[drawn.triangles[row]].astype(np.float64)
        assert distances(wide, points.astype(np.float64), triangles[row : row + 1].astype(np.int64)).max() <= 1.0
