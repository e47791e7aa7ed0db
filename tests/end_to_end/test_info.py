"""`vlod info` as a user runs it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.storage.tiny_store import make_store, room_parts


def _vlod(*args: object) -> subprocess.CompletedProcess:
    program = Path(sys.executable).with_name("vlod")
    return subprocess.run([str(program), *map(str, args)], capture_output=True, text=True, check=False)


def test_info_of_a_store(tmp_path: Path) -> None:
    make_store(tmp_path / "room.store", room_parts())
    done = _vlod("info", tmp_path / "room.store")
    assert done.returncode == 0
    assert done.stderr == ""
    assert "3,840 triangles in 12 parts" in done.stdout
    facts = json.loads(_vlod("info", tmp_path / "room.store", "--json").stdout)
    assert facts["cells"]["computed"] == 64


@pytest.mark.parametrize("kind", ["missing", "empty folder", "file", "unfinished", "damaged", "of another format"])
def test_what_is_no_sound_store_ends_in_one_line(tmp_path: Path, kind: str) -> None:
    place = tmp_path / "room.store"
    if kind == "empty folder":
        place.mkdir()
    elif kind == "file":
        place.write_bytes(b"glTF")
    elif kind != "missing":
        make_store(place, room_parts()[:1], depth=0)
        manifest = place / "manifest.json"
        if kind == "unfinished":
            manifest.unlink()
        elif kind == "damaged":
            manifest.write_bytes(manifest.read_bytes().replace(b'"version": 1', b'"version": 2'))
        else:
            manifest.write_bytes(b"{}")
    done = _vlod("info", place)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"error: {place}")
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
