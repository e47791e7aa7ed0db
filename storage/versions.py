"""The versions of a store: which there are, and the shards that each names.

Numbers count up from 1 to the current one's; a version without a manifest was dropped. So they are found by asking for
each number: a store may lie where nobody tells which files there are.
"""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

from storage.base.errors import CURE, CorruptStoreError, StoreError, StoreNotFoundError
from storage.shards.files import Files
from storage.shards.manifest import FILE, Manifest, from_bytes, to_bytes, version_path
from storage.shards.shards import ShardRecord

#: How many manifests are asked for at once.
AT_ONCE = 16


class Versions(NamedTuple):
    """The versions of a store."""

    current: Manifest
    manifests: dict[int, Manifest]  # by number, increasing; the current one is among them
    damaged: dict[int, str]  # what is wrong with manifests under versions/, in one line each, by number

    def shards(self) -> dict[str, ShardRecord]:
        """All shards that versions name, by name: those of the current one first, then of newer ones first."""
        newest_first = sorted(self.manifests.values(), key=lambda manifest: -manifest.version)
        return {shard.name: shard for manifest in newest_first for _, shard in manifest.shards()}


def current_manifest(files: Files) -> Manifest:
    """The manifest of a store's current version. Raises what `read_manifest` does."""
    return read_manifest(files, None)


def read_manifest(files: Files, version: int | None) -> Manifest:
    """The manifest of a version of a store, None for the current one.

    Raises StoreNotFoundError where there is no store, CorruptStoreError where it is damaged, StoreFormatError where its
    format is unknown, StoreUnreachableError where it cannot be read.
    """
    path = FILE if version is None else version_path(version)
    try:
        data = files.read(path)
    except StoreNotFoundError as error:
        cause = "not a vLOD store, or its build has not finished; run `vlod build MODEL STORE`"
        if version is not None:
            cause = f"the store has no version {version}"
        raise StoreNotFoundError(f"{files.url}: no {path}: {cause}") from error
    return from_bytes(data, f"{files.url}/{path}", path)


def find_versions(files: Files, current: Manifest) -> Versions:
    """All versions up to the current one, whose manifest was read already."""
    with ThreadPoolExecutor(AT_ONCE) as pool:
        found = list(pool.map(lambda number: _manifest(files, number), range(1, current.version + 1)))
    manifests, damaged = {}, {}
    for number, manifest in enumerate(found, 1):
        if isinstance(manifest, Manifest):
            manifests[number] = manifest
        elif manifest is not None:
            damaged[number] = manifest
    last, place = current.version, f"{files.url}/{version_path(current.version)}"
    if last not in manifests and last not in damaged:
        damaged[last] = f"{place} is missing; {CURE}"
    elif last in manifests and manifests[last] != current:
        damaged[last] = f"{place} is not what {FILE} says; {CURE}"
    return Versions(current, {**manifests, last: current}, damaged)


def content_of(manifest: Manifest) -> str:
    """A hash (32 hex digits) of what a version says, whatever its number."""
    return hashlib.sha256(to_bytes(replace(manifest, version=0))).hexdigest()[:32]


def version_in(data: bytes, place: str, number: int) -> Manifest:
    """The manifest of version `number` that `data` holds, read from `place`.

    Raises CorruptStoreError if it is damaged or another version's, StoreFormatError for another format.
    """
    path = version_path(number)
    manifest = from_bytes(data, place, path)
    if manifest.version != number:
        raise CorruptStoreError(f"{place} is damaged: it is of version {manifest.version}; {CURE}", path)
    return manifest


def _manifest(files: Files, number: int) -> Manifest | str | None:
    """A version's manifest, or what is wrong with it; None where there is none."""
    path = version_path(number)
    try:
        return version_in(files.read(path), f"{files.url}/{path}", number)
    except StoreNotFoundError:
        return None
    except StoreError as error:
        return str(error)
