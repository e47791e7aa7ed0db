"""Repair of one mesh, against a brute-force oracle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.importing.reading.defects import Defect
from jobs.importing.reading.source_scene import SourceMesh
from jobs.importing.repair import repair
from jobs.importing.two_kinds import two_kinds
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


def test_of_two_colours_in_one_place_the_earlier_face_shows_its_own():
    """Whatever the order of their corners; two sides that are alike are no loss."""
    red, blue = (255, 0, 0, 255), (0, 0, 255, 255)
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)[[0, 1, 2, 1, 0, 2, 1, 3, 2, 2, 3, 1]]
    colours = np.array([red] * 3 + [blue] * 3 + [red, blue, red] + [red, blue, red], np.uint8)
    mesh, counts = repair(SourceMesh("wall", positions, np.arange(12).reshape(4, 3), colours=colours))
    assert counts == {Defect.OTHER_SIDE: 1, Defect.REVERSED: 1}
    assert np.array_equal(mesh.source_faces, [0, 2])
    assert np.array_equal(mesh.colours[mesh.triangles], colours[[[0, 1, 2], [6, 7, 8]]])
    turned = repair(SourceMesh("wall", positions, np.arange(12).reshape(4, 3)[[1, 0]], colours=colours))[0]
    assert (turned.colours == blue).all()


@pytest.mark.parametrize("turned", [False, True], ids=["wound alike", "wound the other way"])
@pytest.mark.parametrize("first", ["pane", "wall"])
def test_of_faces_in_one_place_the_opaque_one_stays(first, turned):
    """In either order; a pane in front of it in the same place would otherwise lay open what the wall hides."""
    positions, triangles = box()
    both = {"pane": (9, 90, 200, 100), "wall": (7, 7, 7, 255)}
    other = next(name for name in both if name != first)
    faces = np.concatenate([triangles, (triangles[:, ::-1] if turned else triangles) + 8])
    colours = np.repeat(np.uint8([both[first], both[other]]), 8, axis=0)
    mesh, counts = repair(SourceMesh("a", np.concatenate([positions, positions]), faces, None, colours))
    assert counts == {Defect.OTHER_SIDE if turned else Defect.DUPLICATE: 12}
    assert (mesh.colours == both["wall"]).all()
    assert np.array_equal(mesh.source_faces, np.arange(12) + (12 if first == "pane" else 0))
    assert np.array_equal(mesh.positions[mesh.triangles], positions[faces[mesh.source_faces] % 8])


def test_of_several_faces_in_one_place_the_first_of_its_kind_stays():
    positions = np.tile(np.eye(3), (5, 1))
    alphas = np.repeat(np.uint8([90, 80, 255, 70, 255]), 3)
    colours = np.stack([np.repeat(np.arange(5, dtype=np.uint8), 3)] * 3 + [alphas], axis=1)
    faces = np.arange(15).reshape(5, 3)
    mesh, counts = repair(SourceMesh("a", positions, faces, None, colours))
    assert counts == {Defect.DUPLICATE: 4}
    assert mesh.source_faces.tolist() == [2]
    mesh, counts = repair(SourceMesh("a", positions, faces[[0, 1, 3]], None, colours))
    assert counts == {Defect.DUPLICATE: 2}
    assert mesh.source_faces.tolist() == [0]


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


def test_opaque_faces_and_others_share_no_vertex():
    """Two squares with a side in common: one corner beside it is thin, so one square can be seen through."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 2], [4, 5, 2]])
    colours = np.full((6, 4), 255, np.uint8)
    colours[4, 3] = 100
    mesh, counts = repair(SourceMesh("a", positions, triangles, colours=colours))
    assert counts == {}
    assert mesh.colours[mesh.triangles, 3].tolist() == [[255] * 3] * 2 + [[254, 100, 254], [100, 254, 254]]
    assert np.array_equal(mesh.positions[mesh.triangles], positions[triangles])
    assert len(mesh.positions) == 8, "the common side is there twice"


def test_a_vertex_that_no_face_uses_parts_nothing():
    positions, triangles = box()
    colours = np.full((len(positions) + 1, 4), 255, np.uint8)
    colours[-1, 3] = 0
    mesh, _ = repair(SourceMesh("a", np.concatenate([positions, [[9, 9, 9]]]), triangles, colours=colours))
    assert np.array_equal(mesh.positions, positions)
    assert np.array_equal(mesh.triangles, triangles)
    assert (mesh.colours == 255).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.05, 0.5, 1.0]))
def test_any_mesh_is_parted_into_both_kinds(seed, share):
    """Each face keeps its place and its colours, but for what must become 254."""
    rng = np.random.default_rng(seed)
    positions, triangles = terrain()
    triangles = triangles[rng.permutation(len(triangles))[: rng.integers(1, 40)]]
    normals = rng.normal(size=positions.shape)
    colours = rng.integers(0, 256, (len(positions), 4), np.uint8)
    colours[rng.random(len(colours)) >= share, 3] = 255
    mesh, _ = repair(SourceMesh("a", positions, triangles, normals, colours))
    before, after = colours[triangles], mesh.colours[mesh.triangles]
    clear = (before[..., 3] < 255).any(axis=1)
    assert np.array_equal(after[~clear], before[~clear])
    assert np.array_equal(after[..., :3], before[..., :3])
    assert np.array_equal(after[clear, :, 3], np.minimum(before[clear, :, 3], 254))
    assert np.array_equal(mesh.positions[mesh.triangles], positions[triangles])
    unit = normals / np.linalg.norm(normals, axis=1)[:, None]
    assert np.allclose(mesh.normals[mesh.triangles], unit[triangles], atol=1e-6)
    rows = np.concatenate([mesh.positions, mesh.normals, mesh.colours], axis=1)
    assert len(np.unique(rows, axis=0)) == len(rows) == len(np.unique(mesh.triangles))
    assert not set(mesh.triangles[clear].ravel().tolist()) & set(mesh.triangles[~clear].ravel().tolist())


def test_what_is_parted_already_stays():
    positions, triangles = box()
    colours = np.zeros((2 * len(positions), 4), np.uint8)
    colours[: len(positions), 3] = 255
    both = np.concatenate([triangles, triangles + len(positions)])
    found = two_kinds(colours, both)
    assert found.doubled.tolist() == []
    assert np.array_equal(found.colours, colours)
    assert np.array_equal(found.triangles, both)
