"""What can be seen through: glTF 2.0, 3.9.4 (alpha coverage), and the extensions that let light through."""

from __future__ import annotations

import numpy as np
import pytest

from storage.base.errors import ModelError
from tests.jobs.importing.formats.gltf.test_gltf_file import png
from tests.jobs.importing.shapes import Glb, box, imported, total

#: A square in the texture's own coordinates: two triangles, the first below the diagonal.
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def surface(rgba=(1, 1, 1, 1), **more):
    return {"pbrMetallicRoughness": {"baseColorFactor": list(rgba)}, **more}


def with_texture(glb, pixels, sampler=None, **info):
    """An entry for a texture of some pixels (h, w, 4)."""
    glb.header.setdefault("images", []).append({"bufferView": glb.view(png(pixels))})
    texture = {"source": len(glb.header["images"]) - 1}
    if sampler is not None:
        glb.header.setdefault("samplers", []).append(sampler)
        texture["sampler"] = len(glb.header["samplers"]) - 1
    glb.header.setdefault("textures", []).append(texture)
    return {"index": len(glb.header["textures"]) - 1, **info}


def square(tmp_path, material, places=None, glb=None, **attributes):
    glb = glb or Glb()
    glb.header["materials"].append(material)
    if places is not None:
        attributes["TEXCOORD_0"] = np.array(places, "<f4")
    glb.node(mesh=glb.mesh(glb.primitive(SQUARE, FACES, material=0, **attributes)), name="pane")
    return imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")


def alphas(model):
    """Alpha of each triangle's corners, by the number that the triangle has in the file."""
    found = model.mesh(0)
    return dict(zip(found.source_faces.tolist(), found.colours[found.triangles][..., 3].tolist(), strict=True))


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        (surface((1, 1, 1, 0.15)), 255),  # OPAQUE is the default, and ignores alpha
        (surface((1, 1, 1, 0.15), alphaMode="OPAQUE"), 255),
        (surface((1, 1, 1, 0.15), alphaMode="BLEND"), 38),
        (surface((1, 1, 1, 1), alphaMode="BLEND"), 255),
        (surface((1, 1, 1, 0.5), alphaMode="MASK"), 255),  # the cutoff is 0.5 unless it is given
        (surface((1, 1, 1, 0.3), alphaMode="MASK", alphaCutoff=0.3), 255),
        (surface((1, 1, 1, 1), extensions={"KHR_materials_transmission": {"transmissionFactor": 1}}), 26),
        (surface((1, 1, 1, 1), extensions={"KHR_materials_transmission": {"transmissionFactor": 0.25}}), 191),
        (surface((1, 1, 1, 1), extensions={"KHR_materials_transmission": {}}), 255),
        (
            surface(
                (1, 1, 1, 0.5),
                alphaMode="BLEND",
                extensions={"KHR_materials_transmission": {"transmissionFactor": 0.5}},
            ),
            64,
        ),
        (
            surface(
                (1, 1, 1, 0.9), alphaMode="MASK", extensions={"KHR_materials_transmission": {"transmissionFactor": 1}}
            ),
            26,
        ),
        (
            {
                "alphaMode": "BLEND",
                "extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 1, 1, 0.4]}},
            },
            102,
        ),
        ({"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 1, 1, 0.4]}}}, 255),
    ],
)
def test_a_materials_alpha(tmp_path, material, expected):
    model = square(tmp_path, material)
    assert alphas(model) == {0: [expected] * 3, 1: [expected] * 3}
    assert model.report == {}


@pytest.mark.parametrize(
    "material",
    [
        surface((1, 1, 1, 0.2), alphaMode="MASK"),
        surface((1, 1, 1, 0), alphaMode="BLEND"),
        surface(alphaMode="MASK", alphaCutoff=1.5),
    ],
)
def test_what_is_not_drawn_is_left_out_and_told(tmp_path, material):
    with pytest.raises(ModelError, match=r"no triangle is left to draw .*2 invisible faces"):
        square(tmp_path, material)


def test_alpha_of_vertices_counts_where_the_material_blends(tmp_path):
    paint = np.full((4, 4), 255, "u1")
    paint[3, 3] = 51
    for mode, expected in (("BLEND", [254, 254, 51]), ("OPAQUE", [255] * 3), ("MASK", [187] * 3)):
        glb = Glb()
        paints = glb.accessor(paint, normalized=True)
        (tmp_path / mode).mkdir()
        found = alphas(square(tmp_path / mode, surface(alphaMode=mode), glb=glb, COLOR_0=paints))
        assert found == {0: [255] * 3, 1: expected}


def test_a_grating_is_seen_through_as_a_whole_and_its_frame_is_not(tmp_path):
    """A triangle whose texture has holes bears its mean alpha at vertices of its own; its neighbour stays opaque."""
    pixels = np.full((32, 32, 4), 255, np.uint8)
    pixels[:, :, 3] = np.where(np.indices((32, 32)).sum(axis=0) % 2, 255, 0)
    pixels[np.indices((32, 32))[1] > np.indices((32, 32))[0] - 1] = 255  # above the diagonal it is solid
    for mode in ("MASK", "BLEND"):
        glb = Glb()
        info = with_texture(glb, pixels)
        (tmp_path / mode).mkdir()
        material = {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorTexture": info}}
        found = alphas(square(tmp_path / mode, material, SQUARE[:, :2], glb))
        assert found[0] == [255] * 3
        assert len(set(found[1])) == 1
        assert abs(found[1][0] - 128) < 20


def test_one_hole_in_the_middle_of_a_wall_is_found(tmp_path):
    pixels = np.full((64, 64, 4), 255, np.uint8)
    pixels[40, 20, 3] = 0
    glb = Glb()
    material = {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": with_texture(glb, pixels)}}
    assert alphas(square(tmp_path, material, SQUARE[:, :2], glb)) == {0: [255] * 3, 1: [254] * 3}


def test_faces_below_the_cutoff_everywhere_are_left_out_and_keep_the_others_numbers(tmp_path):
    pixels = np.full((8, 16, 4), 255, np.uint8)
    pixels[:, :8, 3] = 100
    glb = Glb()
    material = {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": with_texture(glb, pixels)}}
    points = np.concatenate([SQUARE, SQUARE + np.array([2, 0, 0])])
    places = np.concatenate([SQUARE[:, :2] * [0.5, 1], SQUARE[:, :2] * [0.5, 1] + [0.5, 0]])
    glb.header["materials"].append(material)
    faces = np.concatenate([FACES, FACES + 4])
    glb.node(mesh=glb.mesh(glb.primitive(points, faces, material=0, TEXCOORD_0=places.astype("<f4"))), name="leaves")
    model = imported(glb.write(tmp_path / "a.glb"), tmp_path / "out")
    assert alphas(model) == {2: [255] * 3, 3: [255] * 3}
    assert model.report == {"invisible faces": {"total": 2, "parts": {"leaves": 2}}}


@pytest.mark.parametrize(
    ("wrap", "expected"), [({}, 255), ({"wrapS": 10497}, 255), ({"wrapS": 33071}, 128), ({"wrapS": 33648}, 128)]
)
def test_wrap_modes_decide_what_is_seen_beside_the_image(tmp_path, wrap, expected):
    """3.8.4.5: 10497 REPEAT (the default), 33071 CLAMP_TO_EDGE, 33648 MIRRORED_REPEAT; here beyond the right side."""
    pixels = np.zeros((4, 8, 4), np.uint8)
    pixels[:, :4] = [255, 0, 0, 255]
    pixels[:, 4:] = [0, 255, 0, 128]
    glb = Glb()
    info = with_texture(glb, pixels, wrap)
    material = {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorTexture": info}}
    model = square(tmp_path, material, SQUARE[:, :2] * [0.4, 1] + [1.05, 0], glb)
    assert alphas(model) == {0: [expected] * 3, 1: [expected] * 3}
    assert (model.colours[:, 0] == 255).all() == (expected == 255)
    assert (model.colours[:, 1] == 255).all() == (expected == 128)


def test_the_transforms_coordinate_set_goes_before_the_textures(tmp_path):
    """KHR_texture_transform: texCoord overrides the textureInfo's value."""
    pixels = np.zeros((1, 2, 4), np.uint8)
    pixels[0, 0], pixels[0, 1] = [255, 0, 0, 255], [0, 0, 255, 255]
    glb = Glb()
    transform = {"KHR_texture_transform": {"texCoord": 1, "offset": [0.5, 0]}}
    info = with_texture(glb, pixels, texCoord=0, extensions=transform)
    places = {"TEXCOORD_0": np.full((4, 2), 0.6, "<f4"), "TEXCOORD_1": np.full((4, 2), 0.2, "<f4")}
    model = square(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": info}}, glb=glb, **places)
    assert np.unique(model.colours, axis=0).tolist() == [[0, 0, 255, 255]]


def test_opaque_materials_show_the_colour_of_texels_that_would_be_invisible(tmp_path):
    pixels = np.zeros((16, 16, 4), np.uint8)
    pixels[..., 1] = 200
    glb = Glb()
    info = with_texture(glb, pixels)
    model = square(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": info}}, SQUARE[:, :2], glb)
    assert np.unique(model.colours, axis=0).tolist() == [[0, 200, 0, 255]]


def test_a_missing_picture_with_alpha_hides_nothing(tmp_path):
    """Whether the picture had holes is not known: the faces are there, and count as seen through."""
    for mode, expected in (("MASK", 254), ("BLEND", 254), ("OPAQUE", 255)):
        glb = Glb()
        glb.header |= {"images": [{"uri": "lost.png"}], "textures": [{"source": 0}]}
        (tmp_path / mode).mkdir()
        material = {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
        model = square(tmp_path / mode, material, SQUARE[:, :2], glb)
        assert alphas(model) == {0: [expected] * 3, 1: [expected] * 3}
        assert total(model, "missing textures") == 1


def test_a_transmission_texture_says_where_light_goes_through(tmp_path):
    """KHR_materials_transmission: the texture's red channel times the factor."""
    pixels = np.zeros((8, 16, 4), np.uint8)
    pixels[..., 3] = 255
    pixels[:, :8, 0] = 255
    glb = Glb()
    info = with_texture(glb, pixels)
    transmission = {"transmissionFactor": 0.5, "transmissionTexture": info}
    glb.header["materials"].append({"extensions": {"KHR_materials_transmission": transmission}})
    places = np.concatenate([SQUARE[:, :2] * [0.5, 1], SQUARE[:, :2] * [0.5, 1] + [0.5, 0]]).astype("<f4")
    points, faces = np.concatenate([SQUARE, SQUARE + np.array([2, 0, 0])]), np.concatenate([FACES, FACES + 4])
    glb.node(mesh=glb.mesh(glb.primitive(points, faces, material=0, TEXCOORD_0=places)))
    found = alphas(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out"))
    assert found == {0: [128] * 3, 1: [128] * 3, 2: [255] * 3, 3: [255] * 3}


@pytest.mark.parametrize(
    ("generator", "expected"), [("IfcOpenShell 0.8", 128), ("ifcopenshell 0.9.0.post1", 128), ("other", 188)]
)
def test_files_of_ifcopenshell_hold_srgb_factors(tmp_path, generator, expected):
    """3.9.2 means linear light: 0.5 is 188 of 255. IfcOpenShell writes the IFC file's sRGB value: 128."""
    glb = Glb()
    glb.header["asset"]["generator"] = generator
    model = square(tmp_path, surface((0.5, 0.5, 0.5, 1)), glb=glb)
    assert np.unique(model.colours, axis=0).tolist() == [[expected] * 3 + [255]]


def test_a_room_behind_glass(tmp_path):
    """Each part keeps its own alpha: walls are opaque, the pane is not, whatever primitive it shares a mesh with."""
    glb = Glb()
    glb.header["materials"] += [surface((0.7, 0.7, 0.7, 1)), surface((0.4, 0.6, 1, 0.15), alphaMode="BLEND")]
    wall, pane = glb.primitive(*box(), material=0), glb.primitive(SQUARE + np.array([0, 0, 2]), FACES, material=1)
    glb.node(mesh=glb.mesh(wall, pane))
    found = alphas(imported(glb.write(tmp_path / "a.glb"), tmp_path / "out"))
    assert {tuple(found[face]) for face in range(12)} == {(255, 255, 255)}
    assert {tuple(found[face]) for face in (12, 13)} == {(38, 38, 38)}
