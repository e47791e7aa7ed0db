"""Garbage: versions of a store that are not kept, and what no kept version needs.

What goes, in this order: the manifests of dropped versions, so that none names a shard that is gone; shards; results
of tasks; what killed writers left behind. A kill in between leaves a sound store and less garbage. While it is looked
for and removed the store is locked, as by a build.

A result in the work directory is needed if a kept version was made from it, which the build has noted there. A build
makes any other again, should it want it. What lies in the work directory under a hash goes unless such a note, or a
result that stays, names it; all else in there stays, and so do other stores.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from jobs.running.tasks import RECORD
from jobs.running.workplace import VERSIONS
from jobs.upkeep.folder import HASH, flush, held, store_folder, version_numbers
from storage.base.errors import CorruptStoreError, ParameterError
from storage.base.temporary import PREFIX, abandoned, temporary_path
from storage.shards.files import Files
from storage.shards.manifest import FILE, Manifest, version_path
from storage.shards.shards import FOLDER
from storage.versions import content_of, current_manifest, version_in


class Item(NamedTuple):
    """A file or a folder that goes."""

    path: Path
    bytes: int  # of all files in it


@dataclass(frozen=True)
class Garbage:
    """What goes, or went."""

    store: str
    kept: tuple[int, ...]  # versions, increasing
    dropped: tuple[int, ...]  # versions, increasing
    manifests: tuple[Item, ...]  # of the dropped versions, and of one that was never finished
    shards: tuple[Item, ...]
    results: tuple[Item, ...]  # of tasks
    leftovers: tuple[Item, ...]  # of killed writers

    @property
    def bytes(self) -> int:
        """How many are freed."""
        return sum(item.bytes for item in (*self.manifests, *self.shards, *self.results, *self.leftovers))

    def to_json(self) -> dict[str, Any]:
        """Everything, ready for `json.dumps`; paths are left out."""
        kinds = {name: getattr(self, name) for name in ("manifests", "shards", "results", "leftovers")}
        counted = {
            name: {"count": len(items), "bytes": sum(item.bytes for item in items)} for name, items in kinds.items()
        }
        return {
            "store": self.store,
            "kept": list(self.kept),
            "dropped": list(self.dropped),
            **counted,
            "bytes": self.bytes,
        }


def collect_garbage(
    store: str,
    *,
    keep: int | None = None,
    keep_versions: Collection[int] | None = None,
    work: Path | None = None,
    dry_run: bool = False,
) -> Garbage:
    """Removes versions of a store that are not kept, and what no kept version needs.

    Args:
        store: its folder.
        keep: how many of the newest versions are kept.
        keep_versions: the versions that are kept; the current one is kept at any rate. All, where neither is given.
        work: of the builds of this store, and of no other; `store`/work by default.
        dry_run: only says what would go.

    Raises:
        WorkInUseError: a build is running.
        StoreNotFoundError: there is no store.
        CorruptStoreError, StoreFormatError: the manifest of a kept version cannot be read: what it needs is not known.
        ParameterError: there is no such version, or nothing would be kept.
    """
    folder = store_folder(store)
    current_manifest(Files(folder))
    place = folder / "work" if work is None else work
    with held("vlod gc", place, folder):
        garbage = _find(folder, place, keep, keep_versions)
        if not dry_run:
            _remove(garbage)
    return garbage


def _find(store: Path, work: Path, keep: int | None, keep_versions: Collection[int] | None) -> Garbage:
    current = current_manifest(Files(store))
    there = [number for number in version_numbers(store) if number < current.version]
    kept = _kept([*there, current.version], keep, keep_versions)
    dropped = [number for number in there if number not in kept]
    unfinished = [number for number in version_numbers(store) if number > current.version]
    manifests = [current, *(_manifest(store, number) for number in kept if number != current.version)]
    needed = {shard.name for manifest in manifests for _, shard in manifest.shards()}
    shards = [path for path in _named(store / FOLDER) if path.name not in needed]
    return Garbage(
        store=str(store),
        kept=tuple(kept),
        dropped=tuple(dropped),
        manifests=_items(store / version_path(number) for number in (*dropped, *unfinished)),
        shards=_items(shards),
        results=_items(_needless(work, needed | {content_of(manifest) for manifest in manifests})),
        leftovers=_items(_abandoned(store, work)),
    )


def _kept(there: Sequence[int], keep: int | None, keep_versions: Collection[int] | None) -> list[int]:
    """Those of the versions that are there, increasing, that are to be kept; the last one is the current one."""
    if keep is not None and keep_versions is not None:
        raise ParameterError("--keep and --keep-versions do not go together: choose one")
    if keep is not None:
        if keep < 1:
            raise ParameterError(f"--keep must be 1 or more, not {keep}")
        return list(there[-keep:])
    if keep_versions is None:
        return list(there)
    if missing := sorted(set(keep_versions) - set(there)):
        said, has = (", ".join(map(str, numbers)) for numbers in (missing, there))
        raise ParameterError(f"--keep-versions: the store has no version {said}, but {has}")
    return [number for number in there if number in keep_versions or number == there[-1]]


def _manifest(store: Path, number: int) -> Manifest:
    path = version_path(number)
    try:
        return version_in((store / path).read_bytes(), f"{store}/{path}", number)
    except CorruptStoreError as error:
        raise CorruptStoreError(f"{error}; or do not keep version {number}", path) from error


def _named(folder: Path) -> Iterator[Path]:
    """What lies in a folder under a hash, sorted; nothing where there is no folder."""
    return (path for path in sorted(folder.glob("*")) if HASH.fullmatch(path.name))


def _needless(work: Path, names: Collection[str]) -> list[Path]:
    """What lies in a work directory under a hash that is neither one of these names nor named from there on; sorted."""
    entries: dict[str, list[Path]] = {}
    for path in _walk(work):
        entries.setdefault(path.name, []).append(path)
    records = {path: _record(path) for paths in entries.values() for path in paths}
    todo = [path for path in records if path.name in names]
    needed = set(todo)
    while todo:
        named = [path for name in _hashes(records[todo.pop()]) for path in entries.get(name, ())]
        new = set(named) - needed
        needed |= new
        todo += sorted(new)
    return sorted(records.keys() - needed)


def _walk(work: Path) -> Iterator[Path]:
    """All that lies under a hash in a work directory."""
    for folder, names in _folders(work):
        yield from (folder / name for name in names if HASH.fullmatch(name))


def _folders(work: Path) -> Iterator[tuple[Path, list[str]]]:
    """The folders of a work directory with the names in them; not what lies under a hash, unfinished, or a store."""
    for folder, inner, files in os.walk(work):
        if FILE in files:
            inner.clear()
            continue
        yield Path(folder), [*inner, *files]
        inner[:] = [name for name in inner if not HASH.fullmatch(name) and not name.startswith(PREFIX)]


def _record(path: Path) -> Any:
    """What a task's result says of itself, or a note of a version; None for what is neither."""
    try:
        return json.loads((path if path.parent.name == VERSIONS else path / RECORD).read_text())
    except (OSError, ValueError):
        return None


def _hashes(value: Any) -> set[str]:
    """All hashes that stand anywhere in a JSON value."""
    if isinstance(value, str):
        return {value} if HASH.fullmatch(value) else set()
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return {name for item in inner for name in _hashes(item)}


def _abandoned(store: Path, work: Path) -> list[Path]:
    """What killed writers left in the store and in the work directory."""
    folders = [store, store / FOLDER, store / "versions", *(folder for folder, _ in _folders(work))]
    return [path for folder in folders for path in abandoned(folder)]


def _items(paths: Iterator[Path] | Sequence[Path]) -> tuple[Item, ...]:
    return tuple(Item(path, _bytes(path)) for path in paths)


def _bytes(path: Path) -> int:
    files = [path] if not path.is_dir() else [file for file in path.rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in files)


def _remove(garbage: Garbage) -> None:
    """Removes what was found, so that what is left is sound at any moment, and stays so if the power fails."""
    for items in (garbage.manifests, garbage.shards, garbage.results, garbage.leftovers):
        for item in items:
            _gone(item.path)
        folders = {item.path.parent for item in items}
        for folder in sorted(folders):
            flush(folder)
    for folder in {item.path.parent for item in garbage.results}:
        with contextlib.suppress(OSError):
            folder.rmdir()


def _gone(path: Path) -> None:
    """Removes a file, or a folder, which stands under its name whole or not at all."""
    if not path.is_dir():
        path.unlink(missing_ok=True)
        return
    aside = path if path.name.startswith(PREFIX) else path.rename(temporary_path(path.parent))
    shutil.rmtree(aside)
