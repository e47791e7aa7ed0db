"""KHR_draco_mesh_compression, EXT_meshopt_compression, KHR_meshopt_compression, and the data beside them."""

from __future__ import annotations

import contextlib
import json
import sys

import meshopt
import numpy as np
import pytest

from jobs.importing.formats.gltf import draco, draco_process
from jobs.importing.import_memory import import_memory
from storage.base.errors import ModelError
from tests.jobs.importing.formats.gltf.compressed import DRACO, MESHOPT, compress_view, draco_primitive, placeholder
from tests.jobs.importing.shapes import Glb, box, canonical, corners_of, imported, terrain


def same(model, positions, triangles, within=1e-5):
    found, expected = canonical(corners_of(model).round(4)), canonical(np.asarray(positions)[triangles].round(4))
    return found.shape == expected.shape and np.abs(found - expected).max() <= within


def draco_file(tmp_path, data=False, **attributes):
    glb = Glb()
    positions, triangles = terrain(6)
    glb.node(mesh=glb.mesh(draco_primitive(glb, positions, triangles, data, **attributes)), name="ground")
    if not data:
        glb.header["extensionsRequired"] = [DRACO]
    return glb, tmp_path / "a.glb", positions, triangles


def test_draco_is_decoded(tmp_path):
    glb, path, positions, triangles = draco_file(tmp_path)
    assert same(imported(glb.write(path), tmp_path / "out"), positions, triangles, 1e-4)


def test_draco_attributes_go_by_their_ids(tmp_path):
    n = 36
    normals = np.tile(np.array([[0, 0, 1]], "<f4"), (n, 1))
    colours = np.tile(np.array([[255, 0, 0, 255]], "u1"), (n, 1))
    glb, path, positions, triangles = draco_file(tmp_path, NORMAL=normals, COLOR_0=colours)
    for accessor in glb.header["accessors"]:
        if accessor["componentType"] == 5121:
            accessor["normalized"] = True
    model = imported(glb.write(path), tmp_path / "out")
    assert same(model, positions, triangles, 1e-4)
    assert np.allclose(model.normals, [0, 0, 1], atol=1e-2)
    assert np.unique(model.colours, axis=0).tolist() == [[255, 0, 0, 255]]


def test_draco_meshes_may_be_skinned(tmp_path):
    """Whatever is not in the stream comes from the accessors."""
    glb, path, positions, triangles = draco_file(tmp_path)
    primitive = glb.header["meshes"][0]["primitives"][0]
    count = glb.header["accessors"][primitive["attributes"]["POSITION"]]["count"]
    weights = np.zeros((count, 4), "<f4")
    weights[:, 0] = 1
    primitive["attributes"] |= {
        "JOINTS_0": glb.accessor(np.zeros((count, 4), "u1")),
        "WEIGHTS_0": glb.accessor(weights),
    }
    glb.header["skins"] = [{"joints": [glb.node(translation=[0, 0, 50])]}]
    glb.header["nodes"][0]["skin"] = 0
    assert same(imported(glb.write(path), tmp_path / "out"), positions + np.array([0, 0, 50]), triangles, 1e-4)


def test_data_beside_draco_is_used_without_a_decoder(tmp_path, monkeypatch):
    monkeypatch.setattr(draco, "DracoDecoder", None)
    glb, path, positions, triangles = draco_file(tmp_path, data=True)
    view = glb.header["meshes"][0]["primitives"][0]["extensions"][DRACO]["bufferView"]
    start = glb.header["bufferViews"][view]["byteOffset"]
    glb.data = glb.data[:start] + b"this is not a Draco stream, and nobody looks" + glb.data[start + 44 :]
    assert same(imported(glb.write(path), tmp_path / "out"), positions, triangles, 0)


def test_without_dracopy_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    glb, path, _, _ = draco_file(tmp_path)
    with pytest.raises(ModelError, match=f"{DRACO}.*DracoPy.*vlod\\[jobs\\]"):
        imported(glb.write(path), tmp_path / "out")


def test_damaged_draco_streams_are_one_clear_line(tmp_path):
    glb, path, _, _ = draco_file(tmp_path)
    view = glb.header["meshes"][0]["primitives"][0]["extensions"][DRACO]["bufferView"]
    start, length = (glb.header["bufferViews"][view][key] for key in ("byteOffset", "byteLength"))
    whole = glb.data
    for place in (0, 9, length // 2):
        glb.data = whole[: start + place] + b"\xff" * 8 + whole[start + place + 8 :]
        with contextlib.suppress(ModelError):  # or the bytes that were changed do not matter
            imported(glb.write(path), tmp_path / f"out{place}")
    glb.data = whole[:start] + bytes(length) + whole[start + length :]
    with pytest.raises(ModelError, match="cannot be decoded"):
        imported(glb.write(path), tmp_path / "out")


def test_more_vertices_than_the_accessors_say_are_refused(tmp_path):
    glb, path, _, _ = draco_file(tmp_path)
    for accessor in glb.header["accessors"]:
        accessor["count"] -= 1
    with pytest.raises(ModelError, match=r"cannot be decoded \(\d+ vertices instead of"):
        imported(glb.write(path), tmp_path / "out")


def test_a_decoder_that_dies_or_hangs_is_no_more_than_a_damaged_file(tmp_path, monkeypatch):
    program = tmp_path / "draco_process.py"
    for number, (body, reason) in enumerate(
        [
            ("import os; os.abort()", "gave up"),
            ("import time; time.sleep(60)", "gave up"),
            ("import sys; sys.stdin.buffer.readline(); print('nonsense', flush=True)", "gave up"),
        ]
    ):
        program.write_text(body)
        monkeypatch.setattr(draco, "__file__", str(tmp_path / "draco.py"))
        monkeypatch.setattr(draco, "_SECONDS_ANYHOW", 2.0)
        glb, path, _, _ = draco_file(tmp_path)
        with pytest.raises(ModelError, match=reason):
            imported(glb.write(path), tmp_path / f"out{number}")


def test_the_decoder_takes_no_more_memory_than_it_may():
    program = (
        f"import sys; sys.path.insert(0, {str(draco_process.__file__.rsplit('/', 1)[0])!r})\n"
        "import draco_process, numpy\n"
        "with draco_process._memory_limit(64 << 20):\n"
        "    numpy.ones(4 << 20)\n"
        "    try:\n        numpy.ones(1 << 30)\n    except MemoryError:\n        print('refused')\n"
        "print(len(numpy.ones(16 << 20)))\n"
    )
    import subprocess

    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["refused", str(16 << 20)]


def grid(n=12):
    """A terrain whose coordinates fit 16 bits exactly."""
    positions, triangles = terrain(n)
    return np.rint(positions * 100), triangles


def meshopt_file(name=MESHOPT, version=0, mode="TRIANGLES"):
    """As gltfpack writes it: integer positions in rows of 8 bytes, and triangles."""
    positions, triangles = grid()
    glb = Glb()
    rows = np.zeros((len(positions), 4), "<i2")
    rows[:, :3] = positions
    view = glb.view(rows.tobytes(), byteStride=8)
    glb.header["accessors"].append({"bufferView": view, "componentType": 5122, "count": len(rows), "type": "VEC3"})
    indices = glb.accessor(triangles.reshape(-1).astype("<u4"))
    compress_view(glb, 0, rows, "ATTRIBUTES", name=name, version=version)
    compress_view(glb, indices, triangles.reshape(-1).astype("<u4"), mode, name=name)
    glb.node(mesh=glb.mesh({"attributes": {"POSITION": 0}, "indices": indices}), name="ground")
    glb.header["buffers"] = [placeholder(name)]
    glb.header["extensionsRequired"] = [name, "KHR_mesh_quantization"]
    return glb, positions, triangles


@pytest.mark.parametrize("mode", ["TRIANGLES", "INDICES"])
@pytest.mark.parametrize(("name", "version"), [(MESHOPT, 0), ("KHR_meshopt_compression", 1)])
def test_meshopt_views_are_decoded(tmp_path, name, version, mode):
    glb, positions, triangles = meshopt_file(name, version, mode)
    assert same(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out"), positions, triangles, 0)


@pytest.mark.parametrize("size", ["<u2", "<u4"])
def test_indices_of_two_and_four_bytes(tmp_path, size):
    positions, triangles = grid()
    glb = Glb()
    primitive = glb.primitive(positions, triangles)
    glb.header["accessors"][primitive["indices"]]["componentType"] = {"<u2": 5123, "<u4": 5125}[size]
    corners = triangles.reshape(-1).astype(size)
    compress_view(glb, primitive["indices"], corners, "TRIANGLES")
    glb.header["buffers"] = [placeholder()]
    glb.node(mesh=glb.mesh(primitive))
    assert same(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out"), positions, triangles)


def filtered(filter_, values, encoded, component, width, **accessor):
    """A terrain with one more attribute under a filter."""
    positions, triangles = grid(4)
    glb = Glb()
    primitive = glb.primitive(positions, triangles)
    rows = np.ascontiguousarray(encoded).view(np.uint8).reshape(len(positions), -1)
    view = glb.view(rows.tobytes(), byteStride=rows.shape[1])
    entry = {"bufferView": view, "componentType": component, "count": len(rows), "type": f"VEC{width}", **accessor}
    glb.header["accessors"].append(entry)
    number = len(glb.header["accessors"]) - 1
    compress_view(glb, number, rows, "ATTRIBUTES", filter_, "KHR_meshopt_compression", version=1)
    glb.header["buffers"] = [placeholder("KHR_meshopt_compression")]
    return glb, primitive, number


def unit(n, width):
    values = np.random.default_rng(4).normal(size=(n, width))
    return values / np.linalg.norm(values, axis=1)[:, None]


@pytest.mark.parametrize(("stride", "component", "bits"), [(4, 5120, 8), (8, 5122, 12)])
def test_octahedral_normals(tmp_path, stride, component, bits):
    normals = unit(16, 3)
    rows = np.concatenate([normals, np.ones((16, 1))], axis=1).astype(np.float32)
    encoded = meshopt.encode_filter_oct(rows, stride, bits)
    glb, primitive, number = filtered("OCTAHEDRAL", normals, encoded, component, 3, normalized=True)
    primitive["attributes"]["NORMAL"] = number
    glb.node(mesh=glb.mesh(primitive))
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    order = [np.flatnonzero((grid(4)[0] == point).all(axis=1))[0] for point in model.positions]
    assert np.abs(model.normals - normals[order]).max() < 0.02


def test_exponential_positions(tmp_path):
    positions, triangles = terrain(4)
    encoded = meshopt.encode_filter_exp(positions.astype(np.float32), 20)
    glb, primitive, number = filtered("EXPONENTIAL", positions, encoded, 5126, 3)
    primitive["attributes"]["POSITION"] = number
    glb.node(mesh=glb.mesh(primitive))
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert same(model, positions, triangles, 2e-4)


def test_colour_filter(tmp_path):
    colours = np.tile(np.array([[1, 0, 0, 1]], np.float32), (16, 1))
    encoded = meshopt.encode_filter_color(colours, 4, 8)
    glb, primitive, number = filtered("COLOR", colours, encoded, 5121, 4, normalized=True)
    primitive["attributes"]["COLOR_0"] = number
    glb.node(mesh=glb.mesh(primitive))
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert np.abs(model.colours.astype(int) - [255, 0, 0, 255]).max() <= 13  # 1 of 255 in linear light


def test_quaternions_of_instances(tmp_path):
    half = np.sqrt(0.5)
    turns = np.tile(np.array([[0, 0, half, half]], np.float32), (16, 1))
    encoded = meshopt.encode_filter_quat(turns, 8, 16)
    glb, primitive, number = filtered("QUATERNION", turns, encoded, 5122, 4, normalized=True)
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"ROTATION": number}}}
    glb.node(mesh=glb.mesh(primitive), extensions=extension)
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert len(model.parts) == 16
    assert np.allclose(model.parts["matrix"][:, :, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-3)


def test_data_beside_meshopt_is_used_without_a_decoder(tmp_path, monkeypatch):
    """A fallback buffer that is there holds the data as it is."""
    monkeypatch.setitem(sys.modules, "meshopt", None)
    positions, triangles = box()
    glb = Glb()
    glb.node(mesh=glb.mesh(glb.primitive(positions, triangles)))
    (tmp_path / "fallback.bin").write_bytes(glb.data)
    entry = {"buffer": 0, "byteLength": 8, "byteStride": 4, "mode": "ATTRIBUTES"}
    views = [
        {**view, "buffer": 1, "extensions": {MESHOPT: {**entry, "count": view["byteLength"] // 4}}}
        for view in glb.header["bufferViews"]
    ]
    buffers = [{"byteLength": 8, "uri": "data:,12345678"}, {**placeholder(), "uri": "fallback.bin"}]
    buffers[1]["byteLength"] = len(glb.data)
    header = {**glb.header, "bufferViews": views, "buffers": buffers, "materials": [{}]}
    (tmp_path / "a.gltf").write_text(json.dumps(header))
    assert same(imported(tmp_path / "a.gltf", tmp_path / "out"), positions, triangles, 0)
    (tmp_path / "fallback.bin").unlink()
    with pytest.raises(ModelError, match=f"{MESHOPT}.*meshopt.*vlod\\[jobs\\]"):
        imported(tmp_path / "a.gltf", tmp_path / "gone")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mode": "POINTS"}, "mode POINTS"),
        ({"filter": "WAVELET"}, "filter WAVELET"),
        ({"count": 2**40}, "claims more than"),
        ({"count": -3}, "claims more than"),
        ({"byteStride": 7}, "claims more than"),
        ({"byteStride": 0}, "claims more than"),
        ({"byteLength": 2**40}, "claims more than|reaches beyond"),
        ({"byteOffset": 10**9}, "reaches beyond"),
        ({"byteLength": 20}, "cannot be decoded"),
        ({"count": 100}, "reaches beyond"),
        ({"filter": "QUATERNION", "byteStride": 4}, "claims more than"),
    ],
)
def test_views_that_make_no_sense_are_one_clear_line(tmp_path, change, message):
    glb, _, _ = meshopt_file()
    for view in glb.header["bufferViews"]:
        if view.get("byteStride") == 8:
            view["extensions"][MESHOPT] |= change
    with pytest.raises(ModelError, match=message) as caught:
        imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert "\n" not in str(caught.value)


def test_decompressed_data_counts_in_the_estimate_of_memory(tmp_path):
    plain, compressed = Glb(), Glb()
    positions = np.zeros((40_000, 3))
    for glb in (plain, compressed):
        glb.node(mesh=glb.mesh(glb.primitive(positions, [[0, 1, 2]])))
    compress_view(compressed, 0, positions.astype("<f4"), "ATTRIBUTES")
    compressed.header["buffers"] = [placeholder()]
    estimates = [import_memory([glb.write(tmp_path / "a.glb")]) for glb in (plain, compressed)]
    assert estimates[1] - estimates[0] > 400_000
    glb, path, _, _ = draco_file(tmp_path)
    assert import_memory([glb.write(path)]) > draco.decoder_memory(36, 50, 100)
