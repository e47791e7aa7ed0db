"""A new format is a file of its own and one line in the list: everything else follows."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from jobs.importing.formats import known
from jobs.importing.import_memory import import_memory
from jobs.importing.inputs import content_of, model_files
from jobs.importing.read import find_files
from storage.base.errors import ModelError
from tests.jobs.importing.formats import toy_file
from tests.jobs.importing.shapes import imported

#: The extensions without the toy's.
USUAL = known.extensions()

TOY = "toy\n0 0 0 1 0 0 0 1 0\n0 0 1 1 0 1 0 1 1\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(known, "FORMATS", (*known.FORMATS, f"{toy_file.__name__}:FORMAT"))  # the line
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "red.txt").write_text("255 0 0 255")
    (tmp_path / "models" / "a.TOY").write_text(TOY)
    (tmp_path / "models" / "b.plaything").write_text(TOY + "colour red.txt\n")
    return tmp_path / "models"


def test_it_is_found_in_folders(folder: Path) -> None:
    assert find_files([folder]) == [(folder / "a.TOY", folder), (folder / "b.plaything", folder)]


def test_it_is_known_by_its_first_bytes(folder: Path, tmp_path: Path) -> None:
    (folder / "a.obj").write_text(TOY)
    with pytest.raises(ModelError, match=r"a\.obj: this is a \.toy file"):
        imported(folder / "a.obj", tmp_path / "out")


def test_its_key_knows_the_files_that_it_names(folder: Path) -> None:
    assert model_files(folder / "a.TOY") == [folder / "a.TOY"]
    assert model_files(folder / "b.plaything") == [folder / "b.plaything", folder / "red.txt"]
    before = content_of([folder / "b.plaything"])
    (folder / "red.txt").write_text("254 0 0 255")
    assert content_of([folder / "b.plaything"]) != before


def test_its_memory_is_estimated(folder: Path) -> None:
    assert import_memory([folder / "a.TOY"]) == import_memory([folder]) == toy_file.MEMORY


def test_it_is_imported(folder: Path, tmp_path: Path) -> None:
    model = imported(folder / "b.plaything", tmp_path / "out")
    assert model.triangle_count == 2
    assert (model.colours == [255, 0, 0, 255]).all()


def test_errors_name_it(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "a.fbx").write_bytes(b"Kaydara")
    named = re.escape(", ".join([*USUAL, ".toy", ".plaything"]))
    with pytest.raises(ModelError, match=named):
        find_files([tmp_path / "a.fbx"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(ModelError, match=named):
        find_files([tmp_path / "empty"])
    (folder / "a.TOY").write_text("toy\nno numbers\n")
    with pytest.raises(ModelError, match=r"a\.TOY: cannot be read as \.toy"):
        imported(folder / "a.TOY", tmp_path / "out")


def test_without_the_line_it_is_not_known(tmp_path: Path) -> None:
    (tmp_path / "a.toy").write_text(TOY)
    with pytest.raises(ModelError, match="not a kind of model that is known"):
        find_files([tmp_path / "a.toy"])


def test_no_extension_is_claimed_twice() -> None:
    extensions = known.extensions()
    assert len(set(extensions)) == len(extensions)
    assert all(extension == extension.lower() and extension.startswith(".") for extension in extensions)
