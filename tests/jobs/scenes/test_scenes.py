"""Demo scenes as files: size, determinism, structure, memory, and what is refused."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from jobs.scenes import KINDS, viewpoints, write_scene
from storage.base.errors import ParameterError, VlodError
from tests.jobs.scenes.glb_reader import Glb

SIZES = (20_000, 100_000)


@pytest.fixture(scope="module", params=KINDS)
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Glb:
    path = tmp_path_factory.mktemp("scenes") / f"{request.param}.glb"
    write_scene(request.param, path, 100_000, seed=3)
    return Glb(path)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("triangles", SIZES)
def test_size_is_met_and_reported(kind: str, triangles: int, tmp_path: Path) -> None:
    path = tmp_path / "scene.glb"
    record = write_scene(kind, path, triangles, seed=1)
    glb = Glb(path)
    assert abs(record.triangles - triangles) <= 0.03 * triangles
    assert record.triangles == glb.expanded_triangles()
    assert record.unique_triangles == sum(glb.mesh_triangles())
    assert (record.nodes, record.meshes) == (len(glb.json["nodes"]), len(glb.json["meshes"]))
    assert record.bytes == path.stat().st_size
    assert (record.kind, record.seed) == (kind, 1)
    assert [each.name for each in tmp_path.iterdir()] == ["scene.glb"]


@pytest.mark.parametrize("kind", KINDS)
def test_same_arguments_same_bytes(kind: str, tmp_path: Path) -> None:
    digests = []
    for name, seed in (("a", 7), ("b", 7), ("c", 8)):
        write_scene(kind, tmp_path / f"{name}.glb", 40_000, seed=seed)
        digests.append(hashlib.sha256((tmp_path / f"{name}.glb").read_bytes()).hexdigest())
    assert digests[0] == digests[1] != digests[2]


def test_file_is_valid_gltf(scene: Glb) -> None:
    scene.check_structure()


def test_meshes_are_instanced(scene: Glb) -> None:
    uses = scene.mesh_uses()
    assert set(uses) == set(range(len(scene.json["meshes"])))
    assert max(uses.values()) >= 10
    assert sum(count > 1 for count in uses.values()) >= 5


def test_half_of_a_plant_is_unique(tmp_path: Path) -> None:
    record = write_scene("plant", tmp_path / "plant.glb", 300_000, seed=5)
    assert record.unique_triangles >= 0.5 * record.triangles


def test_names_and_hierarchy(scene: Glb) -> None:
    names = [node["name"] for node in scene.json["nodes"]]
    assert len(set(names)) == len(names)
    assert scene.depth() >= 3
    assert all(material["pbrMetallicRoughness"]["baseColorFactor"][3] == 1.0 for material in scene.json["materials"])


def test_extras_hold_the_tour(scene: Glb) -> None:
    extras = scene.json["scenes"][0]["extras"]
    assert extras["kind"] in KINDS
    assert extras["seed"] == 3
    assert np.asarray(extras["tour"]).shape[1] == 3


def test_every_solid_is_closed_and_faces_outwards(scene: Glb) -> None:
    for mesh in scene.json["meshes"]:
        for primitive in mesh["primitives"]:
            positions, normals, triangles = scene.primitive(primitive)
            assert np.isfinite(positions).all()
            assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-5
            points, welded = np.unique(positions, axis=0, return_inverse=True)
            faces = welded.reshape(-1)[triangles].astype(np.int64)
            corners = points[faces].astype(np.float64)
            across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            assert (np.linalg.norm(across, axis=1) > 1e-10).all(), mesh["name"]
            edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
            there = np.sort(edges[:, 0] * len(points) + edges[:, 1])
            back = np.sort(edges[:, 1] * len(points) + edges[:, 0])
            assert np.array_equal(there, back), f"{mesh['name']} is open"
            assert np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])) > 0, mesh["name"]
            shading = normals[triangles].mean(axis=1)
            assert (np.sum(across * shading, axis=1) > 0).all(), mesh["name"]
            turned = np.argmin(faces, axis=1)
            canonical = np.take_along_axis(faces, (turned[:, None] + np.arange(3)) % 3, axis=1)
            assert len(np.unique(canonical, axis=0)) == len(faces), f"{mesh['name']} holds a face twice"


def test_trimesh_reads_the_same(scene: Glb) -> None:
    loaded = trimesh.load(scene.path)
    placed = [loaded.geometry[loaded.graph[node][1]] for node in loaded.graph.nodes_geometry]
    assert sum(len(geometry.faces) for geometry in placed) == scene.expanded_triangles()


@pytest.mark.parametrize("kind", KINDS)
def test_no_wall_on_the_tour_and_room_at_the_viewpoints(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.glb"
    record = write_scene(kind, path, 200_000, seed=4)
    solid = rtcore_scene.EmbreeScene()
    TriangleMesh(solid, Glb(path).soup())

    def distances(starts: np.ndarray, ways: np.ndarray) -> np.ndarray:
        return solid.run(starts.astype(np.float32), ways.astype(np.float32), query="DISTANCE")

    steps = np.diff(record.tour, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    assert (lengths > 0).all()
    assert lengths.sum() > 100
    for shift in ((0, 0, 0), (0, 0.1, 0), (0, -0.8, 0), (0.15, 0, 0), (-0.15, 0, 0), (0, 0, 0.15), (0, 0, -0.15)):
        assert (distances(record.tour[:-1] + shift, steps / lengths[:, None]) > lengths).all()
    points = viewpoints(kind, 200_000, 4)
    assert points.shape[1] == 3
    assert len(points) > 30
    rng = np.random.default_rng(0)
    for way in rng.normal(size=(32, 3)):
        assert (distances(points, np.tile(way / np.linalg.norm(way), (len(points), 1))) > 0.15).all()


@pytest.mark.parametrize(
    ("kind", "triangles", "seed", "name", "words"),
    [
        ("castle", 100_000, 1, "a.glb", ", ".join(KINDS)),
        ("plant", 100, 1, "a.glb", "20,000"),
        ("plant", 10**10, 1, "a.glb", "200,000,000"),
        ("plant", 100_000, -1, "a.glb", "seed"),
        ("plant", 100_000, 1, "a.obj", ".glb"),
        ("plant", 100_000, 1, "missing/a.glb", "no folder"),
    ],
)
def test_what_cannot_be_made_is_refused(
    kind: str, triangles: int, seed: int, name: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(ParameterError, match=words) as refusal:
        write_scene(kind, tmp_path / name, triangles, seed)
    assert isinstance(refusal.value, VlodError)
    assert "\n" not in str(refusal.value)
    assert list(tmp_path.iterdir()) == []


def test_a_scene_beyond_the_limit_of_glb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jobs.scenes.things.glb.GLB_LIMIT", 300_000)
    with pytest.raises(ParameterError, match="fewer triangles"):
        write_scene("plant", tmp_path / "plant.glb", 100_000, 1)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_scene_leaves_nothing(tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_scene("plant", tmp_path / "plant.glb", 100_000, 1, stop)
    assert list(tmp_path.iterdir()) == []


def test_progress_rises_to_the_total(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    write_scene("offices", tmp_path / "offices.glb", 200_000, 1, lambda done, total: told.append((done, total)))
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1] == (200_000, 200_000)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_memory_does_not_grow_with_the_scene(kind: str, tmp_path: Path) -> None:
    # VmHWM, not ru_maxrss: the latter is inherited from the process that starts this one
    code = (
        "import sys; from pathlib import Path; from jobs.scenes import write_scene;"
        "write_scene(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), 1);"
        "print(next(line for line in open('/proc/self/status') if line.startswith('VmHWM')).split()[1])"
    )
    peaks = []
    for triangles in (100_000, 3_000_000):
        command = [sys.executable, "-c", code, kind, str(tmp_path / "scene.glb"), str(triangles)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        peaks.append(int(done.stdout) << 10)
    assert peaks[1] < 200 << 20
    assert peaks[1] - peaks[0] < 60 << 20
