"""glTF files damaged in every way: a model, or one clear line; never anything else."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.jobs.importing.formats.gltf.compressed import (
    DRACO,
    MESHOPT,
    compress_view,
    draco_primitive,
    placeholder,
)
from tests.jobs.importing.formats.gltf.test_gltf_file import png
from tests.jobs.importing.fuzzing import damaged, fuzz, swapped
from tests.jobs.importing.shapes import Glb, box, packed, terrain

#: Seconds for each way of damaging files.
SECONDS = 7.0


def everything() -> tuple[dict, bytes]:
    """The header and binary chunk of a file with one of all that is read."""
    glb = Glb()
    pixels = np.random.default_rng(2).integers(0, 256, (9, 7, 4)).astype(np.uint8)
    glb.header |= {"images": [{"bufferView": glb.view(png(pixels))}], "textures": [{"source": 0, "sampler": 0}]}
    glb.header["samplers"] = [{"wrapS": 33648, "wrapT": 33071}]
    transform = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [2, 3], "texCoord": 0}}
    texture = {"index": 0, "extensions": transform}
    transmission = {"KHR_materials_transmission": {"transmissionFactor": 0.5, "transmissionTexture": {"index": 0}}}
    glb.header["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": texture}, "alphaMode": "MASK", "alphaCutoff": 0.4},
        {
            "pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 0.5]},
            "alphaMode": "BLEND",
            "extensions": transmission,
        },
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 0, 0, 1]}}},
    ]
    positions, triangles = box()
    places = np.random.default_rng(3).random((8, 2)).astype("<f4")
    targets = [{"POSITION": glb.accessor(np.ones((8, 3), "<f4"))}]
    weights = np.ones((8, 4), "<f4")
    attributes = {"JOINTS_0": np.zeros((8, 4), "u1"), "WEIGHTS_0": weights, "TEXCOORD_0": places}
    figure = glb.primitive(positions, triangles, material=0, targets=targets, **attributes)
    glass = glb.primitive(positions, triangles, material=1, TEXCOORD_0=places, COLOR_0=np.ones((8, 4), "<f4"))
    strip = glb.primitive(positions, [0, 1, 2, 3, 4, 5], mode=5, material=2, NORMAL=np.ones((8, 3), "<f4"))
    sparse = glb.header["accessors"][glass["attributes"]["POSITION"]]
    sparse["sparse"] = {
        "count": 1,
        "indices": {"bufferView": glb.view(np.array([1], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": glb.view(np.array([[9, 9, 9]], "<f4").tobytes())},
    }
    points, faces = terrain(5)
    ground = glb.primitive(points, faces)
    compress_view(glb, ground["attributes"]["POSITION"], points.astype("<f4"), "ATTRIBUTES")
    compress_view(glb, ground["indices"], faces.reshape(-1).astype("<u4"), "TRIANGLES")
    joint = glb.node(translation=[1, 2, 3])
    bind = glb.accessor(np.eye(4, dtype="<f4").reshape(1, 16), type="MAT4")
    glb.header["skins"] = [{"joints": [joint], "inverseBindMatrices": bind}]
    glb.node(mesh=glb.mesh(figure, weights=[0.5]), skin=0, name="figure")
    glb.node(mesh=glb.mesh(glass, strip), matrix=np.eye(4).reshape(-1).tolist(), name="glass")
    places_of = {"TRANSLATION": glb.accessor(np.eye(3, dtype="<f4")), "SCALE": glb.accessor(np.ones((3, 3), "<f4"))}
    extension = {"EXT_mesh_gpu_instancing": {"attributes": places_of}}
    child = glb.node(root=False, mesh=glb.mesh(ground), extensions=extension, name="ground")
    moving = glb.node(children=[child], name="moving")
    sampler = {"input": glb.accessor(np.arange(2, dtype="<f4")), "output": glb.accessor(np.ones((2, 3), "<f4"))}
    channel = {"sampler": 0, "target": {"node": moving, "path": "translation"}}
    glb.header["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    glb.header |= {"extensionsUsed": [MESHOPT], "extensionsRequired": [MESHOPT, "EXT_mesh_gpu_instancing"]}
    return {**glb.header, "buffers": [{"byteLength": len(glb.data)}, placeholder()]}, glb.data


def in_draco() -> tuple[dict, bytes]:
    """The same of a file with a compressed mesh."""
    glb = Glb()
    glb.node(mesh=glb.mesh(draco_primitive(glb, *terrain(7))), name="ground")
    header = {**glb.header, "extensionsRequired": [DRACO], "buffers": [{"byteLength": len(glb.data)}]}
    return {key: value for key, value in header.items() if value != []}, glb.data


@pytest.mark.parametrize("of", [everything, in_draco])
def test_the_files_that_are_damaged_are_whole(tmp_path, of):
    header, data = of()
    counts = fuzz(tmp_path, "a.glb", lambda _: packed(json.dumps(header).encode(), data), 0.5, 0)
    assert counts["read"]
    assert not counts["refused"]


def test_bytes_flipped_cut_and_doubled(tmp_path):
    header, data = everything()
    whole = packed(json.dumps(header).encode(), data)
    counts = fuzz(tmp_path, "a.glb", lambda random: damaged(whole, random), SECONDS, 1)
    assert counts["refused"]


def test_values_of_the_header_swapped(tmp_path):
    header, data = everything()
    counts = fuzz(
        tmp_path, "a.glb", lambda random: packed(json.dumps(swapped(header, random)).encode(), data), SECONDS, 2
    )
    assert min(counts.values()) > 10


def test_damaged_binary_chunks(tmp_path):
    """Flipped bytes of the data alone, so that compressed streams, images and arrays are reached."""
    header, data = everything()
    text = json.dumps(header).encode()

    def make(random):
        work = bytearray(data)
        for place in random.integers(0, len(work), 30):
            work[place] = int(random.integers(0, 256))
        return packed(text, bytes(work))

    assert fuzz(tmp_path, "a.glb", make, SECONDS, 3)["refused"]


def test_damaged_draco_streams(tmp_path):
    header, data = in_draco()
    text = json.dumps(header).encode()
    length = header["bufferViews"][-1]["byteLength"]
    start = header["bufferViews"][-1]["byteOffset"]

    def make(random):
        stream = (damaged(data[start : start + length], random) + bytes(length))[:length]
        return packed(text, data[:start] + stream + data[start + length :])

    assert fuzz(tmp_path, "a.glb", make, SECONDS, 4)["refused"]
