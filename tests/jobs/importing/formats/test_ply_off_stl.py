"""PLY, OFF and STL: their variants, and claims that their data does not keep."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from storage.base.errors import ModelError
from tests.jobs.importing.shapes import corners_of, imported, terrain, total

PLY = """ply
format {form} 1.0
comment made by hand
element vertex 5
property float x
property float y
property float z
{colours}element face 3
property list uchar int vertex_indices
property uchar flag
end_header
"""
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 2, 0]], np.float32)
FACES = [[0, 1, 2, 3], [3, 2, 4], [0, 2]]


def binary_ply(order="<", faces=FACES, points=POINTS):
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    data = PLY.format(form=name, colours="").replace("face 3", f"face {len(faces)}").encode()
    data += points.astype(order + "f4").tobytes()
    for face in faces:
        data += bytes([len(face)]) + np.array(face, order + "i4").tobytes() + b"\7"
    return data


def save(tmp_path, name, data):
    (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    return tmp_path / name


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_with_mixed_polygons(tmp_path, order):
    model = imported(save(tmp_path, "a.ply", binary_ply(order)), tmp_path / "out")
    assert model.mesh(0).triangles.tolist() == [[0, 1, 2], [0, 2, 3], [3, 2, 4]]
    assert total(model, "faces with fewer than three corners") == 1
    assert model.up == "z"


def test_text_ply_with_mixed_polygons_and_broken_lines(tmp_path):
    rows = "0 0 0 1 0 0\n1 1 0 0 1 0 0.5 2\n0\n4 0 1 2 3 7 3 3 2\n4 7\n2 0 2 7\n"
    model = imported(save(tmp_path, "a.ply", PLY.format(form="ascii", colours="") + rows), tmp_path / "out")
    assert model.mesh(0).triangles.tolist() == [[0, 1, 2], [0, 2, 3], [3, 2, 4]]


def test_ply_colours_of_any_type(tmp_path):
    for kind, scale in (("uchar", 255), ("ushort", 65535), ("float", 1)):
        colours = f"property {kind} red\nproperty {kind} green\nproperty {kind} blue\n"
        rows = "".join(f"{x} {y} {z} {scale} 0 {scale}\n" for x, y, z in POINTS) + "4 0 1 2 3 0\n3 3 2 4 0\n3 0 1 4 0\n"
        path = save(tmp_path, f"{kind}.ply", PLY.format(form="ascii", colours=colours) + rows)
        assert (imported(path, tmp_path / kind).colours == [255, 0, 255, 255]).all()


def test_ply_texture(tmp_path):
    Image.fromarray(np.array([[[9, 9, 9]], [[7, 7, 7]]], np.uint8)).save(tmp_path / "t.png")
    header = PLY.format(form="ascii", colours="property float s\nproperty float t\n")
    header = header.replace("made by hand", "TextureFile t.png")
    rows = "".join(f"{x} {y} {z} {x} {y / 2}\n" for x, y, z in POINTS) + "4 0 1 2 3 0\n3 3 2 4 0\n3 0 1 4 0\n"
    mesh = imported(save(tmp_path, "a.ply", header + rows), tmp_path / "out").mesh(0)
    assert mesh.colours[mesh.positions[:, 1] == 0, 0].tolist() == [7, 7]
    assert mesh.colours[mesh.positions[:, 1] == 2, 0].tolist() == [9]
    (tmp_path / "t.png").unlink()
    assert total(imported(tmp_path / "a.ply", tmp_path / "two"), "missing textures") == 1


def test_ply_texture_by_corner(tmp_path):
    Image.fromarray(np.array([[[9, 9, 9], [7, 7, 7]]], np.uint8)).save(tmp_path / "t.png")
    header = PLY.format(form="ascii", colours="").replace("made by hand", "TextureFile t.png")
    header = header.replace("property uchar flag", "property list uchar float texcoord").replace("face 3", "face 2")
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS)
    rows += "3 0 1 2 6 0.1 0.5 0.1 0.5 0.1 0.5\n3 0 2 3 6 0.9 0.5 0.9 0.5 0.9 0.5\n"
    mesh = imported(save(tmp_path, "a.ply", header + rows), tmp_path / "out").mesh(0)
    assert mesh.colours[mesh.triangles][:, :, 0].tolist() == [[9] * 3, [7] * 3]


def test_bad_indices_and_nan_in_ply(tmp_path):
    points = POINTS.copy()
    points[3, 1] = np.nan
    data = binary_ply(faces=[[0, 1, 2], [0, 1, 77], [0, -1, 2], [0, 1, 3]], points=points)
    model = imported(save(tmp_path, "a.ply", data), tmp_path / "out")
    assert total(model, "faces with an index out of range") == 2
    assert total(model, "faces with a position that is not finite") == 1
    assert model.triangle_count == 1


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
@pytest.mark.parametrize("count", ["4000000000", "9" * 30, "-1", "x"])
@pytest.mark.parametrize("element", ["vertex 5", "face 3"])
def test_giant_ply_counts_are_refused_without_taking_memory(tmp_path, form, count, element):
    data = binary_ply() if form != "ascii" else PLY.format(form=form, colours="").encode() + b"0 " * 40
    data = data.replace(element.encode(), f"{element.split()[0]} {count}".encode())
    with pytest.raises(ModelError, match=r"promised|means nothing"):
        imported(save(tmp_path, "a.ply", data), tmp_path / "out")


@pytest.mark.parametrize("length", [255, 200])
def test_ply_lists_longer_than_the_file_are_refused(tmp_path, length):
    data = bytearray(binary_ply())
    data[data.index(b"end_header\n") + 11 + 60] = length
    with pytest.raises(ModelError, match="cut short"):
        imported(save(tmp_path, "a.ply", bytes(data)), tmp_path / "out")


def test_points_without_faces_are_no_model(tmp_path):
    with pytest.raises(ModelError, match="no triangles"):
        imported(save(tmp_path, "a.ply", binary_ply(faces=[])), tmp_path / "out")


def test_off_with_colours_comments_and_mixed_polygons(tmp_path):
    text = "COFF # head\n# more\n5 2 0\n\n" + "".join(f"{x} {y} {z} 255 0 9 255\n" for x, y, z in POINTS)
    model = imported(save(tmp_path, "a.off", text + "4 0 1 2 3\n3 3 2 4\n"), tmp_path / "out")
    assert model.mesh(0).triangles.tolist() == [[0, 1, 2], [0, 2, 3], [3, 2, 4]]
    assert (model.colours == [255, 0, 9, 255]).all()


def test_off_face_colours_split_vertices(tmp_path):
    text = "OFF 5 2 0\n" + "".join(f"{x} {y} {z}\n" for x, y, z in POINTS) + "3 0 1 2 1.0 0 0\n3 0 2 3 0 1.0 0\n"
    mesh = imported(save(tmp_path, "a.off", text), tmp_path / "out").mesh(0)
    assert mesh.colours[mesh.triangles[:, 0]].tolist() == [[255, 0, 0, 255], [0, 255, 0, 255]]
    assert len(mesh.positions) == 6


def test_bad_indices_and_nan_in_off(tmp_path):
    text = "OFF\n5 5 0\n" + "".join(f"{x} {y} {z}\n" for x, y, z in POINTS[:4]) + "nan 0 0\n"
    model = imported(
        save(tmp_path, "a.off", text + "3 0 1 2\n3 0 1 9\n3 0 -1 2\n3 0 1 4\n3 0 1 1.5\n"), tmp_path / "out"
    )
    assert total(model, "faces with an index out of range") == 3
    assert total(model, "faces with a position that is not finite") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("OFF\n4000000000 1 0\n0 0 0\n", "promised"),
        ("OFF\n3 9999999999999 0\n0 0 0\n", "promised"),
        ("OFF\n-3 1 0\n", "counts"),
        ("OFF\nthree one\n", "counts"),
        ("OFF\n", "counts"),
        ("OFF BINARY\n3 1 0\n", "binary"),
        ("STOFF\n3 1 0\n", "promised"),
        ("nOFF\n4\n3 1 0\n0 0 0 0\n", "dimensions"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n1 1 0\n9 0 1 2\n", "9 corners"),
        ("hello\n", "not an OFF file"),
    ],
)
def test_off_claims_that_are_not_kept(tmp_path, text, message):
    with pytest.raises(ModelError, match=message):
        imported(save(tmp_path, "a.off", text), tmp_path / "out")


def test_stl_solids_are_parts(tmp_path):
    facet = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {1} 0 0\nvertex {0} 1 0\nendloop\nendfacet\n"
    one, two = facet.format(0, 1), facet.format(5, 6) + facet.format(7, 8)
    text = f"solid one\n{one}endsolid one\nsolid two\n{two}endsolid two\n"
    model = imported(save(tmp_path, "a.stl", text), tmp_path / "out")
    assert model.names == ("one", "two")
    assert model.meshes["triangles"].tolist() == [1, 2]


def test_stl_solids_of_one_name_are_numbered(tmp_path):
    facet = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {1} 0 0\nvertex {0} 1 0\nendloop\nendfacet\n"
    solids = ["Bolt", "Bolt", "", "", "part_7", "part_7", "empty"]
    texts = [f"solid {name}\n{facet.format(k, k + 1) * (name != 'empty')}endsolid\n" for k, name in enumerate(solids)]
    for end in ("\n", "\r\n", "\r"):
        path = save(tmp_path, "a.stl", "".join(texts).replace("\n", end))
        model = imported(path, tmp_path / f"out {end.encode().hex()}")
        assert model.names == ("Bolt", "Bolt_1", "geometry_1", "geometry_2", "part_7", "part_8")
        assert corners_of(model)[:, 0, 0].tolist() == [0, 1, 2, 3, 4, 5]


def test_words_among_the_numbers_of_an_stl_file_are_counted(tmp_path):
    facet = "FACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX {} 0 0\nVERTEX 1 0 0\nVERTEX 0 1 0\nENDLOOP\nENDFACET\n"
    text = f"SOLID A\n{facet.format(0)}{facet.format('zero')}{facet.format('')}ENDSOLID\n"
    model = imported(save(tmp_path, "a.stl", text), tmp_path / "out")
    assert model.triangle_count == 1
    assert total(model, "faces with a position that is not finite") == 2


def test_an_stl_solid_with_a_vertex_too_many_is_refused(tmp_path):
    facet = "facet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\n"
    text = f"solid\n{facet}vertex 5 5 5\nendsolid\nsolid\n{facet.replace('vertex 0 0 0', '')}endsolid\n"
    with pytest.raises(ModelError, match="not every facet has three vertices"):
        imported(save(tmp_path, "a.stl", text), tmp_path / "out")


def binary_stl(count=None):
    positions, triangles = terrain(4)
    rows = np.zeros(len(triangles), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = positions[triangles]
    return b"solid but binary".ljust(80) + np.uint32(len(rows) if count is None else count).tobytes() + rows.tobytes()


def test_binary_stl_that_says_solid(tmp_path):
    model = imported(save(tmp_path, "a.STL", binary_stl()), tmp_path / "out")
    assert model.triangle_count == 18
    assert model.names == ("a",)


def test_nan_in_stl_is_counted(tmp_path):
    data = bytearray(binary_stl())
    data[84 + 12 : 84 + 16] = np.float32(np.nan).tobytes()
    data[134 + 12 : 134 + 16] = np.float32(np.inf).tobytes()
    model = imported(save(tmp_path, "a.stl", bytes(data)), tmp_path / "out")
    assert total(model, "faces with a position that is not finite") == 2


@pytest.mark.parametrize("count", [0, 17, 19, 2**32 - 1])
def test_stl_counts_that_do_not_fit_are_refused(tmp_path, count):
    with pytest.raises(ModelError, match=r"cut short|endsolid"):
        imported(save(tmp_path, "a.stl", binary_stl(count)), tmp_path / "out")


def test_a_file_in_another_unit_or_up_axis(tmp_path):
    path = save(tmp_path, "a.ply", binary_ply())
    model = imported(path, tmp_path / "out", units="mm", up="y")
    assert (model.up, model.unit_in_metres) == ("y", 0.001)
    assert np.array_equal(np.unique(corners_of(model).reshape(-1, 3), axis=0), np.unique(POINTS, axis=0))


def test_parsers_say_nothing(tmp_path, caplog, capfd):
    facet = "facet normal x 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    model = imported(save(tmp_path, "a.stl", f"solid\n{facet}endsolid\n"), tmp_path / "out")
    assert model.triangle_count == 1
    assert caplog.records == []
    assert capfd.readouterr() == ("", "")
