"""What files mean that people's tools write: each line a file in words, where its format says so, and the right value.

The table goes over OBJ, PLY, OFF, STL and COLLADA. Values: the area of all triangles, the box, the alpha of the
triangles, their number, names, what is counted; or that the file is refused, and in which words.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, field

import numpy as np
import pytest
from PIL import Image

from storage.base.errors import ModelError
from tests.jobs.importing.shapes import corners_of, imported

#: A wall of 8 x 3 with a doorway of 2 x 2 as one outline, wound so that a fan closes the door; its area is 20.
DOOR = [(0, 0), (0, 3), (8, 3), (8, 0), (5, 0), (5, 2), (3, 2), (3, 0)]

#: A square of 4 x 4 with a hole of 2 x 2, joined to it by an edge there and back; its area is 12.
KEYHOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]

#: A dart whose second corner points inwards: a fan from its first corner turns a triangle over. Its area is 1.
DART = [(2, 0), (0.5, 0.5), (0, 2), (0, 0)]

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@dataclass(frozen=True)
class Case:
    """A file, and what it means."""

    words: str  # what the file is, and where its format says what it means
    files: dict[str, str | bytes]  # the first one is imported
    area: float | None = None
    alpha: list[int] | None = None  # of the triangles, sorted, each value once
    triangles: int | None = None
    names: tuple[str, ...] | None = None
    hi: tuple[float, float, float] | None = None
    colours: list[tuple[int, int, int]] | None = None  # of the triangles' first corners, sorted, each once
    counted: dict[str, int] = field(default_factory=dict)  # and nothing else
    refused: str | None = None  # part of the one line


def obj(points, z=0.0, plane=(0, 1, 2), head=""):
    rows = np.zeros((len(points), 3))
    rows[:, plane[0]], rows[:, plane[1]] = np.array(points, float).T
    rows[:, plane[2]] = z
    lines = "".join(f"v {x!r} {y!r} {w!r}\n" for x, y, w in rows.tolist())
    return head + lines + "f " + " ".join(str(i + 1) for i in range(len(points))) + "\n"


def ply(points, form="ascii", colours="", rows="", faces=None):
    faces = [range(len(points))] if faces is None else faces
    text = (
        f"ply\nformat {form} 1.0\nelement vertex {len(points)}\nproperty double x\nproperty double y\n"
        f"property double z\n{colours}element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    text += rows or "".join(f"{x} {y} 0\n" for x, y in points)
    return text + "".join(f"{len(face)} {' '.join(map(str, face))}\n" for face in faces)


def off(points, head="OFF"):
    rows = "".join(f"{x} {y} 0\n" for x, y in points)
    return f"{head}\n{len(points)} 1 0\n{rows}{len(points)} {' '.join(map(str, range(len(points))))}\n"


def dae(points, primitives, nodes=None, effect="", more="", geometries=""):
    flat = " ".join(f"{x} {y} 0" for x, y in points)
    uv = " ".join(f"{x} {y}" for x, y in points)
    instance = (
        '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="m" target="#mt"/>'
        "</technique_common></bind_material></instance_geometry>"
    )
    nodes = '<node id="n">{instance}</node>' if nodes is None else nodes
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        '<library_images><image id="im"><init_from>t.png</init_from></image></library_images>'
        '<library_effects><effect id="fx"><profile_COMMON><newparam sid="su"><surface type="2D">'
        "<init_from>im</init_from></surface></newparam>"
        '<newparam sid="sa"><sampler2D><source>su</source></sampler2D></newparam>'
        f'<technique sid="t"><lambert>{effect}</lambert></technique></profile_COMMON></effect></library_effects>'
        '<library_materials><material id="mt"><instance_effect url="#fx"/></material></library_materials>'
        f'<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa">{flat}</float_array>'
        '<technique_common><accessor source="#pa" stride="3"/></technique_common></source>'
        f'<source id="u"><float_array id="ua">{uv}</float_array><technique_common><accessor source="#ua" stride="2"/>'
        '</technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f"{primitives}</mesh></geometry>{geometries}</library_geometries>{more}"
        f'<library_visual_scenes><visual_scene id="s">{nodes.replace("{instance}", instance)}</visual_scene>'
        "</library_visual_scenes></COLLADA>"
    )


VERTEX = '<input semantic="VERTEX" source="#v" offset="0"/>'
UV = '<input semantic="TEXCOORD" source="#u" offset="0"/>'
TRIANGLE = [(0, 0), (1, 0), (0, 1)]
ONE = f'<triangles count="1" material="m">{VERTEX}<p>0 1 2</p></triangles>'
ONE_UV = f'<triangles count="1" material="m">{VERTEX}{UV}<p>0 1 2</p></triangles>'


def polylist(count):
    corners = " ".join(map(str, range(count)))
    return f"<polylist count='1'>{VERTEX}<vcount>{count}</vcount><p>{corners}</p></polylist>"


def transparent(inner, opaque=None, transparency=None):
    mode = "" if opaque is None else f' opaque="{opaque}"'
    factor = "" if transparency is None else f"<transparency><float>{transparency}</float></transparency>"
    return f"<diffuse><color>1 0 0 1</color></diffuse><transparent{mode}>{inner}</transparent>{factor}"


def picture(*alphas):
    """A picture one row high, grey, of those alphas."""
    file = io.BytesIO()
    Image.fromarray(np.array([[[90, 90, 90, alpha] for alpha in alphas]], np.uint8)).save(file, "PNG")
    return file.getvalue()


def grey(*levels):
    file = io.BytesIO()
    Image.fromarray(np.array([[[level] * 3 for level in levels]], np.uint8)).save(file, "PNG")
    return file.getvalue()


def textured(material):
    """Two textured triangles: one over the left of its picture, one over the right; and the library."""
    text = (
        "mtllib m.mtl\n" + SQUARE + "v 2 0 0\nvt 0.1 0.1\nvt 0.4 0.1\nvt 0.4 0.9\nvt 0.6 0.1\nvt 0.9 0.1\nvt 0.9 0.9\n"
    )
    return {"a.obj": text + "usemtl a\nf 1/1 2/2 3/3\nf 2/4 5/5 3/6\n", "m.mtl": "newmtl a\nKd 1 1 1\n" + material}


def painted(material, name="a", used="a"):
    return {"a.obj": f"mtllib m.mtl\n{SQUARE}usemtl {used}\nf 1 2 3\n", "m.mtl": f"newmtl {name}\nKd 1 0 0\n{material}"}


def skin(weights, joint="<translate>0 0 5</translate>", node="<translate>100 0 0</translate>", bind=""):
    """A triangle bound to one joint, under a node that must not move it."""
    controllers = (
        f'<library_controllers><controller id="c"><skin source="#g">{bind}'
        '<source id="j"><Name_array id="ja" count="1">bone</Name_array></source>'
        '<source id="i"><float_array id="ia">1 0 0 0 0 1 0 0 0 0 1 -1 0 0 0 1</float_array><technique_common>'
        '<accessor source="#ia" stride="16"/></technique_common></source><source id="w"><float_array id="wa">1 0.5'
        '</float_array><technique_common><accessor source="#wa" stride="1"/></technique_common></source>'
        '<joints><input semantic="JOINT" source="#j"/><input semantic="INV_BIND_MATRIX" source="#i"/></joints>'
        '<vertex_weights count="3"><input semantic="JOINT" source="#j" offset="0"/>'
        f'<input semantic="WEIGHT" source="#w" offset="1"/><vcount>1 1 1</vcount><v>{weights}</v></vertex_weights>'
        "</skin></controller></library_controllers>"
    )
    nodes = (
        f'<node id="b" sid="bone" type="JOINT">{joint}</node>'
        f'<node id="n">{node}<instance_controller url="#c"><skeleton>#b</skeleton></instance_controller></node>'
    )
    return dae(TRIANGLE, ONE, nodes, more=controllers)


def morph(method, weight):
    other = (
        '<geometry id="t"><mesh><source id="tp"><float_array id="tpa">0 0 4 1 0 4 0 1 4</float_array><technique_common>'
        '<accessor source="#tpa" stride="3"/></technique_common></source><vertices id="tv">'
        '<input semantic="POSITION" source="#tp"/></vertices></mesh></geometry>'
    )
    controllers = (
        f'<library_controllers><controller id="c"><morph source="#g" method="{method}">'
        '<source id="mt_"><IDREF_array id="ma">t</IDREF_array></source>'
        f'<source id="mw"><float_array id="mwa">{weight}</float_array><technique_common>'
        '<accessor source="#mwa" stride="1"/></technique_common></source><targets>'
        '<input semantic="MORPH_TARGET" source="#mt_"/><input semantic="MORPH_WEIGHT" source="#mw"/></targets></morph>'
        "</controller></library_controllers>"
    )
    return dae(TRIANGLE, ONE, '<node id="n"><instance_controller url="#c"/></node>', more=controllers, geometries=other)


def facet(*attributes, header=b"", trailing=b""):
    rows = np.zeros(len(attributes), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    for row, attribute in zip(range(len(rows)), attributes, strict=True):
        rows["v"][row] = [[row, 0, 0], [row + 1, 0, 0], [row, 1, 0]]
        rows["a"][row] = attribute
    return header.ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes() + trailing


FACET = "facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endfacet"
NOT_READ = "statements and elements that are not known"
LINES = "points, lines and other primitives without triangles"
FREE = "free-form curves and surfaces"
CROSSING = "outlines that cross themselves"

CASES = [
    # outlines
    *(
        Case(f"{kind}: a wall with a door, one concave outline ({where})", {f"a.{kind}": text}, area=20, triangles=6)
        for kind, where, text in (
            ("obj", "MTL/OBJ specification, f: a face is its outline", obj(DOOR)),
            ("ply", "Turk 1994, vertex_indices: the outline of a polygon", ply(DOOR)),
            ("off", "Geomview, OFF: faces may be concave", off(DOOR)),
            ("dae", "COLLADA 1.4.1, polylist", dae(DOOR, polylist(8))),
        )
    ),
    *(
        Case(
            f"obj: the same from its corner {k}, across the axes {plane} (OBJ, f)",
            {"a.obj": obj(DOOR[k:] + DOOR[:k], 7.0, plane)},
            area=20,
            triangles=6,
        )
        for k, plane in ((1, (0, 1, 2)), (4, (1, 2, 0)), (6, (2, 0, 1)))
    ),
    Case("obj: the same, the other way round (OBJ, f)", {"a.obj": obj(DOOR[::-1])}, area=20, triangles=6),
    Case("obj: a house with a hole joined by an edge there and back (OBJ, f)", {"a.obj": obj(KEYHOLE)}, area=12),
    Case("ply: the same (Turk 1994)", {"a.ply": ply(KEYHOLE)}, area=12),
    *(
        Case(
            f"obj: a dart from its corner {k}: only one diagonal is inside (OBJ, f)",
            {"a.obj": obj(DART[k:] + DART[:k])},
            area=1,
            triangles=2,
        )
        for k in range(4)
    ),
    Case("off: a dart (Geomview, OFF)", {"a.off": off(DART)}, area=1, triangles=2),
    Case(
        "obj: far from the origin nothing is lost (OBJ, f)",
        {"a.obj": obj([(x + 1e7, y) for x, y in DOOR])},
        area=20,
        triangles=6,
    ),
    Case(
        "obj: corners along an edge, and a spike without area (OBJ, f)",
        {"a.obj": obj([(0, 0), (1, 0), (3, 0), (2, 0), (2, 2), (0, 2)])},
        area=4,
        counted={"faces without area": 2},
    ),
    Case(
        "obj: a bow tie encloses nothing for certain, and is told (OBJ, f)",
        {"a.obj": obj([(0, 0), (2, 2), (2, 0), (0, 1)])},
        triangles=2,
        counted={CROSSING: 1},
    ),
    Case(
        "obj: a five-pointed star drawn in one go is told (OBJ, f)",
        {"a.obj": obj([(0, 3), (2, -3), (-3, 1), (3, 1), (-2, -3)])},
        counted={CROSSING: 1},
    ),
    Case(
        "obj: two squares that touch in a corner keep their area (OBJ, f)",
        {"a.obj": obj([(0, 0), (1, 1), (2, 1), (2, 2), (1, 2), (1, 1), (0, 1)])},
        area=1.5,
    ),
    Case(
        "dae: a wall with a window (COLLADA 1.4.1, ph and h)",
        {
            "a.dae": dae(
                [(0, 0), (8, 0), (8, 3), (0, 3), (3, 1), (5, 1), (5, 2), (3, 2)],
                f"<polygons>{VERTEX}<ph><p>0 1 2 3</p><h>4 5 6 7</h></ph></polygons>",
            )
        },
        area=22,
    ),
    Case(
        "dae: two windows, the outline and one hole the other way round, a plain polygon after (COLLADA, ph, p)",
        {
            "a.dae": dae(
                [(0, 0), (0, 3), (8, 3), (8, 0), (1, 1), (2, 1), (2, 2), (1, 2), (5, 1), (6, 1), (6, 2), (5, 2)],
                f"<polygons>{VERTEX}<ph><p>0 1 2 3</p><h>4 5 6 7</h><h>11 10 9 8</h></ph><p>4 5 6</p></polygons>",
            )
        },
        area=22.5,
    ),
    Case(
        "dae: a fan stays a fan whatever its outline (COLLADA 1.4.1, trifans)",
        {"a.dae": dae(DART, f"<trifans>{VERTEX}<p>0 1 2 3</p></trifans>")},
        area=3,
        triangles=2,
    ),
    # what can be seen through
    Case("obj: d (MTL, d: dissolve)", painted("d 0.4\n"), alpha=[102]),
    Case("obj: Tr is 1 - d (written by 3ds Max and others)", painted("Tr 0.25\n"), alpha=[191]),
    Case("obj: d and Tr that both say opaque (some write Tr as d): d wins", painted("Tr 1\nd 1\n"), alpha=[255]),
    Case("obj: d against Tr: d wins, whichever comes first", painted("d 0.8\nTr 0.8\n"), alpha=[204]),
    Case("obj: Tr 1 alone: nobody exports the invisible", painted("Tr 1.0\n"), alpha=[255]),
    Case("obj: d -halo (MTL, d -halo factor)", painted("d -halo 0.2\n"), alpha=[51]),
    Case(
        "obj: d 0 is not drawn, and told (MTL, d)",
        {
            "a.obj": f"mtllib m.mtl\n{SQUARE}usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n",
            "m.mtl": "newmtl a\nd 0\nnewmtl b\n",
        },
        triangles=1,
        alpha=[255],
        counted={"invisible faces": 1},
    ),
    Case(
        "obj: colours of vertices do not make a material opaque (MTL, d)",
        {
            "a.obj": "mtllib m.mtl\nusemtl a\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n",
            "m.mtl": "newmtl a\nd 0.4\n",
        },
        alpha=[102],
    ),
    Case(
        "obj: map_d by luminance, over the left only (MTL, map_d, -imfchan l)",
        {**textured("map_d t.png\n"), "t.png": grey(51, 255)},
        alpha=[51, 255],
    ),
    Case(
        "obj: map_d by the alpha of a picture that has one (what exporters mean)",
        {**textured("map_d t.png\n"), "t.png": picture(51, 255)},
        alpha=[51, 255],
    ),
    Case(
        "obj: map_d by a channel (MTL, -imfchan r)",
        {**textured("map_d -imfchan r t.png\n"), "t.png": picture(10, 255)},
        alpha=[90],
    ),
    Case(
        "obj: map_d times d (MTL, map_d)",
        {**textured("d 0.5\nmap_d t.png\n"), "t.png": grey(102, 255)},
        alpha=[51, 128],
    ),
    Case(
        "obj: a grating: the alpha of map_Kd where there is no map_d",
        {**textured("map_Kd t.png\n"), "t.png": picture(51, 51, 255, 255)},
        alpha=[51, 255],
    ),
    Case(
        "obj: what lies wholly where a picture is invisible is left out",
        {**textured("map_Kd t.png\n"), "t.png": picture(0, 0, 255, 255)},
        alpha=[255],
        triangles=1,
        counted={"invisible faces": 1},
    ),
    Case(
        "ply: alpha of vertices (property alpha)",
        {
            "a.ply": ply(
                TRIANGLE,
                colours="property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n",
                rows="0 0 0 9 9 9 40\n1 0 0 9 9 9 40\n0 1 0 9 9 9 40\n",
            )
        },
        alpha=[40],
    ),
    Case(
        "ply: an alpha of 0 everywhere says nothing",
        {
            "a.ply": ply(
                TRIANGLE,
                colours="property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n",
                rows="0 0 0 9 9 9 0\n1 0 0 9 9 9 0\n0 1 0 9 9 9 0\n",
            )
        },
        alpha=[255],
    ),
    Case(
        "off: alpha of faces (Geomview, OFF: RGBA)",
        {"a.off": "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 255 0 0 64\n3 0 2 3 0 255 0 255\n"},
        alpha=[64, 255],
        colours=[(0, 255, 0), (255, 0, 0)],
    ),
    *(
        Case(
            f"dae: {words} (COLLADA 1.4.1 and 1.5, transparent)",
            {"a.dae": dae(TRIANGLE, ONE, effect=effect)},
            alpha=[alpha],
        )
        for words, effect, alpha in (
            ("A_ONE: alpha is opacity", transparent("<color>1 1 1 0.2</color>", "A_ONE"), 51),
            ("A_ONE is the default, times transparency", transparent("<color>1 1 1 0.5</color>", None, 0.4), 51),
            ("A_ZERO: alpha is how much is seen through", transparent("<color>1 1 1 0.2</color>", "A_ZERO"), 204),
            ("RGB_ZERO: colour is how much is seen through", transparent("<color>.2 .2 .2 1</color>", "RGB_ZERO"), 204),
            ("RGB_ONE: colour is opacity", transparent("<color>.2 .2 .2 1</color>", "RGB_ONE"), 51),
            ("RGB_ZERO of black is opaque", transparent("<color>0 0 0 1</color>", "RGB_ZERO"), 255),
            ("transparency alone is opacity (SketchUp)", "<transparency><float>0.2</float></transparency>", 51),
            ("transparency 0 alone means opaque (old exporters)", "<transparency><float>0</float></transparency>", 255),
            ("alpha of diffuse says nothing", "<diffuse><color>1 0 0 0.5</color></diffuse>", 255),
        )
    ),
    Case(
        "dae: transparent as a texture, A_ONE (COLLADA 1.4.1, transparent)",
        {
            "a.dae": dae(TRIANGLE, ONE_UV, effect=transparent('<texture texture="sa" texcoord="x"/>')),
            "t.png": picture(51),
        },
        alpha=[51],
    ),
    Case(
        "dae: transparent as a texture, RGB_ZERO (COLLADA 1.4.1, transparent)",
        {
            "a.dae": dae(TRIANGLE, ONE_UV, effect=transparent('<texture texture="sa" texcoord="x"/>', "RGB_ZERO")),
            "t.png": grey(51),
        },
        alpha=[204],
    ),
    # where things are
    Case(
        "dae: lookat: at the eye, -z towards the point of interest (COLLADA 1.4.1, lookat)",
        {"a.dae": dae(TRIANGLE, ONE, "<node><lookat>100 0 0 100 -5 0 0 0 1</lookat>{instance}</node>")},
        hi=(100, 0, 1),
    ),
    Case(
        "dae: skew: z-ward by x (COLLADA 1.4.1, skew; RiSkew)",
        {"a.dae": dae(TRIANGLE, ONE, "<node><skew>45 1 0 0 0 0 1</skew>{instance}</node>")},
        hi=(1, 1, 1),
    ),
    Case(
        "dae: a transform that cannot be read takes its parts out, below it too",
        {
            "a.dae": dae(
                TRIANGLE,
                ONE,
                '<node id="w"><scale>2 2</scale><node id="x">{instance}</node></node><node id="y">{instance}</node>',
            )
        },
        triangles=1,
        names=("y/g",),
        counted={"parts left out for a transform that cannot be read": 1},
    ),
    Case(
        "dae: nodes 3,000 deep (COLLADA 1.4.1, node: no limit)",
        {"a.dae": dae(TRIANGLE, ONE, "<node><translate>1 0 0</translate>" * 3000 + "{instance}" + "</node>" * 3000)},
        hi=(3001, 1, 0),
    ),
    Case(
        "dae: a library node instanced twice below itself is no circle",
        {
            "a.dae": dae(
                TRIANGLE,
                ONE,
                '<node><instance_node url="#l"/><node><instance_node url="#l"/></node></node>',
                more='<library_nodes><node id="l">{instance}</node></library_nodes>'.replace(
                    "{instance}", '<instance_geometry url="#g"/>'
                ),
            )
        },
        triangles=2,
        counted={"unknown materials": 2},
    ),
    Case(
        "dae: a circle through two nodes is refused (COLLADA 1.4.1, instance_node)",
        {
            "a.dae": dae(
                TRIANGLE,
                ONE,
                '<node><instance_node url="#l"/></node>',
                more='<library_nodes><node id="l"><instance_node url="#k"/></node>'
                '<node id="k"><instance_node url="#l"/></node></library_nodes>',
            )
        },
        refused="contain itself",
    ),
    Case(
        "dae: a skin is where its joint is, not its node (COLLADA 1.4.1, chapter 4, skinning)",
        {"a.dae": skin("0 0 0 0 0 0")},
        hi=(1, 1, 4),
        counted={"unknown materials": 1},
    ),
    Case(
        "dae: the bind shape matrix comes first (COLLADA 1.4.1, bind_shape_matrix)",
        {"a.dae": skin("0 0 0 0 0 0", bind="<bind_shape_matrix>2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix>")},
        hi=(2, 1, 4),
        counted={"unknown materials": 1},
    ),
    Case(
        "dae: a skin whose weights name no joint stays at rest, and is told",
        {"a.dae": skin("7 0 0 0 0 0")},
        hi=(101, 1, 0),
        counted={"unsupported features": 1, "unknown materials": 1},
    ),
    Case(
        "dae: a morph at its saved weight, mixed (COLLADA 1.4.1, morph NORMALIZED)",
        {"a.dae": morph("NORMALIZED", 0.25)},
        hi=(1, 1, 1),
        counted={"unknown materials": 1},
    ),
    Case(
        "dae: a morph at its saved weight, added (COLLADA 1.4.1, morph RELATIVE)",
        {"a.dae": morph("RELATIVE", 0.25)},
        hi=(1.25, 1.25, 1),
        counted={"unknown materials": 1},
    ),
    # nothing is lost without a word
    Case(
        "obj: a patch, a curve, a line, points, an unknown word (OBJ, free-form; counted by part)",
        {
            "a.obj": SQUARE
            + "o roof\ncstype bezier\ndeg 3 3\nsurf 0 1 0 1 1 2 \\\n3 4\nparm u 0 1\nend\ncurv 0 1 1 2\n"
            "l 1 2\np 1\nwibble 3\nf 1 2 3\n"
        },
        triangles=1,
        counted={FREE: 2, LINES: 2, NOT_READ: 1},
    ),
    Case("obj: fo is an old f (OBJ, superseded statements)", {"a.obj": SQUARE + "fo 1 2 3\n"}, triangles=1),
    Case("obj: a byte-order mark before the first word", {"a.obj": b"\xef\xbb\xbf" + obj(DART).encode()}, area=1),
    Case(
        "obj: names that are not UTF-8 stay two",
        {"a.obj": SQUARE.encode() + b"g \xe9\nf 1 2 3\ng \xe8\nf 1 3 4\n"},
        names=("\\xe9", "\\xe8"),
    ),
    Case(
        "obj: a library in other letters, the only one",
        {"a.obj": f"mtllib Roof.MTL\n{SQUARE}usemtl red\nf 1 2 3\n", "roof.mtl": "newmtl Red\nKd 1 0 0\n"},
        colours=[(255, 0, 0)],
    ),
    Case(
        "obj: two libraries in other letters are none",
        {
            "a.obj": f"mtllib ROOF.mtl\n{SQUARE}usemtl red\nf 1 2 3\n",
            "roof.mtl": "newmtl red\nKd 1 0 0\n",
            "Roof.mtl": "newmtl red\nKd 0 1 0\n",
        },
        counted={"missing material libraries": 1},
    ),
    Case(
        "obj: a library whose name is Western European bytes",
        {
            "a.obj": b"mtllib caf\xe9.mtl\n" + SQUARE.encode() + b"usemtl red\nf 1 2 3\n",
            "café.mtl": "newmtl red\nKd 1 0 0\n",
        },
        colours=[(255, 0, 0)],
    ),
    Case(
        "mtl: a byte-order mark, a continued line",
        {"a.obj": f"mtllib m.mtl\n{SQUARE}usemtl red\nf 1 2 3\n", "m.mtl": b"\xef\xbb\xbfnewmtl red\nKd 1 \\\n0 0\n"},
        colours=[(255, 0, 0)],
    ),
    Case(
        "obj: colours of vertices up to 255",
        {"a.obj": "v 0 0 0 255 0 0\nv 1 0 0 255 0 0\nv 0 1 0 255 0 0\nf 1 2 3\n"},
        colours=[(255, 0, 0)],
    ),
    Case(
        "ply: colours as floats up to 255",
        {
            "a.ply": ply(
                TRIANGLE,
                colours="property float red\nproperty float green\nproperty float blue\n",
                rows="0 0 0 255 0 51\n1 0 0 255 0 51\n0 1 0 255 0 51\n",
            )
        },
        colours=[(255, 0, 51)],
    ),
    Case(
        "ply: strips of triangles, -1 begins a new one (tristrips, as Stanford's scans have them)",
        {
            "a.ply": ply([(0, 0), (1, 0), (0, 1), (1, 1), (0, 2)], faces=[]).replace(
                "end_header", "element tristrips 1\nproperty list int int vertex_indices\nend_header"
            )
            + "8 0 1 2 3 -1 2 3 4\n"
        },
        area=1.5,
        triangles=3,
    ),
    Case(
        "ply: edges and other elements are counted (Turk 1994, edge)",
        {
            "a.ply": ply(TRIANGLE).replace(
                "end_header",
                "element edge 2\nproperty int vertex1\nproperty int vertex2\nelement odd 1\n"
                "property list uchar int vertex_indices\nend_header",
            )
            + "0 1\n1 2\n2 0 1\n"
        },
        triangles=1,
        counted={LINES: 2, "unsupported features": 1},
    ),
    Case(
        "ply: end_header in a comment, blanks after the real one, a mark before all",
        {
            "a.ply": "\ufeff"
            + ply(DART)
            .replace("format ascii 1.0", "format ascii 1.0\ncomment end_header")
            .replace("end_header\n0", "end_header \n0")
            .replace("indices\nend_header\n", "indices\nend_header \t\n")
        },
        area=1,
    ),
    Case(
        "off: no first word (Geomview, OFF: the header may be left out)",
        {"a.off": off(DART).removeprefix("OFF\n")},
        area=1,
    ),
    Case("off: all on one line", {"a.off": off(DART).replace("\n", " ")}, area=1),
    Case("off: a number a line", {"a.off": off(DART).replace(" ", "\n")}, area=1),
    Case("off: no count of edges", {"a.off": off(DART).replace("4 1 0", "4 1")}, area=1),
    Case(
        "off: homogeneous coordinates (Geomview, 4OFF)",
        {"a.off": "4OFF\n3 1 0\n0 0 0 2\n4 0 0 2\n0 4 0 2\n3 0 1 2\n"},
        area=2,
    ),
    Case(
        "off: dimensions, where three (Geomview, nOFF)",
        {"a.off": "nOFF 3\n3 1 0\n0 0 0\n2 0 0\n0 2 0\n3 0 1 2\n"},
        area=2,
    ),
    Case(
        "off: normals, colours and texture coordinates (Geomview, STCNOFF: normals, colours, texture)",
        {
            "a.off": "STCNOFF\n3 1 0\n0 0 0 0 0 1 1 0 0 1 9 9\n1 0 0 0 0 1 1 0 0 1 9 9\n"
            "0 1 0 0 0 1 1 0 0 1 9 9\n3 0 1 2\n"
        },
        area=0.5,
        colours=[(255, 0, 0)],
    ),
    Case(
        "off: colours by number in a map are counted (Geomview, OFF colorspec)",
        {"a.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 5\n"},
        triangles=1,
        counted={"unsupported features": 1},
    ),
    Case(
        "off: colours of some faces only",
        {"a.off": "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 1.0 0 0\n3 0 2 3\n"},
        colours=[(204, 204, 204), (255, 0, 0)],
    ),
    Case(
        "stl: colours (VisCAM and SolidView: bit 15 set, blue in the lowest bits)",
        {"a.stl": facet(0x8000 | 31, 0)},
        colours=[(0, 0, 255), (204, 204, 204)],
    ),
    Case(
        "stl: colours (Magics: COLOR= for all, bit 15 clear, red in the lowest bits)",
        {"a.stl": facet(0x8000, 31, header=b"COLOR=\x00\xff\x00\x80")},
        colours=[(0, 255, 0), (255, 0, 0)],
        alpha=[128, 255],
    ),
    Case(
        "stl: bytes after the last facet are counted",
        {"a.stl": facet(0, 0, trailing=b"\0\0end")},
        triangles=2,
        counted={"bytes after the last facet": 5},
    ),
    Case(
        "stl: facets that are not counted are a damage", {"a.stl": facet(0, 0, trailing=bytes(50))}, refused="cut short"
    ),
    Case(
        "stl: keywords in names",
        {
            "a.stl": f"solid vertex of the endsolid facet\n{FACET}\nendsolid vertex facet\n"
            f"solid my solid\n{FACET.replace('1', '2')}\nendsolid\n"
        },
        triangles=2,
        names=("vertex of the endsolid facet", "my solid"),
    ),
    Case(
        "stl: all on one line, a mark before it",
        {"a.stl": f"\ufeffsolid a b {FACET} endsolid a b"},
        triangles=1,
        names=("a b",),
    ),
    Case(
        "dae: blanks before the first word, zeros after the last",
        {"a.dae": f"\n {dae(TRIANGLE, ONE)}\0\0\n"},
        triangles=1,
    ),
    # sides
    Case(
        "obj: two faces in one place, back to back: both sides of one are drawn, one is enough",
        {"a.obj": SQUARE + "f 1 2 3\nf 3 2 1\n"},
        triangles=1,
        counted={"duplicate faces of opposite winding": 1},
    ),
    Case(
        "obj: two faces in one place, back to back, with a colour each: the earlier one's shows on both sides",
        {
            "a.obj": f"mtllib m.mtl\n{SQUARE}usemtl a\nf 1 2 3\nusemtl b\nf 3 2 1\n",
            "m.mtl": "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 0 1\n",
        },
        triangles=1,
        colours=[(255, 0, 0)],
        counted={"faces left out that show another colour to the other side": 1},
    ),
]


@pytest.mark.parametrize("case", CASES, ids=[case.words for case in CASES])
def test_what_a_file_means(tmp_path, case):
    for name, content in case.files.items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    file = tmp_path / next(iter(case.files))
    if case.refused is not None:
        with pytest.raises(ModelError, match=case.refused) as caught:
            imported(file, tmp_path / "out")
        assert "\n" not in str(caught.value)
        return
    model = imported(file, tmp_path / "out")
    corners = corners_of(model)
    tints = np.concatenate(
        [model.mesh(i).colours[model.mesh(i).triangles] for i in model.parts["mesh"].tolist()]
    )  # (t, 3, 4)
    counted = {defect: counts["total"] for defect, counts in model.report.items()}
    assert {k: n for k, n in counted.items() if k != "unknown materials"} == {
        k: n for k, n in case.counted.items() if k != "unknown materials"
    }
    if case.area is not None:
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert np.linalg.norm(sides, axis=1).sum() / 2 == pytest.approx(case.area, rel=1e-9)
    if case.alpha is not None:
        assert (tints[:, 1:, 3] == tints[:, :1, 3]).all()
        assert np.unique(tints[..., 3]).tolist() == case.alpha
    if case.triangles is not None:
        assert model.triangle_count == case.triangles
    if case.names is not None:
        assert model.names == case.names
    if case.hi is not None:
        assert corners.max(axis=(0, 1)) == pytest.approx(case.hi, abs=1e-9)
    if case.colours is not None:
        assert sorted({tuple(colour) for colour in tints[:, 0, :3].tolist()}) == case.colours


@pytest.mark.parametrize("far", [1e5, 1e7, 1e9])
@pytest.mark.parametrize("alone", [True, False], ids=["a part of its own", "within a part"])
def test_one_stray_triangle_costs_a_house_nothing(tmp_path, far, alone):
    """The model is bit for bit what it is without the triangle; with `keep_far` it is there."""
    boxes = "".join(
        f"v {x} {y} {z}\n"
        for k in range(3)
        for x, y, z in [(3.3 * k + i % 2, i // 2 % 2, i // 4 % 2) for i in range(8)]
    )
    house = "".join(
        f"f {8 * k + a} {8 * k + b} {8 * k + c} {8 * k + d}\n"
        for k in range(3)
        for a, b, c, d in [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    )
    stray = f"v {far} 0 0\nv {far} 1 0\nv {far} 0 1\n" + ("o stray\n" if alone else "") + "f -3 -2 -1\n"
    models = {}
    for name, text in (("without", boxes + house), ("with", boxes + house + stray)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.obj").write_text(text)
        models[name] = imported(tmp_path / name / "a.obj", tmp_path / f"out {name}")
    assert models["with"].digest == models["without"].digest
    (reason,) = models["with"].report
    assert reason == ("parts far from all else" if alone else "faces far from all else")
    whole = imported(tmp_path / "with" / "a.obj", tmp_path / "whole", keep_far=True)
    assert (whole.triangle_count, whole.hi[0] + whole.origin[0]) == (37, far)


def test_a_model_whose_bulk_is_spread_keeps_everything(tmp_path):
    """Two houses a thousand kilometres apart, and a chain of houses each ten times as far as the last."""
    for name, places in (("two", [0, 1e6]), ("chain", [10.0**k for k in range(8)])):
        lines = []
        for number, place in enumerate(places):
            lines += [f"v {place + x} {y} 0\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
            lines.append(
                "".join(f"f {4 * number + 1} {4 * number + a} {4 * number + b}\n" for a, b in ((2, 3), (3, 4)))
            )
        (tmp_path / f"{name}.obj").write_text("".join(lines))
        model = imported(tmp_path / f"{name}.obj", tmp_path / name)
        assert model.triangle_count == 2 * len(places)
        assert model.report == {}
