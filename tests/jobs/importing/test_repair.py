"""Repair of one mesh, against a brute-force oracle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.importing.reading.defects import Defect
from jobs.importing.reading.source_scene import SourceMesh
from jobs.importing.repair import repair
from tests.jobs.importing.shapes import box, terrain


def test_a_sound_mesh_is_left_alone():
    positions, triangles = terrain()
    mesh, counts = repair(SourceMesh("a", positions, triangles))
    assert counts == {}
    assert np.array_equal(mesh.positions, positions)
    assert np.array_equal(mesh.triangles, triangles)
    assert np.array_equal(mesh.source_faces, np.arange(len(triangles)))
    assert not mesh.normals.any()


def test_each_defect_is_counted_once_under_its_own_name():
    positions, triangles = box()
    positions = np.concatenate([positions, [[np.nan, 0, 0], [0, np.inf, 0], [1e300, 0, 0], [0.5, 0, 0], [0, 0, 0]]])
    bad = [
        ((0, 1, 99), Defect.INDEX),
        ((0, -1, 2), Defect.INDEX),
        ((0, 1, 8), Defect.NOT_FINITE),
        ((9, 1, 2), Defect.NOT_FINITE),
        ((9, 10, 2), Defect.NOT_FINITE),
        ((0, 1, 1), Defect.NO_AREA),
        ((0, 1, 11), Defect.NO_AREA),
        ((0, 12, 3), Defect.NO_AREA),
        (tuple(triangles[0]), Defect.DUPLICATE),
        (tuple(np.roll(triangles[1], 1)), Defect.DUPLICATE),
        (tuple(triangles[2][::-1]), Defect.REVERSED),
    ]
    faces = np.concatenate([triangles, [face for face, _ in bad]])
    mesh, counts = repair(SourceMesh("a", positions, faces))
    for defect in {defect for _, defect in bad}:
        assert counts[defect] == sum(defect == other for _, other in bad)
    assert sum(counts.values()) == len(bad)
    assert np.array_equal(mesh.source_faces, np.arange(12))
    assert np.array_equal(mesh.positions[mesh.triangles], positions[triangles])


def test_duplicates_are_told_by_position_not_by_index():
    positions, triangles = box()
    doubled = SourceMesh(
        "a", np.concatenate([positions, positions]), np.concatenate([triangles, triangles[:, ::-1] + 8])
    )
    mesh, counts = repair(doubled)
    assert counts == {Defect.REVERSED: 12}
    assert len(mesh.positions) == 8


def test_minus_zero_is_zero():
    positions, triangles = terrain(2)
    doubled = np.concatenate([positions + 0.0, np.where(positions == 0, -0.0, positions)])
    _, counts = repair(SourceMesh("a", doubled, np.concatenate([triangles, triangles + 4])))
    assert counts == {Defect.DUPLICATE: 2}


@pytest.mark.parametrize("positions", [np.empty((0, 3)), np.full((3, 3), np.nan)])
def test_nothing_left_is_an_empty_mesh(positions):
    triangles = np.array([[0, 1, 2]]) if len(positions) else np.empty((0, 3), np.int64)
    mesh, counts = repair(SourceMesh("a", positions, triangles))
    assert mesh is None
    assert counts[Defect.EMPTY] == 1


def test_equal_vertices_become_one_and_different_ones_stay():
    positions, triangles = box()
    soup = positions[triangles].reshape(-1, 3)
    colours = np.full((36, 4), 255, np.uint8)
    mesh, _ = repair(SourceMesh("a", soup, np.arange(36).reshape(-1, 3), None, colours))
    assert len(mesh.positions) == 8
    colours[:6, 0] = 7  # the first face of the box differs: its four corners stay apart
    mesh, _ = repair(SourceMesh("a", soup, np.arange(36).reshape(-1, 3), None, colours))
    assert len(mesh.positions) == 12
    assert np.array_equal(mesh.colours[mesh.triangles].reshape(-1, 4), colours)


def test_normals_are_made_unit_and_bad_ones_counted():
    positions, triangles = terrain(2)
    normals = np.array([[0, 0, 9.0], [1e-200, 0, 0], [np.nan, 0, 0], [0, 0, 0]])
    mesh, counts = repair(SourceMesh("a", positions, triangles, normals))
    assert counts == {Defect.NORMAL: 1}
    assert np.array_equal(mesh.normals, np.float32([[0, 0, 1], [1, 0, 0], [0, 0, 0], [0, 0, 0]]))


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e12])
def test_area_is_judged_whatever_the_scale(scale):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1e-9, 0], [0.5, 0, 0]]) * scale
    _, counts = repair(SourceMesh("a", positions, np.array([[0, 1, 2], [0, 1, 3]])))
    assert counts == {Defect.NO_AREA: 1}


@given(st.lists(st.tuples(*[st.integers(-1, 6)] * 3), max_size=40), st.integers(0, 3))
@settings(deadline=None, max_examples=60)
def test_repair_agrees_with_brute_force(faces, nans):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0], [2, 0, 0]], np.float64)
    positions[:nans, 1] = np.where(np.arange(nans) == 2, np.nan, positions[:nans, 1])
    expected: list[int] = []
    kept: dict[frozenset, int] = {}
    for number, face in enumerate(faces):
        if any(not 0 <= i < len(positions) for i in face):
            continue
        corners = [tuple(positions[i]) for i in face]
        if not np.isfinite(corners).all() or len(set(corners)) < 3:
            continue
        a, b, c = np.array(corners)
        if not np.cross(b - a, c - a).any() or frozenset(corners) in kept:
            continue
        kept[frozenset(corners)] = number
        expected.append(number)
    mesh, counts = repair(SourceMesh("a", positions, np.array(faces, np.int64).reshape(-1, 3)))
    assert (mesh.source_faces.tolist() if mesh else []) == expected
    assert sum(n for defect, n in counts.items() if defect != Defect.EMPTY) == len(faces) - len(expected)
    if mesh:
        assert np.array_equal(mesh.positions[mesh.triangles], positions[np.array(faces)[expected]])
