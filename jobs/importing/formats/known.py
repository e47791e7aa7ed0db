"""The formats that are read: a new one is a file of its own, and one line here."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

from jobs.importing.formats.format import Format
from jobs.importing.reading.content import Content
from storage.base.errors import ModelError

#: Where each lies, "module:attribute"; imported when a file is asked about. The first that speaks for a file has it.
FORMATS = (
    "jobs.importing.formats.dae_file:FORMAT",
    "jobs.importing.formats.gltf.gltf_file:GLB",
    "jobs.importing.formats.gltf.gltf_file:GLTF",
    "jobs.importing.formats.obj_file:FORMAT",
    "jobs.importing.formats.off_file:FORMAT",
    "jobs.importing.formats.ply_file:FORMAT",
    "jobs.importing.formats.stl_file:FORMAT",
)


def formats() -> Iterator[Format]:
    """All formats, in the order of the list."""
    for place in FORMATS:
        module, _, attribute = place.partition(":")
        yield getattr(importlib.import_module(module), attribute)


def extensions() -> tuple[str, ...]:
    """All extensions that are known: lower case, with the dot."""
    return tuple(extension for known in formats() for extension in known.extensions)


def kinds() -> str:
    """The same, for messages."""
    return ", ".join(extensions())


def format_of(file: Path) -> Format:
    """The format of a file by its extension. Raises ModelError if none is known."""
    for known in formats():
        if file.suffix.lower() in known.extensions:
            return known
    raise ModelError(f"{file}: not a kind of model that is known; expected one of {kinds()}")


def checked_file(path: Path) -> Path:
    """The same path. Raises ModelError if there is nothing, or anything but a file whose bytes lie still."""
    if not path.exists():
        raise ModelError(f"{path}: there is no such file or folder; check the path")
    if not path.is_file():
        raise ModelError(f"{path}: not a regular file; name a model file ({kinds()}) or a folder of them")
    return path


def sniffed(content: Content) -> Format | None:
    """The format that the first bytes of a file speak for, None if they speak for none in particular."""
    return next((known for known in formats() if known.sniff(content)), None)
