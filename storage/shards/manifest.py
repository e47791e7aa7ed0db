"""The manifest: the small JSON file that names the shards of one version of a store.

`manifest.json` is written last, in one atomic step; whoever reads it sees one whole version of the store, the former
or the new one. Each version also stays under `versions/<number>.json`. A directory without `manifest.json` is not a
store. The file's bytes are a pure function of what it says, and it carries a checksum of itself: any changed byte is
found.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from storage.base.errors import CURE, CorruptStoreError, StoreFormatError
from storage.shards.shards import ShardRecord, atomic_file, shard_path

#: Version of the format that this code writes and reads.
FORMAT = 4

FILE = "manifest.json"

_MODEL_KEYS = ("digest", "hi", "lo", "origin", "triangles", "unit_in_metres", "up")


@dataclass(frozen=True)
class Manifest:
    """One version of a store."""

    model: Mapping[str, Any]  # digest, triangles, lo (3), hi (3), origin (3), up, unit_in_metres; more is allowed
    pixel_angle: float  # model units per unit of distance that one pixel spans: storage.model.cut.pixel_angle
    parameters: Mapping[str, Any]  # every parameter of the build, as JSON holds them
    geometry: Mapping[str, Any]  # made by storage.writer.geometry_section
    cells: Mapping[str, Any] | None  # made by storage.writer.cells_section; None before there are any
    version: int = 0  # counts up from 1; given by `commit`
    format: int = field(default=FORMAT)

    def __post_init__(self) -> None:
        missing = [key for key in _MODEL_KEYS if key not in self.model]
        if missing:
            raise ValueError(f"a manifest's model needs {', '.join(missing)}")
        if not (math.isfinite(self.pixel_angle) and self.pixel_angle > 0):
            raise ValueError(f"the pixel angle must be positive, not {self.pixel_angle}")

    @property
    def counts(self) -> dict[str, int]:
        """How many parts, nodes, drawables, cells and so on the store holds."""
        cells = self.cells["counts"] if self.cells else {}
        return {**self.geometry["counts"], **cells}

    @property
    def approximation(self) -> str | None:
        """The option of `vlod build` because of which cells may miss what can be seen; None: nothing is missed."""
        if self.parameters.get("sampled"):
            return "--sampled"
        seal = self.parameters.get("seal")
        return None if seal is None else f"--seal {seal:g}"

    def shards(self) -> Iterator[tuple[str, ShardRecord]]:
        """What each shard is for (tables, geometry, cell table, cells), and the shard."""
        yield "tables", ShardRecord(*self.geometry["tables"])
        for entry in self.geometry["shards"]:
            yield "geometry", ShardRecord(*entry)
        if self.cells:
            yield "cell table", ShardRecord(*self.cells["table"])
            for name, size, _ in self.cells["shards"]:
                yield "cells", ShardRecord(name, size)


def to_bytes(manifest: Manifest) -> bytes:
    """The manifest as the content of `manifest.json`."""
    content: dict[str, Any] = {
        "format": manifest.format,
        "version": manifest.version,
        "model": dict(manifest.model),
        "pixel_angle": manifest.pixel_angle,
        "parameters": dict(manifest.parameters),
        "geometry": dict(manifest.geometry),
        "cells": None if manifest.cells is None else dict(manifest.cells),
    }
    return _with_checksum(content)


def from_bytes(data: bytes, place: str) -> Manifest:
    """The manifest that `data` holds; `place` is named in errors.

    Raises CorruptStoreError if any byte is not as it was written, StoreFormatError for another format.
    """
    damaged = f"{place} is damaged or was edited"
    try:
        content = json.loads(data)
        found = content.pop("checksum")
        number = content["format"]
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise CorruptStoreError(f"{damaged}: it is not a vLOD manifest; {CURE}") from error
    if found != _checksum(content) or _with_checksum(content) != data:
        raise CorruptStoreError(f"{damaged}: it does not match its checksum; {CURE}")
    if number != FORMAT:
        raise StoreFormatError(
            f"{place} is of format {number}, this vLOD reads format {FORMAT}; rebuild the "
            "store, in another place or after it is removed"
        )
    try:
        return Manifest(**content)
    except (TypeError, ValueError) as error:
        raise CorruptStoreError(f"{damaged}: {error}; {CURE}") from error


def current(root: Path) -> Manifest | None:
    """The current manifest of the store at `root`; None where there is none yet.

    Raises CorruptStoreError if it is damaged, StoreFormatError if another version of vLOD wrote it.
    """
    path = root / FILE
    return from_bytes(path.read_bytes(), str(path)) if path.is_file() else None


def commit(root: Path, manifest: Manifest) -> int:
    """Makes `manifest` the store's current version, atomically; returns the version's number.

    All shards must be there already. The same content as the current version again changes nothing. A kill at any
    moment leaves the former version, or no store where there was none. Raises CorruptStoreError if a shard is missing
    or of another size, or if the current manifest is damaged.
    """
    for purpose, shard in manifest.shards():
        path = root / shard_path(shard.name)
        size = path.stat().st_size if path.is_file() else None
        if size != shard.bytes:
            state = "is missing" if size is None else f"has {size} bytes, not {shard.bytes}"
            raise CorruptStoreError(f"{path} ({purpose}) {state}; run the build again")
    version = 1
    if (former := current(root)) is not None:
        if replace(manifest, version=former.version) == former:
            return former.version
        version = former.version + 1
    data = to_bytes(replace(manifest, version=version))
    for path in (root / version_path(version), root / FILE):
        with atomic_file(path) as file:
            file.write(data)
    return version


def version_path(version: int) -> str:
    """Path of an old version's manifest inside a store."""
    return f"versions/{version}.json"


def _checksum(content: Mapping[str, Any]) -> str:
    canonical = json.dumps(content, sort_keys=True, allow_nan=False, separators=(",", ":"))
    return hashlib.blake2b(canonical.encode(), digest_size=16).hexdigest()


def _with_checksum(content: Mapping[str, Any]) -> bytes:
    text = json.dumps({**content, "checksum": _checksum(content)}, sort_keys=True, allow_nan=False, indent=1)
    return text.encode() + b"\n"
