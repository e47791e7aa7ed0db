"""Damage of every kind: it is found and named, never shown, crashes no reader, and is mended to the last byte.

VLOD_FAULTS says how many random ones there are.
"""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from jobs.checking.verify import verify
from jobs.upkeep.repair import repair
from storage import open_store
from storage.base.errors import CorruptStoreError, StoreError, StoreNotFoundError
from storage.shards.manifest import FILE
from tests.jobs.upkeep.two_versions import all_of_version, content, make_two_versions, put

FAULTS = int(os.environ.get("VLOD_FAULTS", "100"))

#: The files of a store by their paths; a fault changes some, and returns which.
Files = dict[str, bytes]


def flipped(chance: random.Random, files: Files, name: str) -> None:
    data = bytearray(files[name])
    for _ in range(chance.choice([1, 1, 2, 16])):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    files[name] = bytes(data)


def cut(chance: random.Random, files: Files, name: str) -> None:
    files[name] = files[name][: chance.randrange(len(files[name]))]


def lengthened(chance: random.Random, files: Files, name: str) -> None:
    files[name] += chance.randbytes(chance.randrange(1, 100))


def emptied(chance: random.Random, files: Files, name: str) -> None:
    start, length = chance.randrange(len(files[name])), chance.randrange(1, 4096)
    end = min(start + length, len(files[name]))
    files[name] = files[name][:start] + bytes(end - start) + files[name][end:]


def removed(_chance: random.Random, files: Files, name: str) -> None:
    del files[name]


def under_another_name(chance: random.Random, files: Files, name: str) -> None:
    """Another shard's bytes: an old version's under a new manifest, or a new one's under an old."""
    files[name] = files[chance.choice([other for other in files if other.startswith("shards/") and other != name])]


def swapped(chance: random.Random, files: Files, name: str) -> None:
    other = chance.choice([other for other in files if other.startswith("shards/") and other != name])
    files[name], files[other] = files[other], files[name]


Fault = Callable[[random.Random, Files, str], None]

TO_ANY: tuple[Fault, ...] = (flipped, cut, lengthened, emptied)
TO_SHARDS: tuple[Fault, ...] = (*TO_ANY, removed, under_another_name, swapped)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_two_versions(tmp_path_factory.mktemp("sound") / "store")


@pytest.fixture(scope="module")
def shown(sound: Path) -> dict[int, list[np.ndarray]]:
    return {version: all_of_version(sound, version) for version in (1, 2)}


def damaged(files: Files, seed: int) -> tuple[Files, set[str]]:
    """Files with one to three faults in them; and which of them differ from what they were."""
    chance = random.Random(seed)
    changed = dict(files)
    for _ in range(chance.choice([1, 1, 1, 3])):
        shards = [name for name in changed if name.startswith("shards/")]
        name = chance.choice([*shards, FILE, "versions/1.json", "versions/2.json"])
        if name not in changed or not changed[name]:
            continue
        # Without its manifest an older version is one that was dropped.
        faults = TO_SHARDS if name in shards else TO_ANY if name == "versions/1.json" else (*TO_ANY, removed)
        chance.choice(faults)(chance, changed, name)
    return changed, {name for name in files if changed.get(name) != files[name]}


def named_by(root: Path, version: int | None = None) -> set[str]:
    """The shards of a version."""
    return {f"shards/{record.name}" for _, record in open_store(root, version=version).manifest.shards()}


def check_named(folder: Path, wrong: set[str], sound: Path) -> None:
    """Verify names each file that is wrong, and none else; of a version without a manifest, that."""
    hidden = named_by(sound, 1) - named_by(sound, 2) if "versions/1.json" in wrong else set()
    try:
        said = verify(str(folder), samples=0, cells=0, workers=1).problems
    except (CorruptStoreError, StoreNotFoundError) as error:  # nothing is known without it
        said = [str(error).replace(": no ", "/")]
        hidden = wrong - {FILE}
    assert bool(said) == bool(wrong)
    assert all(any(f"{folder}/{name}" in line for name in wrong) for line in said), (said, wrong)
    assert all(any(f"{folder}/{name}" in line for line in said) for name in wrong - hidden), (said, wrong)


@pytest.mark.parametrize("seed", range(FAULTS))
def test_a_fault_is_named_never_shown_and_mended(
    sound: Path, shown: dict[int, list[np.ndarray]], tmp_path: Path, seed: int
) -> None:
    files = content(sound)
    changed, wrong = damaged(files, seed)
    folder = put(tmp_path / "copy", changed)
    check_named(folder, wrong, sound)
    for version in (None, 1, 2):
        try:
            found = all_of_version(folder, version)
        except StoreError:
            assert wrong
            continue
        assert all(map(np.array_equal, found, shown[version or 2]))
    mended = repair(str(folder), source=str(sound))
    assert mended.left == []
    assert {file for file, _ in mended.mended} == wrong
    assert content(folder) == files


def test_a_new_manifest_with_the_shards_of_the_old_one(sound: Path, tmp_path: Path) -> None:
    files = content(sound)
    old = put(tmp_path / "old", {name: data for name, data in files.items() if name != FILE})
    (old / FILE).write_bytes(files["versions/1.json"])
    named = named_by(old)
    changed = {name: data for name, data in files.items() if not name.startswith("shards/") or name in named}
    folder = put(tmp_path / "copy", changed)
    wrong = set(files) - set(changed)
    assert wrong
    check_named(folder, wrong, sound)
    with pytest.raises(StoreError):
        all_of_version(folder, None)
    assert {file for file, _ in repair(str(folder), source=str(sound)).mended} == wrong
    assert content(folder) == files
