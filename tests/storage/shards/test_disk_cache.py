"""The cache on disk: what it gives is what was put, or nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("diskcache")

from storage.base.errors import ParameterError
from storage.shards.disk_cache import DiskCache

LARGE = bytes(range(256)) * 400


def test_survives_restarts_and_is_shared(tmp_path: Path) -> None:
    one = DiskCache(tmp_path, 1 << 24)
    one.put("a", LARGE, tag="t")
    one.put("b", b"", tag="t")
    other = DiskCache(tmp_path, 1 << 24)
    assert (other.get("a"), other.get("b"), other.get("c")) == (LARGE, b"", None)


def test_what_the_disk_spoils_is_not_there(tmp_path: Path) -> None:
    cache = DiskCache(tmp_path, 1 << 24)
    cache.put("a", LARGE, tag="t")
    (file,) = tmp_path.rglob("*.val")
    content = bytearray(file.read_bytes())
    content[5000] ^= 1
    file.write_bytes(content)
    assert cache.get("a") is None
    cache.put("a", LARGE, tag="t")
    assert cache.get("a") == LARGE
    for file in tmp_path.rglob("*.val"):
        file.unlink()
    assert cache.get("a") is None


def test_keeps_to_its_budget_and_drops_the_least_recently_used(tmp_path: Path) -> None:
    cache = DiskCache(tmp_path, 1 << 21)
    for number in range(100):
        cache.put(str(number), LARGE, tag="t")
        assert cache.get("0") == LARGE
    assert cache.get("1") is None
    assert sum(file.stat().st_size for file in tmp_path.rglob("*.val")) <= (1 << 21) + len(LARGE)


def test_a_disk_that_fails_costs_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = DiskCache(tmp_path, 1 << 24)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(cache._values, "set", full)
        cache.put("a", LARGE, tag="t")
    assert cache.get("a") is None


def test_a_pickle_is_never_opened(tmp_path: Path) -> None:
    cache = DiskCache(tmp_path, 1 << 24)
    cache._values.set("a", {"not": "bytes"})
    assert cache.get("a") is None


def test_a_folder_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    (tmp_path / "cache.db").write_bytes(b"no database" * 1000)
    with pytest.raises(ParameterError, match="cannot hold a cache"):
        DiskCache(tmp_path, 1 << 24)
