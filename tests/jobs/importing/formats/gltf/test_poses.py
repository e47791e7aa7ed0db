"""Where nodes stand: glTF 2.0, 3.5.2 (transforms), 3.7.2.2 (morph targets), 3.7.3 (skins), 3.11 (animations)."""

from __future__ import annotations

import numpy as np
import pytest

from storage.base.errors import ModelError
from tests.jobs.importing.shapes import Glb, box, corners_of, imported, total

EYE = np.eye(4, dtype="<f4")


def skin(glb, joints, inverse=None):
    entry = {"joints": joints}
    if inverse is not None:
        columns = np.asarray(inverse, "<f4").swapaxes(1, 2).reshape(-1, 16)
        entry["inverseBindMatrices"] = glb.accessor(columns, type="MAT4")
    glb.header.setdefault("skins", []).append(entry)
    return len(glb.header["skins"]) - 1


def weighted(glb, positions, triangles, joints, weights, **more):
    return glb.primitive(
        positions, triangles, JOINTS_0=np.asarray(joints, "u1"), WEIGHTS_0=np.asarray(weights, "<f4"), **more
    )


def follow(n, joint=0):
    weights = np.zeros((n, 4), "<f4")
    weights[:, 0] = 1
    joints = np.zeros((n, 4), "u1")
    joints[:, 0] = joint
    return joints, weights


def span(model):
    corners = corners_of(model).reshape(-1, 3)
    return corners.min(axis=0).round(6).tolist(), corners.max(axis=0).round(6).tolist()


def test_a_skinned_node_s_own_transform_is_ignored(tmp_path):
    """3.7.3.1: only the joint transforms are applied to a skinned mesh."""
    glb = Glb()
    joint = glb.node(translation=[3, 0, 0])
    mesh = glb.mesh(weighted(glb, *box(), *follow(8)))
    child = glb.node(root=False, mesh=mesh, skin=skin(glb, [joint], [EYE]), translation=[0, 5, 0], scale=[0.01] * 3)
    glb.node(children=[child], translation=[-10, 0, 0])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert span(model) == ([3, 0, 0], [4, 1, 1])
    assert model.report == {}


def test_inverse_bind_matrices_and_parents_of_joints_count(tmp_path):
    glb = Glb()
    joint = glb.node(root=False, translation=[0, 2, 0])
    glb.node(children=[joint], translation=[10, 0, 0], scale=[2, 2, 2])
    bind = EYE.copy()
    bind[:3, 3] = [0, -1, 0]
    glb.node(mesh=glb.mesh(weighted(glb, *box(), *follow(8))), skin=skin(glb, [joint], [bind]))
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")) == ([10, 2, 0], [12, 4, 2])


def test_without_inverse_bind_matrices_they_are_identities(tmp_path):
    glb = Glb()
    joint = glb.node(translation=[0, 0, 7])
    glb.node(mesh=glb.mesh(weighted(glb, *box(), *follow(8))), skin=skin(glb, [joint]))
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")) == ([0, 0, 7], [1, 1, 8])


def test_weights_mix_joints_and_need_not_add_up_to_one(tmp_path):
    positions, triangles = box()
    joints, weights = np.zeros((8, 4), "u1"), np.zeros((8, 4), "<f4")
    joints[:, 1] = 1
    weights[:, 0] = 2
    weights[4:, 1] = 2  # the top follows both
    glb = Glb()
    first, second = glb.node(), glb.node(translation=[0, 0, 4])
    glb.node(mesh=glb.mesh(weighted(glb, positions, triangles, joints, weights)), skin=skin(glb, [first, second]))
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")) == ([0, 0, 0], [1, 1, 3])


def test_a_second_set_of_joints_counts_as_the_first(tmp_path):
    positions, triangles = box()
    glb = Glb()
    first, second = glb.node(), glb.node(translation=[0, 0, 4])
    joints, weights = follow(8)
    more = {"JOINTS_1": follow(8, 1)[0], "WEIGHTS_1": weights}
    glb.node(
        mesh=glb.mesh(weighted(glb, positions, triangles, joints, weights, **more)), skin=skin(glb, [first, second])
    )
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")) == ([0, 0, 2], [1, 1, 3])


def test_two_skins_make_two_meshes_of_one(tmp_path):
    glb = Glb()
    mesh = glb.mesh(weighted(glb, *box(), *follow(8)), name="figure")
    for x in (0.0, 5.0):
        joint = glb.node(translation=[x, 0, 0])
        glb.node(mesh=mesh, skin=skin(glb, [joint]))
    glb.node(mesh=mesh, translation=[0, 9, 0])  # without a skin it stays where its node is
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert (len(model.meshes), len(model.parts)) == (3, 3)
    assert span(model) == ([0, 0, 0], [6, 10, 1])


def test_normals_turn_with_their_joints_and_mirrored_faces_are_turned_over(tmp_path):
    """A joint that scales unevenly bends normals by its inverse transpose; one that mirrors turns faces over."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 1]], np.float64)
    normal = np.tile(np.array([[0, -1, 1]], "<f4") / np.sqrt(2).astype("<f4"), (3, 1))
    glb = Glb()
    joint = glb.node(scale=[-1, 1, 3])
    primitive = weighted(glb, positions, [[0, 1, 2]], *follow(3), NORMAL=normal)
    glb.node(mesh=glb.mesh(primitive), skin=skin(glb, [joint]))
    found = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out").mesh(0)
    a, b, c = found.positions[found.triangles[0]]
    outward = np.cross(b - a, c - a)
    assert np.allclose(found.normals[found.triangles[0]], outward / np.linalg.norm(outward), atol=1e-6)
    assert np.allclose(found.normals[0] * np.sqrt(10), [0, -3, 1], atol=1e-6)


def test_joints_that_do_not_exist_cost_the_faces_that_follow_them(tmp_path):
    joints, weights = follow(8)
    joints[7, 0] = 9
    joints[0, 1] = 200  # without any weight it does not matter
    glb = Glb()
    joint = glb.node()
    glb.node(mesh=glb.mesh(weighted(glb, *box(), joints, weights)), skin=skin(glb, [joint]), name="figure")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    lost = total(model, "faces with a position that is not finite")
    assert lost == (box()[1] == 7).any(axis=1).sum()
    assert model.triangle_count == 12 - lost


def door(glb, **more):
    positions, triangles = box()
    shift = np.tile(np.array([[2, 0, 0]], "<f4"), (8, 1))
    lift = np.tile(np.array([[0, 4, 0]], "<f4"), (8, 1))
    targets = [{"POSITION": glb.accessor(shift)}, {"POSITION": glb.accessor(lift)}]
    return glb.mesh(glb.primitive(positions, triangles, targets=targets), **more)


@pytest.mark.parametrize(
    ("mesh", "node", "low"),
    [
        ({}, {}, [0, 0, 0]),  # 3.7.2.2: without weights they are zeros
        ({"weights": [1, 0]}, {}, [2, 0, 0]),
        ({"weights": [1, 0.5]}, {}, [2, 2, 0]),
        ({"weights": [1, 0]}, {"weights": [0, 1]}, [0, 4, 0]),  # a node's weights go before its mesh's
        ({"weights": [1, 0]}, {"weights": [0, 0]}, [0, 0, 0]),
        ({"weights": [-1.5, 0]}, {}, [-3, 0, 0]),
    ],
)
def test_default_morph_weights(tmp_path, mesh, node, low):
    glb = Glb()
    glb.node(mesh=door(glb, **mesh), **node)
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert span(model) == (low, [value + 1 for value in low])


def test_differently_morphed_nodes_are_different_meshes_and_equal_ones_are_one(tmp_path):
    glb = Glb()
    mesh = door(glb)
    for weights in ([1, 0], [1, 0], [0, 1]):
        glb.node(mesh=mesh, weights=weights)
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert (len(model.meshes), len(model.parts)) == (2, 3)


def test_normals_and_colours_morph_too(tmp_path):
    positions, triangles = box()
    base = np.tile(np.array([[0, 0, 1]], "<f4"), (8, 1))
    target = {"NORMAL": np.tile(np.array([[1, 0, -1]], "<f4"), (8, 1)), "COLOR_0": np.full((8, 3), -1, "<f4")}
    glb = Glb()
    targets = [{name: glb.accessor(values) for name, values in target.items()}]
    primitive = glb.primitive(positions, triangles, NORMAL=base, COLOR_0=np.ones((8, 3), "<f4"), targets=targets)
    glb.node(mesh=glb.mesh(primitive, weights=[1]))
    found = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out").mesh(0)
    assert np.array_equal(found.normals, np.tile([[1, 0, 0]], (8, 1)))
    assert (found.colours == [0, 0, 0, 255]).all()


def test_morphs_come_before_skins(tmp_path):
    """3.7.3: a vertex is moved by its targets, then turned by its joints."""
    positions, triangles = box()
    glb = Glb()
    half = np.sqrt(0.5)
    joint = glb.node(rotation=[0, 0, half, half])
    joints, weights = follow(8)
    targets = [{"POSITION": glb.accessor(np.tile(np.array([[5, 0, 0]], "<f4"), (8, 1)))}]
    mesh = glb.mesh(weighted(glb, positions, triangles, joints, weights, targets=targets), weights=[1])
    glb.node(mesh=mesh, skin=skin(glb, [joint]))
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")) == ([-1, 5, 0], [0, 6, 1])


def test_a_target_that_does_not_fit_is_counted_and_left_aside(tmp_path):
    positions, triangles = box()
    glb = Glb()
    targets = [{"POSITION": glb.accessor(np.ones((3, 3), "<f4"))}]
    glb.node(mesh=glb.mesh(glb.primitive(positions, triangles, targets=targets), weights=[1]), name="door")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert span(model) == ([0, 0, 0], [1, 1, 1])
    assert model.report == {"broken elements": {"total": 1, "parts": {"door": 1}}}


def animated(glb, node, path, values, interpolation="LINEAR"):
    times = glb.accessor(np.arange(2, dtype="<f4"))
    sampler = {"input": times, "output": glb.accessor(np.asarray(values, "<f4")), "interpolation": interpolation}
    channel = {"sampler": 0, "target": {"node": node, "path": path}}
    glb.header.setdefault("animations", []).append({"samplers": [sampler], "channels": [channel]})


@pytest.mark.parametrize(
    ("node", "low"),
    [
        ({}, [6, 0, 0]),  # no place of its own: the first frame is one
        ({"translation": [1, 0, 0]}, [1, 0, 0]),
        ({"scale": [1, 1, 1]}, [0, 0, 0]),
        ({"matrix": np.eye(4).reshape(-1).tolist()}, [0, 0, 0]),
    ],
)
def test_the_first_frame_counts_where_there_is_no_rest_pose(tmp_path, node, low):
    glb = Glb()
    number = glb.node(mesh=glb.mesh(glb.primitive(*box())), **node)
    animated(glb, number, "translation", [[6, 0, 0], [9, 0, 0]])
    animated(glb, number, "translation", [[77, 0, 0], [9, 0, 0]])  # the first animation counts
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out"))[0] == low


@pytest.mark.parametrize(
    ("values", "interpolation", "low"),
    [
        ([1, 0, 0, 1], "STEP", [2, 0, 0]),
        ([9, 9, 0, 0.5, 9, 9, 9, 9, 1, 1, 9, 9], "CUBICSPLINE", [0, 2, 0]),  # tangent, value, tangent
        ([1], "LINEAR", [0, 0, 0]),  # cut short
    ],
)
def test_first_frames_of_morph_weights(tmp_path, values, interpolation, low):
    glb = Glb()
    number = glb.node(mesh=door(glb))
    animated(glb, number, "weights", values, interpolation)
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out"))[0] == low


def test_weights_at_rest_go_before_an_animation(tmp_path):
    glb = Glb()
    number = glb.node(mesh=door(glb, weights=[0, 0]))
    animated(glb, number, "weights", [1, 0, 0, 1])
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out"))[0] == [0, 0, 0]


@pytest.mark.parametrize(
    "broken",
    [
        {"matrix": [1, 2, 3]},
        {"matrix": "identity"},
        {"matrix": [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},  # projective
        {"matrix": [0.0] * 16},
        {"translation": [1, 2]},
        {"rotation": ["a", 0, 0, 1]},
        {"scale": None},
        {"translation": [float("inf"), 0, 0]},
    ],
)
def test_a_transform_that_cannot_be_read_takes_out_what_it_places(tmp_path, broken):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    glb.node(mesh=mesh, name="good")
    child = glb.node(root=False, mesh=mesh, name="child")
    glb.node(children=[child], name="holder", **broken)
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.names == ("good",)
    assert model.report["parts with a transform that is not finite"]["parts"] == {"child": 1}


def test_a_matrix_times_a_number_is_the_same_placement(tmp_path):
    glb = Glb()
    matrix = np.diag([2.0, 2.0, 2.0, 2.0])
    matrix[3, :3] = [6, 0, 0]
    glb.node(mesh=glb.mesh(glb.primitive(*box())), matrix=matrix.reshape(-1).tolist())
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")) == ([3, 0, 0], [4, 1, 1])


def test_nesting_of_any_depth_is_read(tmp_path):
    """3.5.2: nodes form trees, of whatever depth."""
    glb = Glb()
    number = glb.node(root=False, mesh=glb.mesh(glb.primitive(*box())))
    for _ in range(5000):
        number = glb.node(root=False, children=[number], translation=[0.5, 0, 0])
    glb.header["scenes"][0]["nodes"].append(number)
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert span(model) == ([2500, 0, 0], [2501, 1, 1])
    assert model.report == {}


def test_joints_at_any_depth_and_in_a_cycle(tmp_path):
    glb = Glb()
    number = joint = glb.node(root=False)
    for _ in range(3000):
        number = glb.node(root=False, children=[number], translation=[0, 1, 0])
    glb.header["scenes"][0]["nodes"].append(number)
    mesh = glb.mesh(weighted(glb, *box(), *follow(8)))
    glb.node(mesh=mesh, skin=skin(glb, [joint]), name="figure")
    assert span(imported(glb.write(tmp_path / "a.glb"), tmp_path / "deep")) == ([0, 3000, 0], [1, 3001, 1])
    glb.header["nodes"][joint]["children"] = [number]
    glb.header["scenes"][0]["nodes"] = [len(glb.header["nodes"]) - 1]
    with pytest.raises(ModelError, match="12 faces with a position that is not finite"):
        imported(glb.write(tmp_path / "a.glb"), tmp_path / "cycle")
