import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError, StoreFormatError
from storage.shards.manifest import FORMAT, Manifest, commit, from_bytes, to_bytes, version_path
from storage.shards.sections import (
    CellCounts,
    CellShardRecord,
    CellsSection,
    GeometryCounts,
    GeometrySection,
    ModelSection,
)
from storage.shards.shards import Kind, ShardRecord, write_shard

MODEL = ModelSection("d", 1, (0, 0, 0), (1, 1, 1), (0, 0, 0), "z", 1.0)
COUNTS = GeometryCounts(1, 0, 1, 1, 1, 1, 1, 1, 1, 1)


def _manifest(root: Path | None = None, **changes: Any) -> Manifest:
    tables = ShardRecord("0" * 32, 5) if root is None else write_shard(root, [(Kind.TABLE, b"tables")])
    geometry = GeometrySection(0.5, tables, (), COUNTS)
    return replace(Manifest(MODEL, 0.1 + 0.2, {"pixel_error": 1.0, "name": "übung"}, geometry, None), **changes)


CELLS = CellsSection(
    (0.5, 0, 0), 2.0, ShardRecord("table", 1), (CellShardRecord("a", 2, 3, "a code"),), CellCounts(3, 2)
)


def test_a_manifest_comes_back() -> None:
    manifest = _manifest(cells=CELLS, version=3)
    assert from_bytes(to_bytes(manifest), "here") == manifest
    assert manifest.counts["nodes"] == 1
    assert (manifest.counts["cells"], manifest.counts["computed_cells"]) == (3, 2)
    assert [(purpose, shard.name) for purpose, shard in manifest.shards()] == [
        ("tables", "0" * 32),
        ("cell table", "table"),
        ("cells", "a"),
    ]


def _by_a_later_writer(**changes: Any) -> bytes:
    """A manifest with more in it than this code has fields for."""
    content = json.loads(to_bytes(_manifest(cells=CELLS)))
    del content["checksum"]
    content["model"]["author"] = "someone"
    content["cells"]["shards"][0]["bounds"] = [1, 2]
    content["samples"] = {"per_area": 4, "trees": [{"name": "s", "bytes": 7}, {"name": "t", "bytes": 8}]}
    content.update(changes)
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":")).encode()
    content["checksum"] = hashlib.blake2b(canonical, digest_size=16).hexdigest()
    return json.dumps(content, sort_keys=True, indent=1).encode() + b"\n"


def test_what_a_later_writer_adds_is_ignored_and_its_shards_are_found() -> None:
    read = from_bytes(_by_a_later_writer(), "here")
    assert replace(read, others={}) == _manifest(cells=CELLS)
    assert list(read.shards())[-2:] == [("samples", ShardRecord("s", 7)), ("samples", ShardRecord("t", 8))]
    assert from_bytes(to_bytes(read), "there") == read


def test_what_a_later_writer_requires_is_refused_by_name() -> None:
    assert from_bytes(_by_a_later_writer(requires=["cells"]), "here").requires == ("cells",)
    with pytest.raises(StoreFormatError, match="here needs a reader that knows samples, order, and this vLOD does not"):
        from_bytes(_by_a_later_writer(requires=["samples", "cells", "order"]), "here")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"geometry": None}, "it.geometry is no object"),
        ({"model": {"digest": "d"}}, "it.model has no triangles"),
        ({"version": "1"}, "it.version is '1', not of type int"),
        ({"pixel_angle": -1.0}, "pixel angle must be positive"),
        ({"requires": "order"}, "it.requires is no list"),
    ],
)
def test_what_makes_no_sense_is_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CorruptStoreError, match=message) as caught:
        from_bytes(_by_a_later_writer(**changes), "here", "versions/3.json")
    assert caught.value.file == "versions/3.json"


def test_sections_do_not_hide_what_a_manifest_has() -> None:
    for name in ("cells", "checksum"):
        with pytest.raises(ValueError, match=f"{name} cannot be sections of their own"):
            _manifest(others={name: {}})


DATA = to_bytes(_manifest())


@given(st.integers(0, len(DATA) - 1), st.integers(1, 255))
def test_every_changed_byte_is_found(at: int, flip: int) -> None:
    changed = bytearray(DATA)
    changed[at] ^= flip
    with pytest.raises(CorruptStoreError, match=r"^here/manifest.json is damaged"):
        from_bytes(bytes(changed), "here/manifest.json")


@given(st.integers(0, len(DATA) - 1))
def test_a_manifest_cut_short_is_found(length: int) -> None:
    with pytest.raises(CorruptStoreError, match="is damaged"):
        from_bytes(DATA[:length], "here")


@pytest.mark.parametrize(
    "data",
    [b"", b"[]", b"null", b"{}", b"\xff\xfe", b"[" * 100_000, b'{"checksum": "x"}', b'{"checksum": "", "format": NaN}'],
)
def test_what_is_no_manifest(data: bytes) -> None:
    with pytest.raises(CorruptStoreError, match="not a vLOD manifest"):
        from_bytes(data, "here")


def test_another_format_is_named() -> None:
    for number, cure in ((FORMAT + 1, "read it with a later one"), (FORMAT - 1, "rebuild the store, in another place")):
        with pytest.raises(
            StoreFormatError, match=f"is of format {number}, this vLOD reads format {FORMAT}; {cure}"
        ) as caught:
            from_bytes(to_bytes(_manifest(format=number)), "here")
        assert ("rebuild" in str(caught.value)) == (number < FORMAT)


def test_senseless_manifests_cannot_be_made() -> None:
    with pytest.raises(ValueError, match="pixel angle"):
        _manifest(pixel_angle=0.0)
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_bytes(_manifest(parameters={"bad": float("nan")}))


def test_versions_count_up_and_stay(tmp_path: Path) -> None:
    first = _manifest(tmp_path)
    assert commit(tmp_path, first) == 1
    assert commit(tmp_path, first) == 1  # nothing new
    assert commit(tmp_path, replace(first, pixel_angle=0.5)) == 2
    current = (tmp_path / "manifest.json").read_bytes()
    assert json.loads(current)["version"] == 2
    assert (tmp_path / version_path(2)).read_bytes() == current
    assert from_bytes((tmp_path / version_path(1)).read_bytes(), "old") == replace(first, version=1)


def test_a_manifest_is_not_committed_without_its_shards(tmp_path: Path) -> None:
    manifest = _manifest(tmp_path)
    path = tmp_path / "shards" / manifest.geometry.tables.name
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    with pytest.raises(CorruptStoreError, match=rf"{path.name} \(tables\) has {len(content) - 1} bytes") as caught:
        commit(tmp_path, manifest)
    assert caught.value.file == f"shards/{path.name}"
    path.unlink()
    with pytest.raises(CorruptStoreError, match="is missing"):
        commit(tmp_path, manifest)
    assert not (tmp_path / "manifest.json").exists()


def test_a_damaged_manifest_is_not_replaced(tmp_path: Path) -> None:
    manifest = _manifest(tmp_path)
    commit(tmp_path, manifest)
    (tmp_path / "manifest.json").write_bytes(b"{}")
    with pytest.raises(CorruptStoreError, match=r"manifest.json is damaged"):
        commit(tmp_path, manifest)


@pytest.mark.parametrize("step", range(8))
def test_killed_at_any_step_a_reader_sees_the_former_version_or_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    """Stops right before each rename and each write to disk, without cleaning up."""
    first = _manifest(tmp_path)
    commit(tmp_path, first)
    calls = 0

    def killed(real: Any) -> Any:
        def wrapper(*args: Any, **kwargs: Any) -> Any:
            nonlocal calls
            if calls == step:
                raise KeyboardInterrupt
            calls += 1
            return real(*args, **kwargs)

        return wrapper

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", killed(__import__("os").fsync))
        patch.setattr(Path, "replace", killed(Path.replace))
        patch.setattr(Path, "unlink", lambda *_: None)
        try:
            commit(tmp_path, replace(first, pixel_angle=0.5))
        except KeyboardInterrupt:
            assert calls == step
    seen = from_bytes((tmp_path / "manifest.json").read_bytes(), "now")
    assert seen in (replace(first, version=1), replace(first, version=2, pixel_angle=0.5))
    assert commit(tmp_path, replace(first, pixel_angle=0.5)) == 2
    assert from_bytes((tmp_path / version_path(2)).read_bytes(), "old").pixel_angle == 0.5
