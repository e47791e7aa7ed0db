"""The formats that are read: a new one is a file of its own, and one line here."""

from __future__ import annotations

from pathlib import Path

from jobs.importing.formats import dae_file, obj_file, off_file, ply_file, stl_file
from jobs.importing.formats.format import Format
from jobs.importing.formats.gltf import gltf_file
from jobs.importing.reading.content import Content
from storage.base.errors import ModelError

FORMATS: tuple[Format, ...] = (
    dae_file.FORMAT,
    gltf_file.GLB,
    gltf_file.GLTF,
    obj_file.FORMAT,
    off_file.FORMAT,
    ply_file.FORMAT,
    stl_file.FORMAT,
)


def extensions() -> tuple[str, ...]:
    """All extensions that are known: lower case, with the dot."""
    return tuple(extension for known in FORMATS for extension in known.extensions)


def kinds() -> str:
    """The same, for messages."""
    return ", ".join(extensions())


def format_of(file: Path) -> Format:
    """The format of a file by its extension. Raises ModelError if none is known."""
    for known in FORMATS:
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
    return next((known for known in FORMATS if known.sniff(content)), None)
