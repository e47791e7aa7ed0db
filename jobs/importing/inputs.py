"""Which files a model consists of, and a key of their content.

A file brings along those that it names (OBJ: material libraries and their textures; glTF: buffers and images; DAE:
images; PLY: a texture), found as the import finds them; a folder brings along everything in it. Files that are named
but missing are the import's to report.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from jobs.importing.reading.resources import Resources
from storage.base.errors import ModelError

_LIBRARY = re.compile(rb"^\s*mtllib\s+(.+?)\s*$", re.MULTILINE)
_MAP = re.compile(rb"^\s*(?:map_\w+|bump|disp|decal|norm|refl)\s+(.+?)\s*$", re.MULTILINE)
_TEXTURE = re.compile(rb"^comment\s+TextureFile\s+(.+?)\s*$", re.MULTILINE)
_IMAGE = re.compile(rb"<init_from>\s*(?:<ref>)?\s*([^<]+?)\s*<")


def content_of(inputs: Sequence[Path]) -> list[list[str]]:
    """Name and hash of every file of a model, in a fixed order: what an import's key is made of.

    Names count from the inputs, so a model that is moved as a whole keeps its key. Raises ModelError for a file or
    folder that is missing or cannot be read.
    """
    entries = []
    for number, path in enumerate(inputs):
        base = path if path.is_dir() else path.parent
        for file in model_files(path):
            name = file.relative_to(base).as_posix() if file.is_relative_to(base) else file.name
            entries.append([f"{number}/{name}", _hash(file)])
    return entries


def model_files(path: Path) -> list[Path]:
    """All files that belong to an input file or folder, sorted. Raises ModelError if it is missing."""
    if path.is_dir():
        return sorted(file for file in path.rglob("*") if file.is_file())
    if not path.exists():
        raise ModelError(f"{path}: there is no such file or folder; check the path")
    found = {path}
    resources = Resources(path)
    found.update(file for name in _named_by(path, resources) if (file := resources.find(name)) is not None)
    return sorted(found)


def _named_by(path: Path, resources: Resources) -> Iterator[str]:
    kind = path.suffix.lower()
    try:
        if kind == ".obj":
            for library in _libraries(path):
                yield library
                material = resources.read(library)
                for text in _texts(_MAP, material or b""):
                    yield text
                    yield text.split()[-1]
        elif kind == ".gltf":
            content = json.loads(path.read_bytes())
            for section in ("buffers", "images"):
                for entry in content.get(section, ()):
                    uri = str(entry.get("uri", ""))
                    if uri and not uri.startswith("data:"):
                        yield uri
        elif kind == ".dae":
            yield from _texts(_IMAGE, path.read_bytes())
        elif kind == ".ply":
            yield from _texts(_TEXTURE, _head(path))
    except (OSError, ValueError, AttributeError, TypeError):
        return


def _texts(pattern: re.Pattern[bytes], content: bytes) -> list[str]:
    return [text.decode("utf-8", "replace") for text in pattern.findall(content)]


def _libraries(path: Path) -> Iterator[str]:
    """The material libraries that an OBJ file names, found line by line."""
    with path.open("rb") as file:
        for line in file:
            if b"mtllib" in line:
                yield from _texts(_LIBRARY, line)


def _head(path: Path) -> bytes:
    """The header of a PLY file, or what of it comes in its first 64 KiB."""
    with path.open("rb") as file:
        return file.read(1 << 16).partition(b"end_header")[0]


def _hash(path: Path) -> str:
    digest = hashlib.blake2b(digest_size=16)
    try:
        with path.open("rb") as file:
            while block := file.read(1 << 22):
                digest.update(block)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None
    return digest.hexdigest()


def total_bytes(inputs: Sequence[Path]) -> int:
    """Size of all files of a model, in bytes. Raises ModelError for what is missing."""
    return sum(file.stat().st_size for path in inputs for file in model_files(path))
