"""glTF: everything that is not a plain triangle mesh."""

from __future__ import annotations

import base64
import io
import json

import numpy as np
import pytest
from PIL import Image

from storage.base.errors import ModelError
from tests.jobs.importing.shapes import Glb, box, corners_of, imported, terrain, total


def png(pixels) -> bytes:
    data = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(data, "PNG")
    return data.getvalue()


def test_many_instances_stay_one_mesh(tmp_path):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()), name="brick")
    for i in range(50):
        glb.node(mesh=mesh, translation=[float(i), 0, 0], name=f"brick {i}")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert (len(model.meshes), len(model.parts), model.triangle_count) == (1, 50, 600)
    assert model.names[:2] == ("brick 0", "brick 1")
    assert model.parts["matrix"][:, 0, 3].tolist() == list(range(50))


def test_equal_meshes_that_share_accessors_are_one(tmp_path):
    glb = Glb()
    primitive = glb.primitive(*box())
    for i in range(3):
        glb.node(mesh=glb.mesh(primitive, name=f"copy {i}"), translation=[2.0 * i, 0, 0])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert (len(model.meshes), len(model.parts)) == (1, 3)
    assert model.names == ("copy 0", "copy 1", "copy 2")


def test_primitives_of_a_mesh_are_joined_with_their_colours(tmp_path):
    glb = Glb()
    for colour in ([1, 0, 0, 1], [0, 0, 1, 0.5]):
        glb.header["materials"].append({"pbrMetallicRoughness": {"baseColorFactor": colour}})
    first, second = box(), box(at=(5, 0, 0))
    points = glb.primitive(first[0], mode=0)
    mesh = glb.mesh(glb.primitive(*first, material=0), points, glb.primitive(*second, material=1), name="two boxes")
    glb.node(mesh=mesh)
    glb.node(mesh=mesh, translation=[0, 0, 9])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert (len(model.meshes), len(model.parts), model.names) == (1, 2, ("two boxes",))
    found = model.mesh(0)
    assert found.source_faces.tolist() == list(range(24))
    assert (found.positions[found.triangles[:12]].max(axis=(0, 1)) == 1).all()
    assert np.unique(found.colours[found.triangles[:12]].reshape(-1, 4), axis=0).tolist() == [[255, 0, 0, 255]]
    assert np.unique(found.colours[found.triangles[12:]].reshape(-1, 4), axis=0).tolist() == [[0, 0, 255, 128]]
    assert total(model, "points, lines and other primitives without triangles") == 1


def test_linear_colours_become_srgb(tmp_path):
    glb = Glb()
    glb.header["materials"].append({"pbrMetallicRoughness": {"baseColorFactor": [0.2158605, 0.0, 1.0, 1.0]}})
    positions, triangles = box()
    paint = np.full((8, 3), 65535, "<u2")
    paint[0, 2] = 14147
    glb.node(
        mesh=glb.mesh(glb.primitive(positions, triangles, material=0, COLOR_0=glb.accessor(paint, normalized=True)))
    )
    colours = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out").mesh(0).colours
    assert colours[0].tolist() == [128, 0, 128, 255]
    assert colours[1].tolist() == [128, 0, 255, 255]


@pytest.mark.parametrize("place", ["view", "file", "data"])
def test_textures_become_vertex_colours(tmp_path, place):
    pixels = np.array([[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 128], [255, 255, 255, 255]]])
    glb = Glb()
    if place == "view":
        image = {"bufferView": glb.view(png(pixels)), "mimeType": "image/png"}
    elif place == "file":
        (tmp_path / "a b.png").write_bytes(png(pixels))
        image = {"uri": "a%20b.png"}
    else:
        image = {"uri": "data:image/png;base64," + base64.b64encode(png(pixels)).decode()}
    glb.header |= {"images": [image], "textures": [{"source": 0}]}
    glb.header["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    positions, triangles = terrain(2)
    places = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], "<f4")
    glb.node(mesh=glb.mesh(glb.primitive(positions, triangles, material=0, TEXCOORD_0=places)))
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.report == {}
    found, wanted = model.mesh(0), pixels.reshape(-1, 4)[triangles]
    thin = (wanted[..., 3] < 255).any(axis=1)
    wanted[thin, :, 3] = np.minimum(wanted[thin, :, 3], 254)
    assert found.colours[found.triangles].tolist() == wanted.tolist()


def test_a_normalised_texture_place_and_a_texture_transform_are_understood(tmp_path):
    pixels = np.zeros((1, 4, 4), np.uint8)
    pixels[0, :, 0] = [0, 80, 160, 255]
    pixels[..., 3] = 255
    glb = Glb()
    glb.header |= {"images": [{"bufferView": glb.view(png(pixels))}], "textures": [{"source": 0}]}
    shift = {"KHR_texture_transform": {"offset": [0.25, 0], "scale": [0.5, 1]}}
    glb.header["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": shift}}})
    places = glb.accessor(np.array([[10, 0], [250, 0], [10, 250], [250, 250]], "u1"), normalized=True)
    glb.node(mesh=glb.mesh(glb.primitive(*terrain(2), material=0, TEXCOORD_0=places)))
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.mesh(0).colours[:, 0].tolist() == [80, 160, 80, 160]


@pytest.mark.parametrize(
    "uri", ["missing.png", "../outside.png", "/etc/passwd", "http://127.0.0.1:9/a.png", "broken.png"]
)
def test_missing_textures_are_counted_and_never_fetched_elsewhere(tmp_path, uri, monkeypatch):
    monkeypatch.setattr("socket.socket", None)
    (tmp_path / "outside.png").write_bytes(png(np.zeros((2, 2, 4))))
    folder = tmp_path / "model"
    folder.mkdir()
    (folder / "broken.png").write_bytes(png(np.zeros((9, 9, 4)))[:40])
    glb = Glb()
    glb.header |= {"images": [{"uri": uri}], "textures": [{"source": 0}]}
    surface = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0, 0, 1]}
    glb.header["materials"].append({"pbrMetallicRoughness": surface})
    places = np.zeros((8, 2), "<f4")
    glb.node(mesh=glb.mesh(glb.primitive(*box(), material=0, TEXCOORD_0=places)), name="wall")
    model = imported(glb.write(folder / "a.glb"), tmp_path / "out")
    assert model.report["missing textures"] == {"total": 1, "parts": {"wall": 1}}
    assert (model.colours == [255, 0, 0, 255]).all()


def test_a_texture_that_the_exporters_machine_had_elsewhere_is_found_by_its_name(tmp_path):
    (tmp_path / "tex").mkdir()
    (tmp_path / "tex" / "a.png").write_bytes(png(np.full((2, 2, 4), 255)))
    glb = Glb()
    glb.header |= {"images": [{"uri": "C:\\work\\tex\\a.png"}], "textures": [{"source": 0}]}
    glb.header["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    glb.node(mesh=glb.mesh(glb.primitive(*box(), material=0, TEXCOORD_0=np.zeros((8, 2), "<f4"))))
    assert imported(glb.write(tmp_path / "a.glb"), tmp_path / "out").report == {}


def test_strips_and_fans_become_triangles(tmp_path):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]], np.float64)
    glb = Glb()
    glb.node(mesh=glb.mesh(glb.primitive(positions, [0, 1, 2, 3, 3, 4], mode=5)))
    glb.node(mesh=glb.mesh(glb.primitive(positions[[0, 1, 3, 2]], mode=6)), translation=[5, 0, 0])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    corners = corners_of(model)
    assert len(corners) == 4
    assert model.report == {}
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


def test_sparse_accessors_are_patched(tmp_path):
    positions, triangles = terrain(3)
    glb = Glb()
    primitive = glb.primitive(positions, triangles)
    accessor = glb.header["accessors"][primitive["attributes"]["POSITION"]]
    accessor["sparse"] = {
        "count": 2,
        "indices": {"bufferView": glb.view(np.array([1, 4], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": glb.view(np.array([[9, 9, 9], [7, 7, 7]], "<f4").tobytes())},
    }
    glb.node(mesh=glb.mesh(primitive))
    found = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out").mesh(0)
    expected = positions.copy()
    expected[1], expected[4] = 9, 7
    assert np.array_equal(found.positions[found.triangles], expected[triangles])


def test_quantised_positions_and_strided_views_are_read(tmp_path):
    positions, triangles = box()
    rows = np.zeros((8, 4), "<i2")
    rows[:, :3] = positions * 32767
    glb = Glb()
    view = glb.view(rows.tobytes(), byteStride=8)
    glb.header["accessors"].append(
        {"bufferView": view, "componentType": 5122, "count": 8, "type": "VEC3", "normalized": True}
    )
    primitive = {"attributes": {"POSITION": 0}, "indices": glb.accessor(triangles.reshape(-1).astype("u1"))}
    glb.node(mesh=glb.mesh(primitive), scale=[2, 2, 2])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert np.array_equal(model.hi, [2, 2, 2])
    assert np.array_equal(model.lo, [0, 0, 0])


def test_transforms_multiply_down_the_tree_in_float64(tmp_path):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    leaf = glb.node(root=False, mesh=mesh, translation=[1e7 + 0.125, 0, 0], name="leaf")
    half = np.sqrt(0.5)
    middle = glb.node(root=False, children=[leaf], rotation=[0, 0, half, half])
    glb.node(children=[middle], scale=[1, 1, 0.5])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    corners = corners_of(model).reshape(-1, 3)
    assert np.abs(corners.min(axis=0) - [-1, 1e7 + 0.125, 0]).max() < 1e-8
    assert np.abs(corners.max(axis=0) - [0, 1e7 + 1.125, 0.5]).max() < 1e-8


def test_nodes_that_cannot_be_placed_are_counted(tmp_path):
    glb = Glb()
    mesh = glb.mesh(glb.primitive(*box()))
    glb.node(mesh=mesh, name="good")
    glb.node(mesh=mesh, name="flat", scale=[1, 0, 1])
    glb.node(mesh=mesh, name="skewed flat", matrix=[1, 2, 3, 0, 2, 4, 6, 0, 0, 0, 1, 0, 0, 0, 0, 1])
    glb.node(mesh=mesh, name="lost", translation=[float("nan"), 0, 0])
    glb.node(mesh=mesh, name="far", translation=[1e300, 0, 0])
    glb.node(mesh=mesh, name="mirror", scale=[-1, 1, 1])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.names == ("good", "mirror")
    assert model.report["parts flattened by their transform"]["parts"] == {"flat": 1, "skewed flat": 1}
    assert model.report["parts with a transform that is not finite"]["parts"] == {"far": 1, "lost": 1}


def test_a_node_cycle_ends(tmp_path):
    glb = Glb()
    glb.node(mesh=glb.mesh(glb.primitive(*box())), children=[0], name="a")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert len(model.parts) == 1
    assert total(model, "broken elements") == 1


def test_defects_are_counted_for_every_placement(tmp_path):
    positions, triangles = box()
    positions = np.concatenate([positions, [[np.nan, 0, 0]]])
    faces = np.concatenate([triangles, [[0, 1, 8], [0, 1, 1], [0, 1, 99], triangles[0]]])
    glb = Glb()
    mesh = glb.mesh(glb.primitive(positions, faces))
    glb.node(mesh=mesh, name="a")
    glb.node(mesh=mesh, name="b", translation=[3, 0, 0])
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert model.triangle_count == 24
    for defect in (
        "faces with an index out of range",
        "faces with a position that is not finite",
        "faces without area",
        "duplicate faces",
    ):
        assert model.report[defect] == {"total": 2, "parts": {"a": 1, "b": 1}}


def test_an_index_out_of_range_does_not_reach_into_the_next_primitive(tmp_path):
    positions, triangles = box()
    glb = Glb()
    bad = np.concatenate([triangles, [[0, 1, 8]]])
    glb.node(mesh=glb.mesh(glb.primitive(positions, bad), glb.primitive(positions + 4, triangles)))
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert total(model, "faces with an index out of range") == 1
    assert model.triangle_count == 24


def test_a_gltf_with_buffers_beside_it(tmp_path):
    glb = Glb()
    glb.node(mesh=glb.mesh(glb.primitive(*box())))
    header = {key: value for key, value in glb.header.items() if value != []}
    for name, uri in (
        ("file", "b.bin"),
        ("data", "data:application/octet-stream;base64," + base64.b64encode(glb.data).decode()),
    ):
        (tmp_path / "b.bin").write_bytes(glb.data)
        path = tmp_path / f"{name}.gltf"
        path.write_text(json.dumps({**header, "buffers": [{"byteLength": len(glb.data), "uri": uri}]}))
        assert imported(path, tmp_path / name).triangle_count == 12
    (tmp_path / "b.bin").write_bytes(glb.data[:-9])
    with pytest.raises(ModelError, match=r"'b\.bin' is cut short"):
        imported(tmp_path / "file.gltf", tmp_path / "out")
    (tmp_path / "b.bin").unlink()
    with pytest.raises(ModelError, match=r"'b\.bin' is missing"):
        imported(tmp_path / "file.gltf", tmp_path / "out")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"asset": {"version": "1.0"}}, "only version 2"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "export it without compression"),
        ({"accessors": 5}, "damaged or cut short"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 77}}]}]}, "damaged or cut short"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": -1}}]}]}, "damaged or cut short"),
        ({"scenes": [{"nodes": [99]}]}, "damaged or cut short"),
        ({"scene": 7}, "damaged or cut short"),
        ({"nodes": [{"mesh": 0, "matrix": [1, 2]}]}, "damaged or cut short"),
        ({"meshes": []}, "holds no triangles"),
        ({"scenes": [{"nodes": []}]}, "holds no triangles"),
    ],
)
def test_headers_that_make_no_sense_are_one_clear_line(tmp_path, change, message):
    glb = Glb()
    glb.node(mesh=glb.mesh(glb.primitive(*box())))
    glb.header |= change
    with pytest.raises(ModelError, match=message) as caught:
        imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert str(tmp_path / "a.glb") in str(caught.value)


@pytest.mark.parametrize("count", [2**31, 2**62, 10**30, -1, 1.5])
@pytest.mark.parametrize("view", [True, False])
def test_giant_counts_are_refused_without_taking_memory(tmp_path, count, view):
    glb = Glb()
    glb.node(mesh=glb.mesh(glb.primitive(*box())))
    accessor = glb.header["accessors"][0]
    accessor["count"] = count
    if not view:
        del accessor["bufferView"]
    with pytest.raises(ModelError, match="accessor 0"):
        imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
