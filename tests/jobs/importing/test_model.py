"""The imported model on disk."""

from __future__ import annotations

import json
import pickle
import shutil

import numpy as np
import pytest

from jobs.importing.model import MeshView, Part, open_model, write_model
from storage.base.errors import ModelError
from tests.jobs.importing.shapes import box, canonical, corners_of

IDENTITY = np.eye(3, 4)


def placement(mesh, name="part", matrix=IDENTITY, at=(0, 0, 0)):
    return Part(mesh, name, np.column_stack([matrix[:, :3], np.asarray(matrix[:, 3]) + at]))


def test_what_is_written_is_read(tmp_path):
    positions, triangles = box()
    mesh = MeshView.of(
        positions,
        triangles,
        normals=np.tile(np.float32([0, 0, 1]), (8, 1)),
        colours=np.arange(32, dtype=np.uint8).reshape(8, 4),
        source_faces=np.arange(12) * 2,
    )
    report = {"faces without area": {"total": 2, "parts": {"a": 2}}}
    write_model(tmp_path / "m", [mesh], [placement(0, "a")], up="y", unit_in_metres=0.001, report=report)
    model = open_model(tmp_path / "m")
    found = model.mesh(0)
    for name in ("positions", "normals", "colours", "triangles", "source_faces"):
        assert np.array_equal(getattr(found, name), getattr(mesh, name))
    assert (model.up, model.unit_in_metres, model.names, model.triangle_count) == ("y", 0.001, ("a",), 12)
    assert model.part_name(0) == "a"
    assert model.report == report
    assert np.array_equal(model.lo, [0, 0, 0])
    assert np.array_equal(model.hi, [1, 1, 1])
    assert not model.origin.any()
    assert not model.parts.flags.writeable
    assert not model.positions.flags.writeable


def test_a_mesh_placed_once_is_baked_exactly(tmp_path):
    positions, triangles = box()
    matrix = np.array([[0, -2.0, 0, 10], [2.0, 0, 0, 20], [0, 0, 2.0, 30]])
    mesh = MeshView.of(positions, triangles, normals=np.tile(np.float32([1, 0, 0]), (8, 1)))
    write_model(tmp_path / "m", [mesh], [Part(0, "a", matrix)])
    model = open_model(tmp_path / "m")
    assert model.parts["identity"].all()
    assert np.array_equal(model.mesh(0).positions + model.origin, positions @ matrix[:, :3].T + matrix[:, 3])
    assert np.array_equal(model.mesh(0).normals, np.tile(np.float32([0, 1, 0]), (8, 1)))


def test_a_mirrored_baked_mesh_keeps_its_fronts(tmp_path):
    positions, triangles = box()
    mirror = np.diag([-1.0, 1, 1])
    mesh = MeshView.of(positions, triangles, normals=np.tile(np.float32([1, 0, 0]), (8, 1)))
    write_model(tmp_path / "m", [mesh], [Part(0, "a", np.column_stack([mirror, np.zeros(3)]))])
    found = open_model(tmp_path / "m").mesh(0)

    def volume(p, t):
        a, b, c = (p[t[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6

    assert volume(found.positions, found.triangles) == pytest.approx(volume(positions, triangles))
    assert np.array_equal(found.normals, np.tile(np.float32([-1, 0, 0]), (8, 1)))
    assert np.array_equal(found.source_faces, np.arange(12))


def test_a_mesh_placed_twice_keeps_its_coordinates(tmp_path):
    positions, triangles = box()
    mesh = MeshView.of(positions, triangles)
    parts = [placement(0, "a"), placement(0, "b", at=(5, 0, 0)), placement(0, "c", np.diag([-1.0, 1, 1, 1])[:3])]
    write_model(tmp_path / "m", [mesh], parts)
    model = open_model(tmp_path / "m")
    assert len(model.meshes) == 1
    assert not model.parts["identity"].any()
    assert np.array_equal(model.mesh(0).positions, positions)
    assert np.array_equal(model.parts["matrix"], [p.matrix for p in parts])
    assert model.triangle_count == 36
    assert np.array_equal(model.lo, [-1, 0, 0])
    assert np.array_equal(model.hi, [6, 1, 1])


def test_unplaced_meshes_are_left_out(tmp_path):
    positions, triangles = box()
    meshes = [MeshView.of(positions, triangles), MeshView.of(positions * 2, triangles)]
    write_model(tmp_path / "m", meshes, [placement(1)])
    model = open_model(tmp_path / "m")
    assert len(model.meshes) == 1
    assert model.positions.max() == 2


@pytest.mark.parametrize("far", [1e7, -1e7, 4.5e6 + 0.1])
def test_far_coordinates_get_an_origin_and_lose_nothing(tmp_path, far):
    positions, triangles = box(3.0, (far, 2 * far, 0.0))
    write_model(tmp_path / "m", [MeshView.of(positions, triangles)])
    model = open_model(tmp_path / "m")
    assert model.origin.any()
    assert np.abs(model.positions).max() < 10
    assert np.array_equal(canonical(corners_of(model)), canonical(positions[triangles]))
    assert model.grid.step < 1e-5


def test_far_instances_are_moved_near_their_origin(tmp_path):
    positions, triangles = box(1.0, (1e7, 0, 0))
    parts = [placement(0, "a", at=(-1e7, 0, 0)), placement(0, "b", at=(-1e7 + 5, 0, 0))]
    write_model(tmp_path / "m", [MeshView.of(positions, triangles)], parts)
    model = open_model(tmp_path / "m")
    assert np.abs(model.positions).max() <= 4
    shapes = [box()[0], box(at=(5, 0, 0))[0]]
    assert np.array_equal(canonical(corners_of(model)), canonical(np.concatenate([s[triangles] for s in shapes])))


def test_near_coordinates_get_no_origin(tmp_path):
    positions, triangles = box(10.0, (29.0, 0, 0))
    write_model(tmp_path / "m", [MeshView.of(positions, triangles)])
    assert not open_model(tmp_path / "m").origin.any()


def test_same_arrays_give_same_bytes_and_digest(tmp_path):
    positions, triangles = box()
    for name in ("a", "b"):
        write_model(tmp_path / name, [MeshView.of(positions, triangles)], [placement(0)])
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()


@pytest.mark.parametrize("change", ["position", "colour", "name", "up", "unit", "matrix"])
def test_every_change_of_content_changes_the_digest(tmp_path, change):
    positions, triangles = box()
    write_model(tmp_path / "a", [MeshView.of(positions, triangles)], [placement(0)])
    moved = positions + np.eye(8, 3) * (change == "position")
    colours = np.full((8, 4), 204 + (change == "colour"), np.uint8)
    colours[:, 3] = 255
    write_model(
        tmp_path / "b",
        [MeshView.of(moved, triangles, colours=colours)],
        [placement(0, "other" if change == "name" else "part", at=(change == "matrix", 0, 0))],
        up="x" if change == "up" else "z",
        unit_in_metres=2.0 if change == "unit" else 1.0,
    )
    assert open_model(tmp_path / "a").digest != open_model(tmp_path / "b").digest


def test_nothing_is_left_when_writing_fails(tmp_path, monkeypatch):
    positions, triangles = box()

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("jobs.importing.keeping.saved._write_whole", full)
    with pytest.raises(OSError, match="No space"):
        write_model(tmp_path / "m", [MeshView.of(positions, triangles)])
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_not_overwritten(tmp_path):
    positions, triangles = box()
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "file").write_text("mine")
    with pytest.raises(ModelError, match="something here already"):
        write_model(tmp_path / "m", [MeshView.of(positions, triangles)])
    assert (tmp_path / "m" / "file").read_text() == "mine"


def test_an_empty_directory_may_be_there(tmp_path):
    positions, triangles = box()
    (tmp_path / "m").mkdir()
    write_model(tmp_path / "m", [MeshView.of(positions, triangles)])
    assert open_model(tmp_path / "m").triangle_count == 12


def test_a_model_needs_a_triangle(tmp_path):
    with pytest.raises(ModelError, match="at least one triangle"):
        write_model(tmp_path / "m", [])
    assert list(tmp_path.iterdir()) == []


def test_a_model_pickles_as_its_path(tmp_path):
    positions, triangles = box()
    write_model(tmp_path / "m", [MeshView.of(positions, triangles)])
    data = pickle.dumps(open_model(tmp_path / "m"))
    assert len(data) < 1000
    assert pickle.loads(data).digest == open_model(tmp_path / "m").digest


def test_a_missing_or_damaged_model_is_one_clear_line(tmp_path):
    positions, triangles = box()
    write_model(tmp_path / "m", [MeshView.of(positions, triangles)])
    with pytest.raises(ModelError, match="there is no imported model"):
        open_model(tmp_path / "other")
    for name, content in (
        ("model.json", b"{"),
        ("positions.npy", b"abc"),
        ("meshes.npy", b""),
        ("parts.npy", b"\x93NUMPY"),
    ):
        shutil.copytree(tmp_path / "m", tmp_path / name)
        (tmp_path / name / name).write_bytes(content)
        with pytest.raises(ModelError, match="import the files again"):
            open_model(tmp_path / name)
    header = json.loads((tmp_path / "m" / "model.json").read_text())
    (tmp_path / "m" / "model.json").write_text(json.dumps({**header, "format": 99}))
    with pytest.raises(ModelError, match="another version"):
        open_model(tmp_path / "m")
