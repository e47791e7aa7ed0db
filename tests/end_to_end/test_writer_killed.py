"""Writers killed at any moment: the last good version is whole, and `vlod gc` leaves nothing that it does not need.

VLOD_KILLS says how many are killed.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jobs.upkeep.garbage import collect_garbage
from storage import open_store
from storage.shards.files import Files
from storage.versions import current_manifest, find_versions
from tests.jobs.tiny_model import write_rooms

pytestmark = pytest.mark.slow

KILLS = int(os.environ.get("VLOD_KILLS", "10"))

VLOD = [sys.executable, "-c", "from storage.cli.command import main; main()"]
OPTIONS = ["--triangles-per-cell", "150", "--max-depth", "2", "--executor", "serial"]


def building(model: Path, store: Path) -> subprocess.Popen[bytes]:
    command = [*VLOD, "build", str(model), str(store), *OPTIONS]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def check_whole(store: Path) -> int:
    """Every version is sound, and can be read; returns the current one's number."""
    files = Files(store)
    found = find_versions(files, current_manifest(files))
    assert found.damaged == {}
    for version in found.manifests:
        opened = open_store(store, version=version)
        assert list(opened.check()) == []
        assert all(len(opened.vlod(cell)) for cell in range(len(opened.cells)))
    return found.current.version


def check_nothing_needless(store: Path) -> None:
    files = Files(store)
    found = find_versions(files, current_manifest(files))
    assert {path.name for path in (store / "shards").iterdir()} == set(found.shards())
    assert {path.name for path in (store / "versions").iterdir()} == {f"{number}.json" for number in found.manifests}
    assert {path.name for path in store.iterdir()} == {"manifest.json", "shards", "versions", "work"}
    assert list(store.rglob(".tmp-*")) == []
    assert collect_garbage(str(store), dry_run=True).bytes == 0


def test_a_writer_killed_at_any_moment(tmp_path: Path) -> None:
    """Each build is of another model, so that it writes shards of every kind. The chosen moments are seeded."""
    store, chance = tmp_path / "store", random.Random(6)
    models = [
        write_rooms(tmp_path / f"rooms {number}.obj", rooms=2, size=4 + number / 64) for number in range(KILLS + 2)
    ]
    assert building(models[0], store).wait() == 0
    began = time.monotonic()
    assert building(models[1], store).wait() == 0
    took = time.monotonic() - began
    assert (version := check_whole(store)) == 2
    garbage = 0
    for model in models[2:]:
        process = building(model, store)
        time.sleep(took * (0.25 + chance.random()))
        process.kill()
        process.wait()
        now = check_whole(store)
        assert version <= now <= version + 1
        version = now
        found = collect_garbage(str(store), keep=2)
        garbage += found.bytes
        assert found.kept[-1] == version
        assert check_whole(store) == version
        check_nothing_needless(store)
    assert garbage > 0
    assert building(models[0], store).wait() == 0
    assert check_whole(store) == version + 1
