"""COLLADA: frames, instances, primitives, materials."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from storage.base.errors import ModelError
from tests.jobs.importing.shapes import corners_of, imported, total

DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>{asset}</asset>
<library_images><image id="img"><init_from>{image}</init_from></image></library_images>
<library_effects>
<effect id="red-fx"><profile_COMMON><technique sid="t"><lambert><diffuse><color>1 0 0 1</color></diffuse>
<transparent opaque="A_ONE"><color>1 1 1 0.5</color></transparent></lambert></technique></profile_COMMON></effect>
<effect id="tex-fx"><profile_COMMON>
<newparam sid="surf"><surface type="2D"><init_from>img</init_from></surface></newparam>
<newparam sid="samp"><sampler2D><source>surf</source></sampler2D></newparam>
<technique sid="t"><phong><diffuse><texture texture="samp" texcoord="UV"/></diffuse></phong></technique>
</profile_COMMON></effect>
</library_effects>
<library_materials>
<material id="red"><instance_effect url="#red-fx"/></material>
<material id="tex"><instance_effect url="#tex-fx"/></material>
</library_materials>
<library_geometries><geometry id="geo" name="sheet"><mesh>
<source id="pos"><float_array id="pa" count="15">{positions}</float_array>
<technique_common><accessor source="#pa" count="5" stride="3"/></technique_common></source>
<source id="uv"><float_array id="ua" count="8">0 0 1 0 1 1 0 1</float_array>
<technique_common><accessor source="#ua" count="4" stride="2"/></technique_common></source>
<vertices id="verts"><input semantic="POSITION" source="#pos"/></vertices>
{primitives}
</mesh></geometry></library_geometries>
<library_nodes><node id="lib" name="library">{instance}</node></library_nodes>
<library_visual_scenes><visual_scene id="scene">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>
"""
INSTANCE = """<instance_geometry url="#geo"><bind_material><technique_common>
<instance_material symbol="A" target="#red"/><instance_material symbol="B" target="#tex"/>
</technique_common></bind_material></instance_geometry>"""
VERTEX = '<input semantic="VERTEX" source="#verts" offset="0"/>'
UV = '<input semantic="TEXCOORD" source="#uv" offset="1" set="0"/>'
TRIANGLES = f'<triangles material="A" count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>'


def dae(tmp_path, name="a.dae", **changes):
    parts = {
        "asset": "",
        "image": "t.png",
        "positions": "0 0 0 1 0 0 1 1 0 0 1 0 0.5 2 0",
        "primitives": TRIANGLES,
        "instance": INSTANCE,
        "nodes": f'<node name="thing">{INSTANCE}</node>',
        **changes,
    }
    path = tmp_path / name
    path.write_text(DAE.format(**parts))
    return imported(path, tmp_path / f"out of {name}")


def test_frame_is_read_and_coordinates_stay(tmp_path):
    model = dae(tmp_path, asset='<unit meter="0.0254" name="inch"/><up_axis>Z_UP</up_axis>')
    assert (model.unit_in_metres, model.up) == (0.0254, "z")
    assert model.hi.tolist() == [1, 1, 0]
    model = dae(tmp_path, "b.dae")
    assert (model.unit_in_metres, model.up) == (1.0, "y")


def test_instances_stay_instances_and_transforms_multiply(tmp_path):
    nodes = f"""<node name="group"><translate>10 0 0</translate><rotate>0 0 1 90</rotate>
    <node name="one">{INSTANCE}</node>
    <node name="two"><matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</matrix><scale>2 2 2</scale>
    <instance_node url="#lib"/></node>
    </node>"""
    model = dae(tmp_path, nodes=nodes)
    assert len(model.meshes) == 1
    assert model.names == ("one/sheet", "library/sheet")
    one, two = model.parts["matrix"]
    assert one.tolist() == [[0, -1, 0, 10], [1, 0, 0, 0], [0, 0, 1, 0]]
    assert two.tolist() == [[0, -2, 0, 10], [2, 0, 0, 5], [0, 0, 2, 0]]


def test_far_coordinates_lose_nothing(tmp_path):
    x = 10000000.125
    model = dae(tmp_path, positions=f"{x} 0 0 {x + 1} 0 0 {x + 1} 1 0 {x} 1 0 0 0 0")
    assert np.array_equal(corners_of(model)[0], [[x, 0, 0], [x + 1, 0, 0], [x + 1, 1, 0]])


def test_all_kinds_of_primitives(tmp_path):
    primitives = (
        f'<polylist count="2">{VERTEX}<vcount>4 3</vcount><p>0 1 2 3 3 2 4</p></polylist>'
        f"<polygons>{VERTEX}<p>0 1 4</p><p>1 2 4</p></polygons>"
        f"<tristrips>{VERTEX}<p>0 1 3 4</p></tristrips><trifans>{VERTEX}<p>4 0 2 1</p></trifans>"
        f"<lines>{VERTEX}<p>0 1</p></lines>"
    )
    model = dae(tmp_path, primitives=primitives)
    assert model.mesh(0).source_faces.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8][: model.triangle_count]
    assert model.triangle_count + total(model, "duplicate faces of opposite winding") == 9
    assert total(model, "points, lines and other primitives without triangles") == 1


def test_materials_and_textures(tmp_path):
    Image.fromarray(np.array([[[0, 0, 200]]], np.uint8)).save(tmp_path / "t.png")
    primitives = TRIANGLES + f'<triangles material="B">{VERTEX}{UV}<p>3 3 2 2 4 1</p></triangles>'
    mesh = dae(tmp_path, primitives=primitives).mesh(0)
    assert mesh.colours[mesh.triangles[:, 0]].tolist() == [[255, 0, 0, 128], [255, 0, 0, 128], [0, 0, 200, 255]]


@pytest.mark.parametrize("image", ["none.png", "../t.png", "file:///etc/passwd", "http://127.0.0.1:9/t.png"])
def test_missing_textures_are_counted(tmp_path, image):
    (tmp_path / "model").mkdir()
    primitives = f'<triangles material="B">{VERTEX}{UV}<p>3 3 2 2 4 1</p></triangles>'
    (tmp_path / "t.png").write_bytes(b"outside")
    model = dae(tmp_path / "model", primitives=primitives, image=image)
    assert model.report == {"missing textures": {"total": 1, "parts": {"thing/sheet": 1}}}


def test_defects_are_counted_by_part(tmp_path):
    primitives = f'<triangles material="Z">{VERTEX}<p>0 1 2 0 1 99 0 -1 2 0 1 4 1 1 2 0 2</p></triangles>'
    model = dae(tmp_path, primitives=primitives, positions="0 0 0 1 0 0 1 1 0 0 1 0 NaN 2 0")
    assert {defect: counts["total"] for defect, counts in model.report.items()} == {
        "faces with an index out of range": 2,
        "faces with a position that is not finite": 1,
        "faces without area": 1,
        "unknown materials": 1,
    }
    assert all(list(counts["parts"]) == ["thing/sheet"] for counts in model.report.values())


def test_broken_references_are_counted(tmp_path):
    nodes = f'<node name="a"><instance_geometry url="#nothing"/><instance_node url="#nowhere"/>{INSTANCE}</node>'
    assert total(dae(tmp_path, nodes=nodes), "broken elements") == 2


def test_a_node_that_contains_itself_is_refused(tmp_path):
    with pytest.raises(ModelError, match="contain itself"):
        dae(tmp_path, nodes='<node id="x" name="x"><instance_node url="#x"/></node>')


def test_entities_are_refused(tmp_path):
    (tmp_path / "a.dae").write_text('<!DOCTYPE x [<!ENTITY a "b">]><COLLADA>&a;</COLLADA>')
    with pytest.raises(ModelError, match="entities"):
        imported(tmp_path / "a.dae", tmp_path / "out")


def test_other_xml_is_no_model(tmp_path):
    (tmp_path / "a.dae").write_text("<svg/>")
    with pytest.raises(ModelError, match="not COLLADA"):
        imported(tmp_path / "a.dae", tmp_path / "out")
