"""Which versions a store has, wherever it lies, and what `vlod versions` says of them."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import fsspec
import pytest
from click.testing import CliRunner, Result

from storage.base.errors import CorruptStoreError, StoreNotFoundError
from storage.cli import command
from storage.cli.versions import versions
from storage.shards.files import Files
from storage.shards.manifest import commit
from storage.versions import Versions, current_manifest, find_versions
from tests.storage.served import served
from tests.storage.tiny_store import make_store, room_parts


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Four versions: other cells, another model, a parameter that was not there before."""
    make_store(tmp_path / "store", room_parts()[4:], depth=1)
    second = make_store(tmp_path / "store", room_parts()[4:], depth=1, pixel_error=2.0).manifest
    third = replace(second, model=replace(second.model, digest="another", triangles=99))
    commit(tmp_path / "store", third)
    commit(tmp_path / "store", replace(third, parameters={**third.parameters, "sampled": True}))
    return tmp_path / "store"


def found(place: str | Path) -> Versions:
    files = Files(place)
    return find_versions(files, current_manifest(files))


def _run(*args: object) -> Result:
    return CliRunner().invoke(command.vlod, [str(arg) for arg in args])


def test_those_that_are_there_are_found_everywhere(root: Path) -> None:
    (root / "versions" / "2.json").unlink()
    here = found(root)
    assert list(here.manifests) == [1, 3, 4]
    assert [manifest.version for manifest in here.manifests.values()] == [1, 3, 4]
    assert here.damaged == {}
    names = {shard.name for manifest in here.manifests.values() for _, shard in manifest.shards()}
    assert set(here.shards()) == names
    assert list(here.shards())[: len(list(here.current.shards()))] == [shard.name for _, shard in here.current.shards()]
    with served(root) as url:
        assert found(url) == here
    fsspec.filesystem("memory").put(str(root), "/versions-of", recursive=True)
    assert found("memory://versions-of") == here
    fsspec.filesystem("memory").rm("/versions-of", recursive=True)


def test_damaged_manifests_are_named(root: Path) -> None:
    second = (root / "versions" / "2.json").read_bytes()
    (root / "versions" / "1.json").write_bytes(second)
    (root / "versions" / "2.json").write_bytes(second[:-2])
    (root / "versions" / "4.json").unlink()
    here = found(root)
    assert list(here.manifests) == [3, 4]
    assert list(here.damaged) == [1, 2, 4]
    for number, said in ((1, "it is of version 2"), (2, "is damaged or was edited"), (4, "is missing")):
        assert f"{root}/versions/{number}.json" in here.damaged[number]
        assert said in here.damaged[number]


def test_the_current_one_is_what_the_manifest_says(root: Path) -> None:
    edited = make_store(root.parent / "other", room_parts()[:1]).manifest
    for _ in range(3):
        edited = replace(edited, pixel_angle=2 * edited.pixel_angle)
        commit(root.parent / "other", edited)
    (root / "versions" / "4.json").write_bytes((root.parent / "other" / "manifest.json").read_bytes())
    assert "is not what manifest.json says" in found(root).damaged[4]
    assert found(root).manifests[4] == current_manifest(Files(root))


def test_no_store(tmp_path: Path) -> None:
    with pytest.raises(StoreNotFoundError, match=r"no manifest\.json: not a vLOD store"):
        current_manifest(Files(tmp_path))
    (tmp_path / "manifest.json").write_bytes(b"[]")
    with pytest.raises(CorruptStoreError):
        current_manifest(Files(tmp_path))


def test_the_command_as_json(root: Path) -> None:
    facts = json.loads(_run("versions", root, "--json").stdout)
    assert (facts["store"], facts["current"], facts["problems"]) == (str(root), 4, [])
    assert facts["bytes"] == sum(path.stat().st_size for path in (root / "shards").iterdir())
    rows, second = facts["versions"], found(root).manifests[2]
    assert [row["version"] for row in rows] == [1, 2, 3, 4]
    assert [row["current"] for row in rows] == [False, False, False, True]
    assert [row["model_changed"] for row in rows] == [False, False, True, False]
    assert [row["parameters_changed"] for row in rows] == [
        {},
        {"pixel_error": [1.0, 2.0]},
        {},
        {"sampled": [None, True]},
    ]
    assert [row["triangles"] for row in rows][1:] == [second.model.triangles, 99, 99]
    assert [row["cells"] for row in rows] == [8, 8, 8, 8]
    manifests = found(root).manifests
    for row in rows:
        shards = {shard.name: shard.bytes for _, shard in manifests[row["version"]].shards()}
        former = {shard.name for _, shard in manifests[row["version"] - 1].shards()} if row["version"] > 1 else set()
        assert row["bytes"] == row["own_bytes"] + row["shared_bytes"] == sum(shards.values())
        assert row["shared_bytes"] == sum(size for name, size in shards.items() if name in former)
    assert 0 < rows[1]["shared_bytes"] < rows[1]["bytes"]
    assert rows[2]["own_bytes"] == 0


def test_the_command_for_people(root: Path) -> None:
    said = _run("versions", root)
    assert said.exit_code == 0
    assert said.output.isascii()
    lines = [line.split() for line in said.output.splitlines()]
    assert [line[0] for line in lines if line and line[0] in "1234"] == ["1", "2", "3", "4"]
    assert "4 (current)" in said.output
    assert "version 2  pixel_error from 1.0 to 2.0\n" in said.output
    assert "version 3  the model\n" in said.output
    assert "version 4  sampled from none to True\n" in said.output
    assert "Damaged" not in said.output
    (root / "versions" / "2.json").write_bytes(b"")
    said = _run("versions", root)
    assert said.exit_code == 1
    assert f"{root}/versions/2.json is damaged" in said.output
    with served(root) as url:
        assert _run("versions", url).exit_code == 1


def test_a_store_of_one_version(tmp_path: Path) -> None:
    make_store(tmp_path, room_parts()[:1], keys=[])
    said = _run("versions", tmp_path)
    assert "1 (current)" in said.output
    assert "Changed" not in said.output


def test_on_a_terminal(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.StringIO()
    monkeypatch.setattr(shown, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdout", shown)
    monkeypatch.setenv("COLUMNS", "120")
    assert versions.callback is not None
    versions.callback(str(root), False)
    assert "4 (current)" in shown.getvalue()
    assert "Changed from the one before" in shown.getvalue()
