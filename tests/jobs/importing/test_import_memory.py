"""The estimate of an import's memory is never below what the import takes, nor many times above."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from jobs.importing.import_memory import import_memory
from storage.base.errors import ModelError
from tests.jobs.importing.shapes import Glb, box, terrain

#: What an import may take beyond its estimate: modules that it loads, a part of what plans allow for the process.
MODULES = 48 << 20

#: Triangles of a side of the terrains: 180,000 of them.
SIDE = 301

IMPORT = """
import sys, tempfile
from pathlib import Path
import numpy
from jobs.importing.model import import_model
from jobs.running.memory import peak_memory, reset_peak
reset_peak()
before = peak_memory()
with tempfile.TemporaryDirectory() as folder:
    import_model([Path(sys.argv[1])], Path(folder) / "model")
print(peak_memory() - before)
"""


def mesh(soup):
    points, triangles = terrain(SIDE)
    return (points[triangles.reshape(-1)], np.arange(triangles.size).reshape(-1, 3)) if soup else (points, triangles)


def write_glb(path, soup):
    scene = Glb()
    scene.node(mesh=scene.mesh(scene.primitive(*mesh(soup))))
    scene.write(path)


def write_ply(path, soup):
    points, triangles = mesh(soup)
    faces = np.zeros(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_bytes(header.encode() + points.astype("<f4").tobytes() + faces.tobytes())


def write_stl(path, soup):
    points, triangles = mesh(soup)
    facets = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    facets["corners"] = points[triangles]
    path.write_bytes(bytes(80) + np.uint32(len(facets)).tobytes() + facets.tobytes())


def write_obj(path, soup):
    points, triangles = mesh(soup)
    with path.open("w") as file:
        np.savetxt(file, points, "v %.4f %.4f %.4f")
        np.savetxt(file, triangles + 1, "f %d %d %d")


def write_off(path, soup):
    points, triangles = mesh(soup)
    with path.open("w") as file:
        file.write(f"OFF\n{len(points)} {len(triangles)} 0\n")
        np.savetxt(file, points, "%.4f %.4f %.4f")
        np.savetxt(file, triangles, "3 %d %d %d")


@pytest.mark.slow
@pytest.mark.parametrize("soup", [False, True], ids=["shared vertices", "soup"])
@pytest.mark.parametrize("write", [write_glb, write_ply, write_stl, write_obj, write_off])
def test_imports_stay_below_their_estimate(tmp_path, write, soup):
    path = tmp_path / f"model.{write.__name__.removeprefix('write_')}"
    write(path, soup)
    done = subprocess.run([sys.executable, "-c", IMPORT, str(path)], check=True, capture_output=True, text=True)
    taken, estimate = int(done.stdout), import_memory([path])
    assert taken < estimate + MODULES
    assert estimate < 4 * taken + MODULES


def test_many_meshes_count_as_the_largest(tmp_path):
    sizes = []
    for count in (1, 50):
        scene = Glb()
        for _ in range(count):
            scene.node(mesh=scene.mesh(scene.primitive(*terrain(33))))
        sizes.append(import_memory([scene.write(tmp_path / f"{count}.glb")]))
    assert sizes[0] < sizes[1] < 2 * sizes[0]


def test_primitives_without_positions_count_nothing(tmp_path):
    estimates = []
    for extra in ([], [{"attributes": {}}]):
        scene = Glb()
        scene.node(mesh=scene.mesh(scene.primitive(*terrain(33)), *extra))
        estimates.append(import_memory([scene.write(tmp_path / "a.glb")]))
    assert 0 < estimates[0] < estimates[1] < estimates[0] + 1000  # a longer header


def test_the_largest_group_of_an_obj_counts_most(tmp_path):
    points, triangles = box()
    faces = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles.tolist()) * 2000
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in points.tolist())
    (tmp_path / "one.obj").write_text(f"{vertices}g all\n{faces}{faces}")
    (tmp_path / "two.obj").write_text(f"{vertices}g a\n{faces}g b\n{faces}")
    (tmp_path / "same.obj").write_text(f"{vertices}g a\n{faces}g b\ng a\n{faces}")
    one, two, same = (import_memory([tmp_path / f"{name}.obj"]) for name in ("one", "two", "same"))
    assert two < one == same


def test_the_largest_file_counts(tmp_path):
    write_obj(tmp_path / "b.obj", soup=False)
    alone = import_memory([tmp_path / "b.obj"])
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert import_memory([tmp_path]) == import_memory([tmp_path / "a.obj", tmp_path / "b.obj"]) == alone


@pytest.mark.parametrize("name", ["a.glb", "a.gltf", "a.ply", "a.stl", "a.obj"])
@pytest.mark.parametrize("content", [b"", b"glTF", b"{}", b"ply\n", bytes(range(256)) * 20])
def test_damaged_files_are_left_to_the_import(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    assert import_memory([tmp_path / name]) < 256 << 20


def test_missing_files_are_refused(tmp_path):
    with pytest.raises(ModelError, match=r"absent\.glb"):
        import_memory([tmp_path / "absent.glb"])
