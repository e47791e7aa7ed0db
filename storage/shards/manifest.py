"""The manifest: the small JSON file that names the shards of one version of a store.

`manifest.json` is written last, in one atomic step; whoever reads it sees one whole version of the store, the former
or the new one. Each version also stays under `versions/<number>.json`. A directory without `manifest.json` is not a
store. The file's bytes are a pure function of what it says, and it carries a checksum of itself: any changed byte is
found.

A manifest may have sections that this code does not know, made by a later one. They are ignored, unless the manifest's
`requires` names them: whoever does not know such a section would read the store wrongly. Wherever such a section names
a shard it is an object with `name` and `bytes`: all of a version's shards are found, whoever wrote it.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from storage.base.errors import CURE, CorruptStoreError, StoreFormatError
from storage.base.typed_json import from_json, to_json
from storage.shards.sections import CellsSection, GeometrySection, ModelSection
from storage.shards.shards import ShardRecord, atomic_file, shard_path

#: Version of the format that this code writes and reads.
FORMAT = 6

FILE = "manifest.json"


@dataclass(frozen=True)
class Manifest:
    """One version of a store."""

    model: ModelSection
    pixel_angle: float  # model units per unit of distance that one pixel spans: storage.model.cut.pixel_angle
    parameters: Mapping[str, Any]  # every parameter of the build, as JSON holds them
    geometry: GeometrySection  # made by storage.geometry_writer.geometry_section
    cells: CellsSection | None  # made by storage.vlod_writer.cells_section; None before there are any
    version: int = 0  # counts up from 1; given by `commit`
    format: int = FORMAT
    requires: tuple[str, ...] = ()  # names of sections without which the store cannot be read rightly
    others: Mapping[str, Any] = field(default_factory=dict)  # sections that this code does not know, as JSON, by name

    def __post_init__(self) -> None:
        if not (math.isfinite(self.pixel_angle) and self.pixel_angle > 0):
            raise ValueError(f"the pixel angle must be positive, not {self.pixel_angle}")
        if known := sorted(self.others.keys() & {*_OWN, "checksum"}):
            raise ValueError(f"{', '.join(known)} cannot be sections of their own: manifests have them already")

    @property
    def counts(self) -> dict[str, int]:
        """How many parts, nodes, drawables, cells and so on the store holds."""
        cells = dataclasses.asdict(self.cells.counts) if self.cells else {}
        return {**dataclasses.asdict(self.geometry.counts), **cells}

    @property
    def approximation(self) -> str | None:
        """The option of `vlod build` because of which cells may miss what can be seen; None: nothing is missed."""
        if self.parameters.get("sampled"):
            return "--sampled"
        seal = self.parameters.get("seal")
        return None if seal is None else f"--seal {seal:g}"

    def shards(self) -> Iterator[tuple[str, ShardRecord]]:
        """What each shard is for (tables, geometry, cell table, cells, or another section's name), and the shard."""
        yield "tables", self.geometry.tables
        for shard in self.geometry.shards:
            yield "geometry", shard
        if self.cells:
            yield "cell table", self.cells.table
            for cells in self.cells.shards:
                yield "cells", cells
        for name, section in sorted(self.others.items()):
            for shard in _shards_in(section):
                yield name, shard


#: What a manifest says beside the sections that this code does not know.
_OWN = tuple(field.name for field in dataclasses.fields(Manifest) if field.name != "others")


def to_bytes(manifest: Manifest) -> bytes:
    """The manifest as the content of `manifest.json`."""
    content = {**manifest.others, **{name: to_json(getattr(manifest, name)) for name in _OWN}}
    return _as_text(content, _checksum(content))


def from_bytes(data: bytes, place: str, file: str = FILE) -> Manifest:
    """The manifest that `data` holds.

    place: named in errors; file: path inside the store that `data` comes from.
    Raises CorruptStoreError if any byte is not as it was written, StoreFormatError for another format, or for one that
    requires what this code does not know.
    """
    damaged = f"{place} is damaged or was edited"
    try:
        content = json.loads(data)
        found = content.pop("checksum")
        number = content["format"]
        as_written = found == _checksum(content) and _as_text(content, found) == data
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise CorruptStoreError(f"{damaged}: it is not a vLOD manifest; {CURE}", file) from error
    if not as_written:
        raise CorruptStoreError(f"{damaged}: it does not match its checksum; {CURE}", file)
    if number != FORMAT:
        later = isinstance(number, int) and number > FORMAT
        cure = "read it with a later one" if later else "rebuild the store, in another place or after it is removed"
        raise StoreFormatError(f"{place} is of format {number}, this vLOD reads format {FORMAT}; {cure}")
    try:
        others = {name: content[name] for name in content.keys() - set(_OWN)}
        own = {name: content[name] for name in content.keys() & set(_OWN)}
        manifest = from_json(Manifest, {**own, "others": others}, "it")
    except ValueError as error:
        raise CorruptStoreError(f"{damaged}: {error}; {CURE}", file) from error
    if unknown := [name for name in manifest.requires if name not in _OWN]:
        raise StoreFormatError(
            f"{place} needs a reader that knows {', '.join(unknown)}, and this vLOD does not; read it with a later one"
        )
    return manifest


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
            raise CorruptStoreError(f"{path} ({purpose}) {state}; run the build again", shard_path(shard.name))
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


def _shards_in(section: Any) -> Iterator[ShardRecord]:
    """All shards that are named anywhere in a section, as JSON."""
    if isinstance(section, dict):
        name, size = section.get("name"), section.get("bytes")
        if isinstance(name, str) and isinstance(size, int):
            yield ShardRecord(name, size)
    inner = section.values() if isinstance(section, dict) else section if isinstance(section, list) else ()
    for value in inner:
        yield from _shards_in(value)


def _checksum(content: Mapping[str, Any]) -> str:
    canonical = json.dumps(content, sort_keys=True, allow_nan=False, separators=(",", ":"))
    return hashlib.blake2b(canonical.encode(), digest_size=16).hexdigest()


def _as_text(content: Mapping[str, Any], checksum: str) -> bytes:
    text = json.dumps({**content, "checksum": checksum}, sort_keys=True, allow_nan=False, indent=1)
    return text.encode() + b"\n"
