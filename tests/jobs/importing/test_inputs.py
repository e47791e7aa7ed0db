"""Which files belong to a model: an import is repeated when any of them changes, and only then."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jobs.importing.inputs import content_of, model_files
from storage.base.errors import ModelError


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
            {"buffers": [{"uri": "data:,x"}, {"uri": "gone.bin"}], "images": [{"uri": "images/brick%20wall.png"}]}
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
