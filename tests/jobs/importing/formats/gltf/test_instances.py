"""EXT_mesh_gpu_instancing: instances' places times their node's; and KHR_node_visibility."""

from __future__ import annotations

import numpy as np
import pytest

from jobs.importing.import_memory import import_memory
from tests.jobs.importing.shapes import Glb, box, corners_of, imported

INSTANCING = "EXT_mesh_gpu_instancing"


def instanced(glb, mesh, required=True, **columns):
    """A node with instances; columns are arrays or numbers of accessors."""
    attributes = {
        name: values if isinstance(values, int) else glb.accessor(np.asarray(values, "<f4"))
        for name, values in columns.items()
    }
    glb.header["extensionsUsed"] = [INSTANCING]
    if required:
        glb.header["extensionsRequired"] = [INSTANCING]
    return {"mesh": mesh, "extensions": {INSTANCING: {"attributes": attributes}}}


@pytest.mark.parametrize("required", [True, False])
def test_instances_are_placements_of_one_mesh(tmp_path, required):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    shifts, scales = [[-8, 0, 0], [0, 0, -3], [4, 2, 0]], [[1, 1, 1], [-1, 1, 1], [1, 3, 1]]
    glb.node(**instanced(glb, mesh, required, TRANSLATION=shifts, SCALE=scales), name="columns")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert (len(model.meshes), len(model.parts), model.names) == (1, 3, ("columns",))
    corners = corners_of(model).reshape(3, -1, 3)
    assert corners.min(axis=1).tolist() == [[-8, 0, 0], [-1, 0, -3], [4, 2, 0]]
    assert corners.max(axis=1).tolist() == [[-7, 1, 1], [0, 1, -2], [5, 5, 1]]
    assert np.linalg.det(model.parts["matrix"][1][:, :3]) == -1
    assert model.report == {}


def test_instances_stand_under_their_node(tmp_path):
    """The node's world transform, then each instance's translation, rotation and scale."""
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    half = np.sqrt(0.5)
    columns = {"TRANSLATION": [[1, 0, 0]], "ROTATION": [[0, 0, half, half]], "SCALE": [[2, 1, 1]]}
    node = instanced(glb, mesh, **columns)
    child = glb.node(root=False, **node)
    glb.node(children=[child], translation=[0, 0, 100], scale=[10, 10, 10])
    corners = corners_of(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")).reshape(-1, 3)
    assert np.allclose([corners.min(axis=0), corners.max(axis=0)], [[0, 0, 100], [10, 20, 110]], atol=1e-5)


@pytest.mark.parametrize(("dtype", "most"), [("i1", 127), ("<i2", 32767)])
def test_rotations_may_be_normalised_integers(tmp_path, dtype, most):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    turn = glb.accessor(np.array([[0, 0, most, 0]], dtype), normalized=True)
    glb.node(**instanced(glb, mesh, ROTATION=turn))
    corners = corners_of(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")).reshape(-1, 3)
    assert np.allclose([corners.min(axis=0), corners.max(axis=0)], [[-1, -1, 0], [0, 0, 1]], atol=1e-12)


def test_the_factor_of_quantisation_may_lie_in_the_instances(tmp_path):
    """As gltfpack -mi writes it: integer positions, and what makes lengths of them in SCALE and TRANSLATION."""
    positions, triangles = box()
    rows = np.zeros((8, 4), "<u2")
    rows[:, :3] = positions * 16383
    glb = Glb()
    glb.header["accessors"].append(
        {"bufferView": glb.view(rows.tobytes(), byteStride=8), "componentType": 5123, "count": 8, "type": "VEC3"}
    )
    primitive = {"attributes": {"POSITION": 0}, "indices": glb.accessor(triangles.reshape(-1).astype("<u2"))}
    scales = np.full((3, 3), 2 / 16383)
    glb.node(**instanced(glb, glb.mesh(primitive), TRANSLATION=[[0, 0, 0], [5, 0, 0], [10, 0, 0]], SCALE=scales))
    glb.header["extensionsRequired"].append("KHR_mesh_quantization")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    corners = corners_of(model).reshape(3, -1, 3)
    assert np.allclose(np.ptp(corners, axis=1), 2, atol=1e-6)
    assert np.allclose(corners.min(axis=(1, 2)), 0, atol=1e-6)


def test_attributes_of_other_names_count_but_place_nothing(tmp_path):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    glb.node(**instanced(glb, mesh, _ID=[1.0, 2.0]))
    assert len(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out").parts) == 2


@pytest.mark.parametrize(
    "columns",
    [
        {},
        {"TRANSLATION": [[0, 0, 0], [1, 0, 0]], "SCALE": [[1, 1, 1]]},
        {"TRANSLATION": [[0, 0]]},
        {"ROTATION": [[0, 0, 1]]},
    ],
)
def test_instances_that_do_not_fit_together_are_counted(tmp_path, columns):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    glb.node(mesh=mesh, name="good")
    glb.node(**instanced(glb, mesh, **columns), name="bad")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.names == ("good",)
    assert model.report == {"broken elements": {"total": 1, "parts": {"bad": 1}}}


def test_instances_that_cannot_be_placed_are_counted_one_by_one(tmp_path):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    columns = {"TRANSLATION": [[0, 0, 0], [np.nan, 0, 0], [3, 0, 0]], "SCALE": [[1, 1, 1], [1, 1, 1], [1, 0, 1]]}
    glb.node(**instanced(glb, mesh, **columns), name="row")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert len(model.parts) == 1
    assert model.report["parts with a transform that is not finite"]["parts"] == {"row": 1}
    assert model.report["parts flattened by their transform"]["parts"] == {"row": 1}


def test_morphed_instances_share_their_mesh(tmp_path):
    positions, triangles = box()
    glb = Glb()
    targets = [{"POSITION": glb.accessor(np.full((8, 3), 1, "<f4"))}]
    mesh = glb.mesh(glb.primitive(positions, triangles, targets=targets), weights=[1])
    glb.node(**instanced(glb, mesh, TRANSLATION=[[0, 0, 0], [9, 0, 0]]))
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert (len(model.meshes), len(model.parts)) == (1, 2)
    assert corners_of(model).reshape(2, -1, 3).min(axis=1).tolist() == [[1, 1, 1], [10, 1, 1]]


def test_instances_count_in_the_estimate_of_memory(tmp_path):
    estimates = []
    for count in (1, 10_000):
        glb = Glb()
        mesh = glb.mesh(glb.primitive(*box()))
        glb.node(**instanced(glb, mesh, TRANSLATION=np.zeros((count, 3))))
        estimates.append(import_memory([glb.write(tmp_path / "a.glb")]))
    assert estimates[1] - estimates[0] > 5_000_000


def test_hidden_nodes_are_left_out_with_all_below_them(tmp_path):
    """KHR_node_visibility: what is not visible is not drawn, nor are its children."""
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    glb.node(mesh=mesh, name="seen", extensions={"KHR_node_visibility": {"visible": True}})
    child = glb.node(root=False, mesh=mesh, name="child")
    glb.node(mesh=mesh, children=[child], name="hidden", extensions={"KHR_node_visibility": {"visible": False}})
    glb.header["extensionsRequired"] = ["KHR_node_visibility"]
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.names == ("seen",)
    assert model.report == {"parts that the file hides": {"total": 1, "parts": {"hidden": 1}}}


def test_unread_extensions_that_may_change_geometry_are_told_by_part(tmp_path):
    """3.12: what is used but not required may be left aside, but not without a word."""
    glb = Glb()
    primitive = glb.primitive(*box())
    glb.node(mesh=glb.mesh({**primitive, "extensions": {"VENDOR_subdivision": {}}}, name="blob"), name="a")
    harmless = {"MSFT_lod": {"ids": []}, "KHR_lights_punctual": {"light": 0}, "EXT_mesh_features": {}}
    glb.node(mesh=0, name="b", extensions={**harmless, "VENDOR_offset": {}}, translation=[3, 0, 0])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.report == {"unsupported features": {"total": 2, "parts": {"b": 1, "blob": 1}}}


@pytest.mark.parametrize(
    "name",
    ["KHR_materials_unlit", "KHR_texture_basisu", "EXT_texture_webp", "KHR_lights_punctual", "KHR_mesh_quantization"],
)
def test_what_changes_no_geometry_may_be_required(tmp_path, name):
    glb = Glb()
    glb.header["extensionsRequired"] = [name]
    glb.node(mesh=glb.mesh(glb.primitive(*box())))
    assert imported(glb.write(tmp_path / "a.glb"), tmp_path / "out").triangle_count == 12


def test_points_lines_and_unknown_modes_are_counted(tmp_path):
    """3.7.2.1: modes 0 to 3 are points and lines; there are none above 6."""
    glb = Glb()
    positions, triangles = box()
    others = [glb.primitive(positions, triangles, mode=mode) for mode in (0, 1, 2, 3, 7, -1, "TRIANGLES")]
    glb.node(mesh=glb.mesh(glb.primitive(positions, triangles), *others, name="all"), camera=0)
    glb.header["cameras"] = [{"type": "orthographic"}]
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.report == {"points, lines and other primitives without triangles": {"total": 7, "parts": {"all": 7}}}


def test_names_with_half_characters_can_be_kept(tmp_path):
    """JSON may hold one half of a pair of surrogates, which no text file can."""
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    for number, name in enumerate(["wall \ud800", "wall \ud801", "wall \U00010400", "wall"]):
        glb.node(mesh=mesh, name=name, translation=[2.0 * number, 0, 0])
    names = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out").names
    assert names == ("wall \\ud800", "wall \\ud801", "wall \U00010400", "wall")
