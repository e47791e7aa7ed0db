"""Repair: what is bad or missing of a store is made again, and nothing else.

The bytes come from the first of these that has them, and are looked at before they are used:

    the work directory    where it holds a file of that name
    another copy          of the store, at a path or URL
    the model             see `jobs.upkeep.rebuilt`

Manifests come from what the store says of them elsewhere, and from another copy of it. What none of these has stays as
it is. While it is looked for the store is locked, as by a build.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from jobs.running.memory import TASK_MEMORY
from jobs.upkeep.folder import held, store_folder, version_numbers
from jobs.upkeep.rebuilt import rebuild
from storage.base.errors import CorruptStoreError, StoreError, StoreNotFoundError
from storage.base.progress import Progress, Silent
from storage.check import problems_of_shard
from storage.shards.cache import ByteCache
from storage.shards.files import Files
from storage.shards.manifest import FILE, Manifest, from_bytes, version_path
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import FOLDER, ShardRecord, atomic_file, shard_path
from storage.versions import Versions, current_manifest, find_versions, version_in

#: What helps where no sound copy is at hand.
SOURCES = "name another copy of the store (--from) or its model (--model)"


class Mended(NamedTuple):
    """A file that is sound again."""

    file: str  # path inside the store
    source: str  # where its bytes come from


@dataclass
class Repairs:
    """What a repair did."""

    store: str
    mended: list[Mended] = field(default_factory=list)
    left: list[str] = field(default_factory=list)  # what could not be mended, one line each, with what would help

    def to_json(self) -> dict[str, Any]:
        """Everything, ready for `json.dumps`."""
        return {"mended": [{"file": file, "source": source} for file, source in self.mended], "left": list(self.left)}


def repair(
    store: str,
    *,
    source: str | None = None,
    model: Sequence[Path] = (),
    work: Path | None = None,
    workers: int | None = None,
    memory: int = TASK_MEMORY,
    progress: Progress | None = None,
) -> Repairs:
    """Makes what is bad or missing of a store again: manifests, and shards of all its versions.

    Args:
        store: its folder.
        source: another copy of it, a path or URL.
        model: the files or folders that it was built from.
        work: of its builds; `store`/work by default.
        workers: tasks at once where shards are made from the model; None for all cores.
        memory: that such a task may need, in bytes, as the build was allowed.
        progress: hears of it.

    Raises:
        WorkInUseError: a build is running.
        StoreNotFoundError: there is nothing of a store; or none at `source`.
        CorruptStoreError: the current manifest is damaged, and no sound copy of it is at hand. Nothing was changed.
        StoreFormatError, StoreUnreachableError: a manifest cannot be read.
        ModelError, ParameterError, JobError: the model cannot be built again.
    """
    folder = store_folder(store)
    if not any((folder / name).exists() for name in (FILE, FOLDER, "versions")):
        raise StoreNotFoundError(f"{store}: neither {FILE} nor shards: nothing of a vLOD store; name its folder")
    progress = progress or Silent()
    repairs = Repairs(store)
    other = None if source is None else _opened(source)
    with held("vlod verify --repair", folder):
        versions = _manifests(folder, other, repairs)
        place = folder / "work" if work is None else work
        bad = _bad(folder, versions, progress)
        _copy(folder, bad, place, other, repairs)
        for manifest in sorted(versions.manifests.values(), key=lambda manifest: -manifest.version):
            if model and bad.keys() & {shard.name for _, shard in manifest.shards()}:
                for name in rebuild(folder, place, manifest, bad, model, workers, memory, progress):
                    del bad[name]
                    repairs.mended.append(Mended(shard_path(name), ", ".join(map(str, model))))
    for name in bad:
        tried = "it does not come out of this model" if model else f"no sound copy of it is at hand: {SOURCES}"
        repairs.left.append(f"{store}/{shard_path(name)} cannot be mended: {tried}")
    return repairs


def _opened(source: str) -> Files:
    """The files of another copy, which may be damaged as well. Raises StoreNotFoundError where there is none."""
    files = Files(source)
    with contextlib.suppress(CorruptStoreError):
        current_manifest(files)
    return files


def _manifests(store: Path, other: Files | None, repairs: Repairs) -> Versions:
    """All versions of a store, after their manifests were mended as far as may be."""
    files = Files(store)
    theirs = None if other is None else _Copy(store, other)
    try:
        current = current_manifest(files)
    except (CorruptStoreError, StoreNotFoundError) as error:
        current, data, origin = _current(store, theirs, error)
        _write(store, FILE, data, origin, repairs)
    versions = find_versions(files, current)
    for number, problem in versions.damaged.items():
        if number == current.version:
            _write(store, version_path(number), files.read(FILE), FILE, repairs)
        elif theirs is not None and (kept := theirs.manifest(number)) is not None:
            _write(store, version_path(number), kept, theirs.files.url, repairs)
        else:
            repairs.left.append(f"{problem.partition(';')[0]}; name another copy of the store (--from), or drop it")
    return find_versions(files, current)


def _current(store: Path, theirs: _Copy | None, error: StoreError) -> tuple[Manifest, bytes, str]:
    """The newest manifest that the store, or a copy of it, still has; its bytes, and where they come from.

    Raises CorruptStoreError where there is none.
    """
    files, numbers = Files(store), version_numbers(store)
    found = [(_read(files, version_path(number), number), version_path(number)) for number in numbers[-1:]]
    if theirs is not None:
        found += [(theirs.manifest(number), theirs.files.url) for number in numbers[-1:]]
        found.append((theirs.current(), theirs.files.url))
    sound = [(from_bytes(data, origin), data, origin) for data, origin in found if data is not None]
    if sound:
        return max(sound, key=lambda candidate: candidate[0].version)
    raise CorruptStoreError(
        f"{store}/{FILE} cannot be mended: no sound copy of it is at hand; name another copy of the store (--from)",
        FILE,
    ) from error


class _Copy:
    """Manifests of what is said to be a copy of a store: where that is so for all that the two can be compared by."""

    def __init__(self, store: Path, files: Files) -> None:
        self.files = files
        own = [(number, _read(Files(store), version_path(number), number)) for number in version_numbers(store)]
        pairs = [(data, self._read(number)) for number, data in own if data is not None]
        common = [mine == theirs for mine, theirs in pairs if theirs is not None]
        self._alike = all(common) and (bool(common) or not pairs)

    def manifest(self, number: int) -> bytes | None:
        """A version's manifest."""
        return self._read(number) if self._alike else None

    def current(self) -> bytes | None:
        """The current one's."""
        return _read(self.files, FILE) if self._alike else None

    def _read(self, number: int) -> bytes | None:
        return _read(self.files, version_path(number), number)


def _read(files: Files, path: str, number: int | None = None) -> bytes | None:
    """The bytes of a manifest, if it is sound, and of the version that it should be."""
    try:
        data = files.read(path)
        if number is None:
            from_bytes(data, path)
        else:
            version_in(data, path, number)
    except (CorruptStoreError, StoreNotFoundError):
        return None
    return data


def _bad(store: Path, versions: Versions, progress: Progress) -> dict[str, ShardRecord]:
    """All shards of a store that are bad or missing, by name. Reads every byte."""
    shards = ShardFiles(Files(store), ByteCache(0))
    records = versions.shards()
    progress.start("repair")
    bad = {}
    for done, record in enumerate(records.values()):
        progress.update(done, len(records))
        if any(problems_of_shard(shards, record)):
            bad[record.name] = record
    progress.finish(f"{len(bad):,} of {len(records):,} shards bad or missing")
    return bad


def _copy(store: Path, bad: dict[str, ShardRecord], work: Path, other: Files | None, repairs: Repairs) -> None:
    """Copies what is bad from the work directory or another copy, and takes it off the list."""
    drafts = dict(_files_named(work, bad))
    for name, record in list(bad.items()):
        for data, origin in _candidates(record, drafts, other):
            if len(data) == record.bytes and hashlib.sha256(data).hexdigest()[:32] == name:
                _write(store, shard_path(name), data, origin, repairs)
                del bad[name]
                break


def _candidates(record: ShardRecord, drafts: dict[str, Path], other: Files | None) -> Iterator[tuple[bytes, str]]:
    """What may be the bytes of a shard, and where it lies."""
    if (draft := drafts.get(record.name)) is not None:
        yield draft.read_bytes(), str(draft)
    if other is not None:
        try:
            yield other.read(shard_path(record.name)), other.url
        except StoreNotFoundError:
            return


def _files_named(folder: Path, names: Collection[str]) -> Iterator[tuple[str, Path]]:
    """The files of these names anywhere in a folder, each with its name."""
    for inner, _, files in os.walk(folder):
        yield from ((name, Path(inner, name)) for name in files if name in names)


def _write(store: Path, path: str, data: bytes, origin: str, repairs: Repairs) -> None:
    with atomic_file(store / path) as file:
        file.write(data)
    repairs.mended.append(Mended(path, origin))
