import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.base.errors import CorruptStoreError, StoreFormatError
from storage.shards.manifest import FORMAT, Manifest, commit, from_bytes, to_bytes, version_path
from storage.shards.shards import Kind, write_shard

MODEL = {
    "digest": "d",
    "triangles": 1,
    "lo": [0, 0, 0],
    "hi": [1, 1, 1],
    "origin": [0, 0, 0],
    "up": "z",
    "unit_in_metres": 1.0,
}


def _manifest(root: Path | None = None, **changes: Any) -> Manifest:
    tables = ["0" * 32, 5] if root is None else list(write_shard(root, [(Kind.TABLE, b"tables")]))
    geometry = {"grid_step": 0.5, "tables": tables, "shards": [], "counts": {"nodes": 1}}
    return replace(Manifest(MODEL, 0.1 + 0.2, {"pixel_error": 1.0, "name": "übung"}, geometry, None), **changes)


def test_a_manifest_comes_back() -> None:
    manifest = _manifest(cells={"table": ["a", 1], "shards": [], "counts": {"cells": 2}}, version=3)
    assert from_bytes(to_bytes(manifest), "here") == manifest
    assert manifest.counts == {"nodes": 1, "cells": 2}


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


@pytest.mark.parametrize("data", [b"", b"[]", b"null", b"{}", b"\xff\xfe", b"[" * 100_000, b'{"checksum": "x"}'])
def test_what_is_no_manifest(data: bytes) -> None:
    with pytest.raises(CorruptStoreError, match="not a vLOD manifest"):
        from_bytes(data, "here")


def test_another_format_is_named() -> None:
    with pytest.raises(StoreFormatError, match=f"is of format {FORMAT + 1}, this vLOD reads format {FORMAT}"):
        from_bytes(to_bytes(_manifest(format=FORMAT + 1)), "here")


def test_senseless_manifests_cannot_be_made() -> None:
    with pytest.raises(ValueError, match="pixel angle"):
        _manifest(pixel_angle=0.0)
    with pytest.raises(ValueError, match="needs up"):
        _manifest(model={key: value for key, value in MODEL.items() if key != "up"})
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
    path = tmp_path / "shards" / manifest.geometry["tables"][0]
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    with pytest.raises(CorruptStoreError, match=rf"{path.name} \(tables\) has {len(content) - 1} bytes"):
        commit(tmp_path, manifest)
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
