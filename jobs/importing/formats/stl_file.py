"""Reader of STL files, binary and text (.stl).

Face k is the k-th facet of its solid. Facet normals are left aside: they say no more than the corners do.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import count
from pathlib import Path

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.reading.content import Content, whole
from jobs.importing.reading.needs import text_needs
from jobs.importing.reading.numbers import rows_of
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene
from storage.base.errors import ModelError
from storage.meshes.placement import IDENTITY

#: Bytes of memory for each facet of a binary file.
FACET = 760

_HEADER = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read(file: Path, content: Content, resources: Resources) -> SourceScene:  # noqa: ARG001  STL names no other files
    """Read an STL file. Raises ModelError if it is cut short."""
    data = whole(content)
    if _is_binary(content):
        solids = {file.stem: np.frombuffer(data, _FACET, offset=_HEADER)["corners"].reshape(-1, 3)}
    else:
        solids = _solids(file, data.replace(b"\r", b"\n"))
    meshes = [
        SourceMesh(name, corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3))
        for name, corners in solids.items()
        if len(corners)
    ]
    return SourceScene(file, meshes, [SourceNode(i, mesh.name, IDENTITY) for i, mesh in enumerate(meshes)])


def _is_binary(content: Content) -> bool:
    """Whether the file is just as long as its count of facets says. Text may start with anything, so may binary."""
    head = content.part(0, _HEADER)
    return len(head) == _HEADER and content.size == _HEADER + _FACET.itemsize * _facets(head)


def _facets(head: bytes) -> int:
    """What a binary file says of its number of facets."""
    return int.from_bytes(head[80:_HEADER], "little") if len(head) >= _HEADER else 0


def _solids(file: Path, data: bytes) -> dict[str, np.ndarray]:
    """The solids of a text file: their corners (3 m, 3) by their names. What is no number becomes NaN."""
    text = data.lower()
    _check(file, text)
    solids: dict[str, np.ndarray] = {}
    end = 0
    while (start := text.find(b"solid", end)) >= 0 and (last := text.find(b"endsolid", start)) >= 0:
        end = last + len(b"endsolid")
        lines = [line.partition(b"\n")[0] for line in text[start:last].split(b"vertex")[1:]]
        if len(lines) % 3:
            raise ModelError(f"{file}: not every facet has three vertices; the file is damaged, export it again")
        if lines:
            name = data[start + len(b"solid") : last].partition(b"\n")[0].decode("utf-8", "replace").strip()
            solids[_unused(name, solids)] = rows_of(lines, 3)
    return solids


def _check(file: Path, text: bytes) -> None:
    """Raise ModelError unless every facet that a text file (in lower case) begins is whole."""
    if not text.lstrip().startswith(b"solid"):
        facets = _facets(text)
        raise ModelError(
            f"{file}: {len(text)} bytes, but an STL file of {facets} facets has {_HEADER + _FACET.itemsize * facets}; "
            "it is cut short or not an STL file"
        )
    last = text.rfind(b"endsolid")
    if last < 0 or b"facet" in text[last:]:
        raise ModelError(f"{file}: a text STL file without its last line (endsolid); it is cut short, export it again")
    if text.count(b"vertex") != 3 * text.count(b"endfacet"):
        raise ModelError(f"{file}: not every facet has three vertices; the file is damaged, export it again")


def _unused(name: str, taken: Collection[str]) -> str:
    """A solid's name, numbered on if another one bears it; those without a name are numbered."""
    if name and name not in taken:
        return name
    stem, line, number = name.rpartition("_")
    if not (line and number.isdecimal()):
        stem, number = name or "geometry", "0"
    return next(other for i in count(int(number) + 1) if (other := f"{stem}_{i}") not in taken)


def _memory(file: Path, content: Content, resources: Resources) -> int:
    if _is_binary(content):
        return FACET * _facets(content.part(0, _HEADER))
    return text_needs(file, content, resources)


FORMAT = Format((".stl",), read, memory=_memory)
