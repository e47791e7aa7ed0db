"""An import holds one mesh at a time, and what it writes is what an import of everything at once would write."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from jobs.importing.join import join_scenes
from jobs.importing.keeping.saved import MeshView
from jobs.importing.keeping.spool import Spool
from jobs.importing.model import Part, import_model, open_model, write_model
from jobs.importing.read import find_files, read_scene
from jobs.importing.reading.content import ContentPart, FileContent, HeldContent
from tests.jobs.importing.shapes import Glb, box, imported, terrain

#: What imports gave when models were held whole.
DIGESTS = {
    "glb": "58adac966e6787092b4ed4e0a91621c977acddf3ed862cb8cfc416ac8d584fde",
    "obj": "d831b59f1f47081ef8e8cc2f5c9e7b78443c51b123f88ce2f7d266184bef05c3",
}


def write_terrains(path, count, faraway=0.0):
    """A GLB of `count` different terrains of 8,192 triangles, two placements of each third."""
    scene = Glb()
    parts = []
    for number in range(count):
        points, triangles = terrain(65, seed=number)
        scene.data, data = b"", scene.data
        parts.append(data)
        start = sum(map(len, parts))
        primitive = scene.primitive(points, triangles, NORMAL=np.tile(np.array([[0, 0, 1]], "<f4"), (len(points), 1)))
        for view in scene.header["bufferViews"][-3:]:
            view["byteOffset"] += start
        mesh = scene.mesh(primitive)
        for copy in range(1 + (number % 3 == 0)):
            scene.node(mesh=mesh, name=f"{number}", translation=[100.0 * number + faraway, 0, 100.0 * copy])
    scene.data = b"".join([*parts, scene.data])
    return scene.write(path)


def write_groups(path):
    """An OBJ of some boxes, each a group."""
    with path.open("w") as file:
        for number in range(20):
            points, triangles = box(1.0 + number, (3.0 * number, 0, 0))
            file.writelines(f"v {x} {y} {z}\n" for x, y, z in points.tolist())
            file.write(f"g box {number}\n")
            first = 8 * number + 1
            file.writelines(f"f {a + first} {b + first} {c + first}\n" for a, b, c in triangles.tolist())
    return path


def peak_of_import(path, out):
    tracemalloc.start()
    try:
        import_model([path], out)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_depends_on_the_largest_mesh_and_not_on_the_file(tmp_path):
    small, large = write_terrains(tmp_path / "small.glb", 6), write_terrains(tmp_path / "large.glb", 60)
    import_model([small], tmp_path / "warm")
    few = peak_of_import(small, tmp_path / "few")
    many = peak_of_import(large, tmp_path / "many")
    arrays = sum(path.stat().st_size for path in (tmp_path / "many").glob("*.npy"))
    assert large.stat().st_size > 9 * small.stat().st_size
    assert many < 1.15 * few
    assert many < arrays / 2


@pytest.mark.parametrize("faraway", [0.0, 1e7])
def test_the_same_bytes_as_with_all_meshes_held(tmp_path, faraway):
    inputs = [write_terrains(tmp_path / "terrains.glb", 7, faraway), write_groups(tmp_path / "boxes.obj")]
    import_model(inputs, tmp_path / "streamed")
    meshes: list[MeshView] = []
    files = find_files(inputs)
    scenes = [read_scene(file, root) for file, root in files]
    joined = join_scenes([file for file, _ in files], scenes, None, None, meshes.append)
    write_model(
        tmp_path / "held", meshes, joined.parts, up=joined.up, unit_in_metres=joined.unit_in_metres,
        report=joined.tally.report(),
    )  # fmt: skip
    names = sorted(path.name for path in (tmp_path / "held").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "streamed").iterdir())
    for name in names:
        assert (tmp_path / "streamed" / name).read_bytes() == (tmp_path / "held" / name).read_bytes(), name


def test_digests_stay_as_they_were(tmp_path):
    """Of models made of whole numbers: what an import gives has not changed since models were held whole."""
    scene = Glb()
    points, triangles = box(2.0)
    mesh = scene.mesh(scene.primitive(points, triangles))
    other = scene.mesh(scene.primitive(points * 3, triangles), scene.primitive(points - 5, triangles[:7]))
    scene.node(mesh=mesh, name="a", translation=[1000, 0, 0])
    scene.node(mesh=mesh, name="b", scale=[-1, 1, 1])
    scene.node(mesh=other, name="c", scale=[1, 2, -1])
    assert imported(scene.write(tmp_path / "a.glb"), tmp_path / "a").digest == DIGESTS["glb"]
    assert imported(write_groups(tmp_path / "b.obj"), tmp_path / "b").digest == DIGESTS["obj"]


def test_a_failed_import_leaves_nothing_behind(tmp_path):
    path = write_terrains(tmp_path / "model.glb", 3)
    (tmp_path / "other.obj").write_text("v 0 0 0\n")
    with pytest.raises(ValueError, match="no triangles"):
        import_model([path, tmp_path / "other.obj"], tmp_path / "out" / "model")
    assert list((tmp_path / "out").iterdir()) == []


def test_textures_that_are_not_kept_give_the_same_colours(tmp_path, monkeypatch):
    from tests.jobs.importing.formats.gltf.test_gltf_file import png

    scene = Glb()
    scene.header["images"], scene.header["textures"] = [], []
    for number in range(4):
        pixels = np.full((4, 4, 4), 60 * number + 10, np.uint8)
        pixels[..., 3] = 255
        scene.header["images"].append({"bufferView": scene.view(png(pixels)), "mimeType": "image/png"})
        scene.header["textures"].append({"source": number})
        scene.header["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}})
    points, triangles = box()
    for number in (0, 1, 2, 3, 0, 2):
        places = np.zeros((len(points), 2), "<f4")
        mesh = scene.mesh(scene.primitive(points + number, triangles, TEXCOORD_0=places, material=number))
        scene.node(mesh=mesh)
    path = scene.write(tmp_path / "model.glb")
    kept = imported(path, tmp_path / "kept")
    monkeypatch.setattr("jobs.importing.formats.gltf.textures.TEXTURES_KEPT", 0)
    assert imported(path, tmp_path / "dropped").digest == kept.digest
    assert len(np.unique(kept.colours, axis=0)) == 4


def test_meshes_come_back_from_a_spool_in_any_order(tmp_path):
    meshes = [MeshView.of(*terrain(n)) for n in (3, 9, 4)]
    with Spool(tmp_path) as spool:
        for mesh in meshes:
            spool.add(mesh)
        assert len(spool) == 3
        for number in (2, 0, 1, 1, -1):
            found = spool[number]
            for name, array in vars(meshes[number]).items():
                np.testing.assert_array_equal(getattr(found, name), array)
                assert getattr(found, name).dtype == array.dtype
        assert [len(mesh.triangles) for mesh in spool] == [8, 128, 18]
        with pytest.raises(IndexError):
            spool[3]


def test_meshes_that_are_placed_nowhere_take_no_row(tmp_path):
    meshes = [MeshView.of(*terrain(n)) for n in (3, 9, 4)]
    parts = [Part(2, "c", np.eye(3, 4)), Part(0, "a", np.eye(3, 4)), Part(2, "c", np.eye(3, 4) * 2)]
    write_model(tmp_path / "m", meshes, parts)
    model = open_model(tmp_path / "m")
    assert model.meshes["triangles"].tolist() == [8, 18]
    assert model.parts["mesh"].tolist() == [1, 0, 1]
    assert model.triangle_count == 8 + 2 * 18


def test_parts_of_content(tmp_path):
    (tmp_path / "file").write_bytes(b"0123456789")
    for content in (FileContent(tmp_path / "file"), HeldContent(b"0123456789")):
        assert content.size == 10
        assert content.part(2, 5) == b"234"
        assert content.part(8, 99) == b"89"
        part = ContentPart(content, 3, 4)
        assert (part.size, part.part(0, 2), part.part(2, 99)) == (4, b"34", b"56")
