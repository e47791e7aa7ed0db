"""OBJ: groups, index forms, materials, and what is wrong with files in the wild."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.jobs.importing.shapes import corners_of, imported, terrain, total

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def obj(tmp_path, text, name="a.obj"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return imported(path, tmp_path / f"out of {name}")


def test_parts_are_groups_wherever_their_faces_stand(tmp_path):
    text = SQUARE + "o house\ng wall\nf 1 2 3\ng roof\nf 1 2 4\ng wall\nf 1 3 4\no shed\nf 2 3 4\n"
    model = obj(tmp_path, text)
    assert model.names == ("house/wall", "house/roof", "shed")
    assert model.meshes["triangles"].tolist() == [2, 1, 1]
    assert model.mesh(0).source_faces.tolist() == [0, 1]
    assert model.up == "y"


def test_a_file_without_groups_is_one_part_named_after_it(tmp_path):
    assert obj(tmp_path, SQUARE + "f 1 2 3 4\n", "house.obj").names == ("house",)


def test_relative_indices_count_from_where_they_stand(tmp_path):
    text = SQUARE + "f -4 -3 -2\n" + SQUARE.replace("v ", "v 5") + "f -4 -3 -2\nf 1 3 -5\n"
    model = obj(tmp_path, text)
    corners = corners_of(model)
    assert corners[0].tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    assert corners[1].tolist() == [[50, 0, 0], [51, 0, 0], [51, 1, 0]]
    assert corners[2].tolist() == [[0, 0, 0], [1, 1, 0], [0, 1, 0]]


def test_all_forms_of_corners_may_be_mixed(tmp_path):
    text = (
        SQUARE
        + "vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1//1 3//1 4//1\n"
        + "v 2 0 0\nv 2 1 0\nf 2/1 5/1 6/1\nf 2 6 3 # trailing\n"
        + "v 3 0 0\nv 3 1 0\nf 5 7/1 8//1 \\\n  6\n"
    )
    model = obj(tmp_path, text)
    assert model.triangle_count == 6
    assert (
        np.abs(np.linalg.norm(np.cross(*np.diff(corners_of(model), axis=1).transpose(1, 0, 2)), axis=1) - 1).max() == 0
    )
    mesh = model.mesh(0)
    assert set(map(tuple, mesh.normals.tolist())) == {(0, 0, 1), (0, 0, 0)}


def test_polygons_are_fans_and_too_short_ones_are_counted(tmp_path):
    model = obj(tmp_path, SQUARE + "v -1 0.5 0\nf 1 2 3 4 5\nf 1 2\nf 3\n")
    assert model.mesh(0).source_faces.tolist() == [0, 1, 2]
    assert total(model, "faces with fewer than three corners") == 2


def test_bad_indices_and_words_are_counted_by_part(tmp_path):
    text = SQUARE + "g a\nf 1 2 3\nf 1 2 99\nf 0 1 2\nf 1 2 x\ng b\nf 1 3 4\nf -9 1 2\nf 1 2 99999999999999999999\n"
    model = obj(tmp_path, text)
    assert model.report == {"faces with an index out of range": {"total": 5, "parts": {"a": 3, "b": 2}}}
    assert model.triangle_count == 2


def test_positions_that_are_no_numbers_are_counted(tmp_path):
    text = SQUARE + "v nan 0 0\nv 1e999 0 0\nv -inf 0 0\nv abc 0 0\nv 1 1\nf 1 2 3\n"
    model = obj(tmp_path, text + "".join(f"f 1 2 {i}\n" for i in range(5, 10)))
    assert model.report == {"faces with a position that is not finite": {"total": 5, "parts": {"a": 5}}}


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends_tabs_and_indents_do_not_matter(tmp_path, end):
    text = "# note\n\tv\t0 0 0\n  v 1 0 0  \nv 1 1 0\n\n g  a b \nf\t1 2 3".replace("\n", end)
    model = obj(tmp_path, text)
    assert model.names == ("a b",)
    assert model.triangle_count == 1


def test_vertex_colours_are_read_and_bad_ones_counted(tmp_path):
    text = "v 0 0 0 1 0 0\nv 1 0 0 0 0.5 0\nv 1 1 0 nan nan nan\nf 1 2 3\n"
    model = obj(tmp_path, text)
    assert model.mesh(0).colours.tolist() == [[255, 0, 0, 255], [0, 128, 0, 255], [204, 204, 204, 255]]
    assert total(model, "colours that are not finite") == 1


def test_some_vertices_may_have_colours_and_others_not(tmp_path):
    model = obj(tmp_path, "v 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0 0 0 1\nf 1 2 3\n")
    assert model.mesh(0).colours.tolist() == [[255, 0, 0, 255], [204, 204, 204, 255], [0, 0, 255, 255]]
    assert model.report == {}


def test_materials_colour_faces_and_split_vertices_only_where_they_meet(tmp_path):
    (tmp_path / "my lib.mtl").write_text("newmtl red\nKd 1 0 0\nd 0.5\n\nnewmtl blue\n  Kd 0 0 1\nTr 0.2\n")
    text = "mtllib my lib.mtl\n" + SQUARE + "usemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\nusemtl red\nf 2 4 3\n"
    mesh = obj(tmp_path, text).mesh(0)
    assert mesh.source_faces.tolist() == [0, 1, 2]
    assert np.array_equal(mesh.colours[mesh.triangles[:, 0]], [[255, 0, 0, 128], [0, 0, 255, 204], [255, 0, 0, 128]])
    assert len(mesh.positions) == 7


def test_textures_tint_the_material(tmp_path):
    Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)).save(
        tmp_path / "t.png"
    )
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 1 0.5 1\nmap_Kd -clamp on -s 1 1 1 t.png\n")
    text = "mtllib m.mtl\n" + SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3 4/4\n"
    mesh = obj(tmp_path, text).mesh(0)
    expected = {(0, 0): [0, 0, 255], (1, 0): [255, 128, 255], (1, 1): [0, 128, 0], (0, 1): [255, 0, 0]}
    for position, colour in zip(mesh.positions.tolist(), mesh.colours.tolist(), strict=True):
        assert colour[:3] == expected[tuple(position[:2])]


def test_missing_libraries_textures_and_materials_are_counted(tmp_path):
    faces = SQUARE + "vt 0 0\ng wall\nusemtl a\nf 1/1 2/1 3/1\nusemtl b\nf 1 3 4\n"
    model = obj(tmp_path, "mtllib none.mtl\n" + faces, "one.obj")
    assert model.report == {"missing material libraries": {"total": 1, "parts": {"one.obj": 1}}}
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd none.png\n")
    model = obj(tmp_path, "mtllib m.mtl\n" + faces, "two.obj")
    assert model.report == {
        "missing textures": {"total": 1, "parts": {"wall": 1}},
        "unknown materials": {"total": 1, "parts": {"wall": 1}},
    }


@pytest.mark.parametrize("name", ["../secret.mtl", "/etc/hosts", "http://127.0.0.1:9/x.mtl"])
def test_libraries_outside_the_folder_are_missing(tmp_path, name):
    (tmp_path / "secret.mtl").write_text("newmtl a\nKd 1 0 0\n")
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "a.obj").write_text(f"mtllib {name}\n" + SQUARE + "usemtl a\nf 1 2 3\n")
    model = imported(tmp_path / "model" / "a.obj", tmp_path / "out")
    assert total(model, "missing material libraries") == 1
    assert (model.colours[:, :3] == 204).all()


def test_lines_and_points_are_counted(tmp_path):
    model = obj(tmp_path, SQUARE + "l 1 2 3\np 1\nf 1 2 3\n")
    assert total(model, "points, lines and other primitives without triangles") == 2


def test_chunks_do_not_show(tmp_path, monkeypatch):
    positions, triangles = terrain(12)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in positions.tolist()]
    for i, (a, b, c) in enumerate((triangles - len(positions)).tolist()):
        lines.append(f"f {a} \\\n {b} {c}" if i % 5 == 0 else f"f {a} {b} {c}")
        if i % 7 == 0:
            lines.append(f"g part {i % 3}")
    whole = obj(tmp_path, "\n".join(lines), "whole.obj")
    monkeypatch.setattr("jobs.importing.formats.obj_file._CHUNK", 50)
    (tmp_path / "other").mkdir()
    pieces = obj(tmp_path / "other", "\n".join(lines), "whole.obj")
    assert whole.digest == pieces.digest
    assert whole.triangle_count == len(triangles)
