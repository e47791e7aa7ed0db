"""Whatever is handed in: a model with a counted report, or one clear line; never half a model."""

from __future__ import annotations

import base64
import functools
import json
import os
import resource

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.importing.formats.known import kinds
from jobs.importing.join import metres_per_unit
from jobs.importing.model import ImportOptions, import_model, open_model
from storage.base.errors import ModelError, ParameterError
from tests.jobs.importing.shapes import Glb, box, canonical, corners_of, imported, terrain, total

#: Formats that know how long they are: any cut is noticed.
SELF_SIZED = ["glb", "ply", "stl", "gltf", "dae", "off", "stl_ascii"]


def content(kind: str) -> bytes:
    positions, triangles = terrain(6)
    mesh = trimesh.Trimesh(positions, triangles, process=False)
    if kind == "gltf":
        glb = Glb()
        glb.node(mesh=glb.mesh(glb.primitive(positions, triangles)))
        uri = "data:application/octet-stream;base64," + base64.b64encode(glb.data).decode()
        header = {key: value for key, value in glb.header.items() if value != []}
        return json.dumps({**header, "buffers": [{"byteLength": len(glb.data), "uri": uri}]}).encode()
    data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


CONTENT = {kind: content(kind) for kind in [*SELF_SIZED, "obj"]}


def attempt(folder, kind, data):
    """Import bytes as a file of a kind: the model, or None if it was refused in one clear line."""
    path = folder / f"a.{kind.removesuffix('_ascii')}"
    path.write_bytes(data)
    try:
        model = imported(path, folder / "out")
    except ModelError as error:
        message = str(error)
    else:
        assert model.triangle_count > 0
        assert np.isfinite(model.positions).all()
        assert sorted(p.name for p in folder.iterdir()) == [path.name, "out"]
        return model
    assert "\n" not in message
    assert str(path) in message
    assert [p.name for p in folder.iterdir()] == [path.name]
    return None


@given(st.sampled_from(SELF_SIZED), st.floats(0, 1))
@settings(deadline=None, max_examples=150)
def test_a_file_cut_anywhere_is_refused(tmp_path_factory, kind, share):
    data = CONTENT[kind].rstrip()
    needed = len(data) - (1 if kind not in ("glb", "ply", "stl") else 0)
    cut = data[: int(share * needed)] if share < 1 else data[: needed - 1]
    if kind == "off":  # a number cut in two is still a number
        cut = cut[: cut.rfind(b"\n") + 1] if cut.count(b"\n") < data.count(b"\n") else cut[: cut.rfind(b"\n")]
    if kind == "stl_ascii" and cut.endswith(b"endsolid"):
        cut = cut[:-1]
    assert attempt(tmp_path_factory.mktemp("cut"), kind, cut) is None


@given(st.integers(0, len(CONTENT["obj"])))
@settings(deadline=None, max_examples=60)
def test_an_obj_cut_anywhere_is_refused_or_read_as_far_as_it_goes(tmp_path_factory, cut):
    """Every line that is whole is read as in the whole file; of the line that is cut at most one face more."""
    data = CONTENT["obj"][:cut]
    whole_faces = data.count(b"\nf ", 0, data.rfind(b"\n") + 1)
    model = attempt(tmp_path_factory.mktemp("cut"), "obj", data)
    read = 0 if model is None else model.triangle_count
    assert whole_faces <= read <= whole_faces + 1
    if model is not None:
        assert np.array_equal(corners_of(model)[:whole_faces], obj_corners()[:whole_faces])


@functools.cache
def obj_corners() -> np.ndarray:
    """The corners of the OBJ file's faces (m, 3, 3), read as its lines say."""
    lines = [line.split() for line in CONTENT["obj"].decode().splitlines()]
    positions = np.array([line[1:4] for line in lines if line[:1] == ["v"]], np.float64)
    faces = [[int(corner.split("/")[0]) - 1 for corner in line[1:]] for line in lines if line[:1] == ["f"]]
    return positions[np.array(faces)]


@given(
    st.sampled_from(sorted(CONTENT)), st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=8)
)
@settings(deadline=None, max_examples=200)
def test_changed_bytes_never_crash(tmp_path_factory, kind, changes):
    data = bytearray(CONTENT[kind])
    for share, byte in changes:
        data[min(int(share * len(data)), len(data) - 1)] = byte
    attempt(tmp_path_factory.mktemp("changed"), kind, bytes(data))


@given(st.sampled_from(sorted(CONTENT)), st.binary(max_size=400), st.booleans())
@settings(deadline=None, max_examples=120)
def test_random_bytes_never_crash(tmp_path_factory, kind, data, keep_head):
    attempt(tmp_path_factory.mktemp("random"), kind, CONTENT[kind][: 40 if keep_head else 0] + data)


@pytest.mark.parametrize(
    ("kind", "other"), [(a, b) for a in sorted(CONTENT) for b in sorted(CONTENT) if a[:3] != b[:3]]
)
def test_a_wrong_extension_is_refused(tmp_path, kind, other):
    assert attempt(tmp_path, other, CONTENT[kind]) is None


@pytest.mark.parametrize("kind", ["glb", "gltf", "obj", "ply", "stl", "off", "dae"])
@pytest.mark.parametrize(
    "data", [b"", b"\0" * 1000, b"\n \n", b"hello\n", b"\xff\xfe" * 50, b"{}", b"[" * 100_000, b"<a>" * 9000]
)
def test_files_that_are_no_model_are_refused(tmp_path, kind, data):
    assert attempt(tmp_path, kind, data) is None


def test_an_unknown_extension_names_the_known_ones(tmp_path):
    (tmp_path / "a.fbx").write_bytes(b"Kaydara")
    with pytest.raises(ModelError, match=r"a\.fbx.*\.glb"):
        imported(tmp_path / "a.fbx", tmp_path / "out")


def test_missing_files_and_folders_without_models(tmp_path):
    with pytest.raises(ModelError, match="no such file or folder"):
        imported(tmp_path / "none.glb", tmp_path / "out")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "readme.txt").write_text("no model")
    with pytest.raises(ModelError, match="holds no model") as caught:
        imported(tmp_path / "folder", tmp_path / "out")
    assert kinds() in str(caught.value)
    with pytest.raises(ModelError, match="no input"):
        imported([], tmp_path / "out")
    os.mkfifo(tmp_path / "pipe.glb")
    with pytest.raises(ModelError, match="not a regular file"):
        imported(tmp_path / "pipe.glb", tmp_path / "out")


def test_a_file_without_permission(tmp_path, monkeypatch):
    path = tmp_path / "a.stl"
    path.write_bytes(CONTENT["stl"])
    path.chmod(0)
    if os.geteuid() == 0:  # the system lets root read everything

        def refuse(self, start, end):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr("jobs.importing.reading.content.FileContent.part", refuse)
    with pytest.raises(ModelError, match="Permission denied"):
        imported(path, tmp_path / "out")


def test_nothing_left_to_draw_says_what_was_removed(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\n")
    with pytest.raises(ModelError, match="1 faces with a position that is not finite, 1 faces without area"):
        imported(tmp_path / "a.obj", tmp_path / "out")


def test_giant_claims_take_no_memory(tmp_path):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    data = bytearray(CONTENT["stl"])
    data[80:84] = b"\xff\xff\xff\xff"
    assert attempt(tmp_path, "stl", bytes(data)) is None
    (tmp_path / "a.stl").unlink()
    for number in (b"4000000000", b"999999999999999"):
        assert attempt(tmp_path, "ply", CONTENT["ply"].replace(b"vertex 36", b"vertex " + number)) is None
        (tmp_path / "a.ply").unlink()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def test_a_folder_is_read_in_order_and_parts_bear_their_files_names(tmp_path):
    positions, triangles = box()
    for number, name in enumerate(["b/one.obj", "a.ply", "b/a/two.STL"]):
        path = tmp_path / "model" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        mesh = trimesh.Trimesh(positions + 3 * number, triangles, process=False)
        data = mesh.export(file_type=path.suffix[1:].lower())
        path.write_bytes(data.encode() if isinstance(data, str) else data)
    (tmp_path / "model" / "notes.txt").write_text("not a model")
    model = imported(tmp_path / "model", tmp_path / "out")
    assert model.names == ("a.ply/a", "b/a/two.STL/two", "b/one.obj/one")
    assert model.triangle_count == 36


def test_files_of_a_folder_may_refer_to_each_other(tmp_path):
    (tmp_path / "m" / "obj").mkdir(parents=True)
    (tmp_path / "m" / "common.mtl").write_text("newmtl a\nKd 1 0 0\n")
    (tmp_path / "m" / "obj" / "a.obj").write_text(
        "mtllib ../common.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    )
    model = imported(tmp_path / "m", tmp_path / "out")
    assert (model.colours == [255, 0, 0, 255]).all()


def test_other_files_are_brought_into_the_first_ones_frame(tmp_path):
    positions, triangles = box(2.0)
    glb = Glb()
    glb.node(mesh=glb.mesh(glb.primitive(positions[:, [0, 2, 1]] * [1, 1, -1], triangles)))
    glb.write(tmp_path / "metres, y up.glb")
    points, numbers = (" ".join(map(str, array.ravel())) for array in (positions * 2, triangles))
    (tmp_path / "inches, z up.dae").write_text(
        '<COLLADA xmlns="x"><asset><unit meter="0.5"/><up_axis>Z_UP</up_axis></asset>'
        f'<library_geometries><geometry id="g"><mesh><source id="p"><float_array>{points}</float_array></source>'
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f'<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>{numbers}</p></triangles>'
        '</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">'
        '<node><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes></COLLADA>'
    )
    files = [tmp_path / "inches, z up.dae", tmp_path / "metres, y up.glb"]
    model = imported(files, tmp_path / "out")
    assert (model.up, model.unit_in_metres) == ("z", 0.5)
    first, second = corners_of(model).reshape(2, -1, 3, 3)
    assert np.array_equal(canonical(first), canonical(second))
    model = imported(files[::-1], tmp_path / "other")
    assert (model.up, model.unit_in_metres) == ("y", 1.0)
    assert model.hi.tolist() == [2, 2, 0]
    model = imported(files, tmp_path / "third", units="ft", up="x")
    assert (model.up, model.unit_in_metres) == ("x", 0.3048)
    assert model.hi.max() == 4


@pytest.mark.parametrize(
    ("units", "metres"), [("mm", 0.001), ("Inches", 0.0254), ("feet", 0.3048), ("meters", 1), ("0.5", 0.5), (2, 2.0)]
)
def test_units_have_names(units, metres):
    assert metres_per_unit(units) == metres


@pytest.mark.parametrize("units", ["parsec", "0", "-1", "nan", "inf", ""])
def test_units_that_make_no_sense(tmp_path, units):
    (tmp_path / "a.stl").write_bytes(CONTENT["stl"])
    with pytest.raises(ParameterError, match="units"):
        imported(tmp_path / "a.stl", tmp_path / "out", units=units)
    with pytest.raises(ParameterError, match="up"):
        imported(tmp_path / "a.stl", tmp_path / "out", up="w")
    assert not (tmp_path / "out").exists()


def test_progress_and_report(tmp_path):
    (tmp_path / "a.stl").write_bytes(CONTENT["stl"])
    (tmp_path / "b.obj").write_bytes(CONTENT["obj"] + b"\nf 1 1 2\n")
    steps: list[tuple[int, int]] = []
    report = import_model(
        [tmp_path / "a.stl", tmp_path / "b.obj"],
        tmp_path / "out",
        ImportOptions(),
        lambda done, of: steps.append((done, of)),
    )
    assert steps == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert (report.files, report.meshes, report.parts, report.triangles) == (2, 2, 2, 100)
    model = open_model(tmp_path / "out")
    assert model.report == report.report == {"faces without area": {"total": 1, "parts": {"b.obj/b": 1}}}
    assert total(model, "faces without area") == 1
