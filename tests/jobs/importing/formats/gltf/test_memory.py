"""The estimate of an import's memory holds for compressed, posed and see-through meshes, and for many instances."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from jobs.importing.formats.gltf.draco import decoder_memory
from jobs.importing.import_memory import import_memory
from tests.jobs.importing.formats.gltf.compressed import compress_view, draco_primitive, placeholder
from tests.jobs.importing.formats.gltf.test_gltf_file import png
from tests.jobs.importing.shapes import Glb, box, terrain
from tests.jobs.importing.test_import_memory import IMPORT, MODULES, SIDE


def in_draco(glb):
    glb.node(mesh=glb.mesh(draco_primitive(glb, *terrain(SIDE))))


def in_meshopt(glb):
    points, triangles = terrain(SIDE)
    primitive = glb.primitive(points, triangles)
    compress_view(glb, primitive["attributes"]["POSITION"], points.astype("<f4"), "ATTRIBUTES")
    compress_view(glb, primitive["indices"], triangles.reshape(-1).astype("<u4"), "TRIANGLES")
    glb.header["buffers"] = [placeholder()]
    glb.node(mesh=glb.mesh(primitive))


def posed(glb):
    points, triangles = terrain(SIDE)
    weights = np.ones((len(points), 4), "<f4")
    attributes = {"JOINTS_0": np.zeros((len(points), 4), "u1"), "WEIGHTS_0": weights}
    targets = [{"POSITION": glb.accessor(points.astype("<f4"))}]
    glb.header["skins"] = [{"joints": [glb.node()]}]
    mesh = glb.mesh(glb.primitive(points, triangles, targets=targets, **attributes), weights=[1])
    glb.node(mesh=mesh, skin=0)


def see_through(glb):
    points, triangles = terrain(SIDE)
    pixels = np.random.default_rng(1).integers(0, 256, (1024, 1024, 4)).astype(np.uint8)
    glb.header |= {"images": [{"bufferView": glb.view(png(pixels))}], "textures": [{"source": 0}]}
    material = {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    glb.header["materials"].append(material)
    places = (points[:, :2] / SIDE).astype("<f4")
    glb.node(mesh=glb.mesh(glb.primitive(points, triangles, material=0, TEXCOORD_0=places)))


def instanced(glb):
    mesh = glb.mesh(glb.primitive(*box()))
    places = np.random.default_rng(1).random((100_000, 3)).astype("<f4")
    attributes = {"TRANSLATION": glb.accessor(places)}
    glb.node(mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})


@pytest.mark.slow
@pytest.mark.parametrize("fill", [in_draco, in_meshopt, posed, see_through, instanced])
def test_imports_stay_below_their_estimate(tmp_path, fill):
    glb = Glb()
    fill(glb)
    path = glb.write(tmp_path / "a.glb")
    done = subprocess.run([sys.executable, "-c", IMPORT, str(path)], check=True, capture_output=True, text=True)
    taken, estimate = int(done.stdout), import_memory([path])
    assert taken < estimate + MODULES
    decoder = decoder_memory(SIDE**2, 2 * SIDE**2, path.stat().st_size) if fill is in_draco else 0  # not this process
    assert estimate < 5 * taken + MODULES + decoder
