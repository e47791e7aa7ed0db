"""Every format: what trimesh writes from arrays is what the import reads."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from tests.jobs.importing.shapes import canonical, corners_of, imported, terrain

FORMATS = ["glb", "gltf", "obj", "ply", "stl", "stl_ascii", "off", "dae"]


def exported(folder, name, mesh):
    """Write a trimesh mesh or scene into a folder; the path of the file to import."""
    suffix = {"stl_ascii": "stl"}.get(name, name)
    path = folder / f"model.{suffix}"
    data = mesh.export(file_type=name)
    if isinstance(data, dict):
        for file, content in data.items():
            (folder / file).write_bytes(content)
        return folder / "model.gltf"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


def plain(positions, triangles, **colours):
    return trimesh.Trimesh(positions, triangles, process=False, validate=False, **colours)


@pytest.mark.parametrize("name", FORMATS)
def test_surface_and_face_numbers_come_back(tmp_path, name):
    positions, triangles = terrain()
    model = imported(exported(tmp_path, name, plain(positions, triangles)), tmp_path / "out")
    assert model.report == {}
    assert np.allclose(canonical(corners_of(model)), canonical(positions[triangles]), atol=1e-7)
    mesh = model.mesh(0)
    assert np.allclose(mesh.positions[mesh.triangles], positions[triangles[mesh.source_faces]], atol=1e-7)
    assert mesh.source_faces.tolist() == list(range(len(triangles)))


@pytest.mark.parametrize("name", ["obj", "off", "ply", "stl_ascii"])
def test_far_coordinates_lose_nothing_in_text(tmp_path, name):
    positions, triangles = terrain()
    positions = np.round(positions, 3) + np.array([1e7, -2e7, 5e6])
    mesh = plain(positions, triangles)
    path = tmp_path / f"model.{name.removesuffix('_ascii')}"
    lines = {
        "obj": lambda: [
            *(f"v {x:.3f} {y:.3f} {z:.3f}" for x, y, z in positions),
            *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles),
        ],
        "off": lambda: [
            f"OFF\n{len(positions)} {len(triangles)} 0",
            *(f"{x:.3f} {y:.3f} {z:.3f}" for x, y, z in positions),
            *(f"3 {a} {b} {c}" for a, b, c in triangles),
        ],
        "ply": lambda: [
            "ply\nformat ascii 1.0",
            f"element vertex {len(positions)}\nproperty double x\nproperty double y\nproperty double z",
            f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header",
            *(f"{x:.3f} {y:.3f} {z:.3f}" for x, y, z in positions),
            *(f"3 {a} {b} {c}" for a, b, c in triangles),
        ],
        "stl_ascii": lambda: [mesh.export(file_type="stl_ascii")],
    }[name]()
    path.write_text("\n".join(lines) + "\n")
    model = imported(path, tmp_path / "out")
    assert np.abs(model.positions).max() < 10
    assert np.abs(canonical(corners_of(model)) - canonical(positions[triangles])).max() < 1e-8


def test_far_coordinates_lose_nothing_in_binary_ply(tmp_path):
    positions, triangles = terrain()
    positions += [1e7 + 0.1, -2e7, 5e6]
    header = (
        f"ply\nformat binary_big_endian 1.0\nelement vertex {len(positions)}\nproperty double x\nproperty double y\n"
        f"property double z\nelement face {len(triangles)}\nproperty list uchar int vertex_index\nend_header\n"
    )
    rows = np.zeros(len(triangles), [("n", "u1"), ("v", ">i4", 3)])
    rows["n"], rows["v"] = 3, triangles
    (tmp_path / "a.ply").write_bytes(header.encode() + positions.astype(">f8").tobytes() + rows.tobytes())
    model = imported(tmp_path / "a.ply", tmp_path / "out")
    assert np.array_equal(canonical(corners_of(model)), canonical(positions[triangles]))


@pytest.mark.parametrize("name", ["glb", "gltf", "ply"])
def test_vertex_colours_come_back(tmp_path, name):
    positions, triangles = terrain()
    colours = np.random.default_rng(1).integers(0, 256, (len(positions), 4)).astype(np.uint8)
    mesh = plain(positions, triangles, vertex_colors=colours)
    model = imported(exported(tmp_path, name, mesh), tmp_path / "out").mesh(0)
    expected = {tuple(p): tuple(c) for p, c in zip(positions.tolist(), colours.tolist(), strict=True)}
    assert all(
        expected[tuple(p)] == tuple(c) for p, c in zip(model.positions.tolist(), model.colours.tolist(), strict=True)
    )


def test_face_colours_of_a_ply_come_back(tmp_path):
    positions, triangles = terrain()
    colours = np.random.default_rng(1).integers(0, 256, (len(triangles), 4)).astype(np.uint8)
    mesh = plain(positions, triangles, face_colors=colours)
    model = imported(exported(tmp_path, "ply", mesh), tmp_path / "out").mesh(0)
    assert np.array_equal(model.colours[model.triangles], np.repeat(colours[model.source_faces][:, None], 3, axis=1))


@pytest.mark.parametrize("name", ["glb", "gltf", "obj", "ply"])
def test_normals_come_back(tmp_path, name):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    assert len(mesh.vertex_normals) == len(mesh.vertices)
    options = {"include_normals": True} if name == "obj" else {"vertex_normal": True} if name == "ply" else {}
    data = mesh.export(file_type=name, **options)
    path = tmp_path / f"model.{name}"
    for file, content in (data if isinstance(data, dict) else {path.name: data}).items():
        (tmp_path / file).write_bytes(content.encode() if isinstance(content, str) else content)
    model = imported(path, tmp_path / "out").mesh(0)
    outward = model.positions / np.linalg.norm(model.positions, axis=1)[:, None]
    assert np.abs(model.normals - outward).max() < 0.02
    assert np.allclose(np.linalg.norm(model.normals, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("name", ["glb", "gltf"])
def test_a_scene_keeps_its_hierarchy_and_instances(tmp_path, name):
    positions, triangles = terrain()
    scene = trimesh.Scene()
    scene.add_geometry(plain(positions, triangles), node_name="first", geom_name="hill")
    turn = trimesh.transformations.rotation_matrix(0.3, [1, 2, 3])
    inner = trimesh.transformations.translation_matrix([4, 5, 6])
    scene.graph.update("group", matrix=turn)
    scene.graph.update("second", "group", matrix=inner, geometry="hill")
    scene.graph.update("third", "group", matrix=np.diag([-2.0, 1, 1, 1]), geometry="hill")
    model = imported(exported(tmp_path, name, scene), tmp_path / "out")
    assert len(model.meshes) == 1
    assert {model.part_name(i) for i in range(3)} == {"first", "second", "third"}
    for part in model.parts:
        expected = {"first": np.eye(4), "second": turn @ inner, "third": turn @ np.diag([-2.0, 1, 1, 1])}
        assert np.allclose(part["matrix"], expected[model.names[part["name"]]][:3], atol=1e-12)


@pytest.mark.parametrize("name", FORMATS)
def test_importing_twice_gives_the_same_bytes(tmp_path, name):
    positions, triangles = terrain()
    path = exported(tmp_path, name, plain(positions, triangles))
    first, second = imported(path, tmp_path / "a"), imported(path, tmp_path / "b")
    assert first.digest == second.digest
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()
