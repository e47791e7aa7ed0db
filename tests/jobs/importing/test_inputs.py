"""Which files belong to a model: an import is repeated when any of them changes, and only then."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jobs.importing.import_memory import import_memory
from jobs.importing.inputs import content_of, model_files, total_bytes
from jobs.importing.reading.content import FileContent, HashedContent, HeldContent
from storage.base.errors import ModelError
from tests.jobs.importing.shapes import Glb, box


def names(path: Path) -> set[str]:
    return {file.relative_to(path.parent).as_posix() for file in model_files(path)}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "brick wall.png").write_bytes(b"brick")
    (tmp_path / "other.png").write_bytes(b"other")
    (tmp_path / "model.mtl").write_text(
        "newmtl a\nmap_Kd -s 1 1 1 other.png\nmap_Bump C:\\work\\images\\brick wall.png\n"
    )
    (tmp_path / "model.obj").write_text("mtllib model.mtl\nmtllib missing.mtl\nv 0 0 0\n")
    (tmp_path / "model.gltf").write_text(
        json.dumps(
            {
                "asset": {"version": "2.0"},
                "buffers": [{"uri": "data:,x"}, {"uri": "gone.bin"}],
                "images": [{"uri": "images/brick%20wall.png"}],
            }
        )
    )
    (tmp_path / "model.dae").write_text("<image><init_from>file:///home/me/images/brick%20wall.png</init_from></image>")
    (tmp_path / "model.ply").write_bytes(
        b"ply\ncomment TextureFile other.png\nend_header\ncomment TextureFile no.png\n"
    )
    return tmp_path


@pytest.mark.parametrize(
    ("model", "others"),
    [
        ("model.obj", {"model.mtl", "other.png", "images/brick wall.png"}),
        ("model.gltf", {"images/brick wall.png"}),
        ("model.dae", {"images/brick wall.png"}),
        ("model.ply", {"other.png"}),
    ],
)
def test_a_file_brings_what_it_names(folder: Path, model: str, others: set[str]) -> None:
    assert names(folder / model) == {model} | others


@pytest.mark.parametrize("model", ["model.obj", "model.gltf", "model.dae"])
def test_a_changed_texture_changes_the_content(folder: Path, model: str) -> None:
    before = content_of([folder / model])
    (folder / "images" / "brick wall.png").write_bytes(b"tiles")
    assert content_of([folder / model]) != before


def test_a_model_that_is_moved_keeps_its_content(folder: Path) -> None:
    before = content_of([folder / "model.obj"])
    moved = folder.rename(folder.with_name("elsewhere"))
    assert content_of([moved / "model.obj"]) == before


def test_files_that_are_not_named_do_not_count(folder: Path) -> None:
    before = content_of([folder / "model.gltf"])
    (folder / "other.png").write_bytes(b"changed")
    assert content_of([folder / "model.gltf"]) == before
    assert content_of([folder]) != before


def test_a_missing_model_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"no\.obj: there is no such file"):
        content_of([tmp_path / "no.obj"])


def test_a_glb_brings_the_images_that_it_names(tmp_path: Path) -> None:
    scene = Glb()
    scene.node(mesh=scene.mesh(scene.primitive(*box())))
    scene.header["images"] = [{"uri": "a.png"}, {"bufferView": 0}]
    (tmp_path / "a.png").write_bytes(b"image")
    assert names(scene.write(tmp_path / "model.glb")) == {"model.glb", "a.png"}


def test_libraries_are_found_however_their_lines_are_written(tmp_path: Path) -> None:
    for name in ("one", "two", "three four"):
        (tmp_path / f"{name}.mtl").write_text("newmtl a\n")
    lines = ["mtllib one.mtl", "\tmtllib  two.mtl ", "# mtllib five.mtl", "mtllib \\", " three four.mtl", "v 0 0 0"]
    for end in ("\n", "\r\n", "\r"):
        (tmp_path / "a.obj").write_bytes(end.join(lines).encode())
        assert names(tmp_path / "a.obj") == {"a.obj", "one.mtl", "two.mtl", "three four.mtl"}


def test_images_of_dae_files_may_have_escapes_in_their_names(tmp_path: Path) -> None:
    (tmp_path / "a&b.png").write_bytes(b"image")
    (tmp_path / "a.dae").write_text("<image><init_from>a&amp;b.png</init_from></image>")
    assert names(tmp_path / "a.dae") == {"a.dae", "a&b.png"}


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Bytes that are read of each file, by its name."""
    counts: Counter[str] = Counter()
    part = FileContent.part

    def counted(self: FileContent, start: int, end: int) -> bytes:
        data = part(self, start, end)
        counts[self.path.name] += len(data)
        return data

    monkeypatch.setattr(FileContent, "part", counted)
    monkeypatch.setattr("jobs.importing.formats.obj_file._CHUNK", 1000)
    return counts


def large_obj(path: Path) -> int:
    path.write_text("mtllib model.mtl\n" + "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -3\n" * 2000 + "mtllib late.mtl\n")
    (path.parent / "late.mtl").write_text("newmtl b\nmap_Kd late.png\n")
    return path.stat().st_size


def test_a_file_is_read_once_for_its_key_and_once_for_its_memory(folder: Path, read: Counter[str]) -> None:
    size = large_obj(folder / "model.obj")
    keyed = {entry[0] for entry in content_of([folder / "model.obj"])}
    assert keyed == {"0/model.obj", "0/model.mtl", "0/late.mtl", "0/other.png", "0/images/brick wall.png"}
    assert size <= read["model.obj"] < 1.1 * size
    assert read["other.png"] == len(b"other")
    read.clear()
    assert import_memory([folder / "model.obj"]) > 0
    assert size <= read["model.obj"] < 1.1 * size


def test_counting_bytes_reads_no_file_that_is_large_enough_alone(folder: Path, read: Counter[str]) -> None:
    size = large_obj(folder / "model.obj")
    everything = sum(file.stat().st_size for file in model_files(folder / "model.obj"))
    read.clear()
    assert total_bytes([folder / "model.obj"], enough=size - 1) >= size
    assert not read
    assert total_bytes([folder / "model.obj"], enough=size) == everything > size
    assert total_bytes([folder], enough=0) == sum(file.stat().st_size for file in model_files(folder))


@given(st.binary(max_size=60), st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)), max_size=6))
def test_bytes_are_hashed_once_whatever_is_read_of_them(data: bytes, parts: list[tuple[int, int]]) -> None:
    content = HashedContent(HeldContent(data))
    for start, end in parts:
        assert content.part(start, end) == data[start:end]
    assert content.digest() == hashlib.blake2b(data, digest_size=16).hexdigest()


def test_pipes_are_refused_before_they_are_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.obj")
    for look in (content_of, import_memory, lambda inputs: total_bytes(inputs, 1)):
        with pytest.raises(ModelError, match=r"pipe\.obj: not a regular file"):
            look([tmp_path / "pipe.obj"])
