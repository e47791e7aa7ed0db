"""Reader of STL files, binary and text (.stl).

Face k is the k-th facet of its solid. Facet normals are left aside: they say no more than the corners do. Colours of
binary files are read, in the way of VisCAM and SolidView (a facet whose bit 15 is set has one) or of Magics, whose
header gives all facets a colour (COLOR=) and whose facets with bit 15 clear have their own. Few bytes after the last
facet do no harm, and are counted.

Based on: 3D Systems: Stereolithography Interface Specification (1988), and Wikipedia, "STL (file format)", for colours.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from itertools import count
from pathlib import Path

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.reading.content import Content, whole
from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.needs import text_needs
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene
from jobs.importing.reading.text.numbers import rows_of
from jobs.importing.reading.text.words import name_of, without_mark
from jobs.importing.reading.vertex_colours import DEFAULT_COLOUR, to_colours
from storage.base.errors import ModelError
from storage.meshes.placement import IDENTITY

#: Bytes of memory for each facet of a binary file.
FACET = 760

_HEADER = 84
#: Bytes after the last facet, of which more speak for a wrong count of facets.
_MOST_TRAILING = 4096

_COLOUR = re.compile(rb"COLOR=(.{4})", re.DOTALL)

#: The line of a solid's name, or as much of it as stands before its first facet.
_NAME = re.compile(rb"(?:^|(?<=\n))[ \t]*solid\b|(?<!\S)endsolid\b")
_NAME_END = re.compile(rb"\n|(?<!\S)facet\s+normal\s+[-+.\dni]|$")

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read(file: Path, content: Content, resources: Resources) -> SourceScene:  # noqa: ARG001  STL names no other files
    """Read an STL file. Raises ModelError if it is cut short."""
    data = whole(content)
    tally = Tally()
    if _is_binary(content):
        facets = np.frombuffer(data, _FACET, _facets(data), _HEADER)
        tally.add(Defect.TRAILING, file.stem, len(data) - _HEADER - facets.nbytes)
        solids = {file.stem: facets["corners"].reshape(-1, 3)}
        colours = _facet_colours(data[: _HEADER - 4], facets["attribute"])
    else:
        solids, colours = _solids(file, without_mark(data).replace(b"\r", b"\n")), None
    meshes = [
        SourceMesh(name, corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3))
        for name, corners in solids.items()
        if len(corners)
    ]
    for mesh in meshes:
        mesh.colours = None if colours is None else np.repeat(colours, 3, axis=0)
    nodes = [SourceNode(i, mesh.name, IDENTITY) for i, mesh in enumerate(meshes)]
    return SourceScene(file, meshes, nodes, tally=tally)


def _facet_colours(header: bytes, attributes: np.ndarray) -> np.ndarray | None:
    """Colours (m, 4) uint8 of facets with two-byte attributes (m,); None if no facet has one."""
    own = (attributes & 0x8000) != 0
    low, middle, high = (((attributes >> shift) & 31).astype(np.float64) / 31 for shift in (0, 5, 10))
    given = _COLOUR.search(header)
    if given is not None:
        own, red, green, blue = ~own, low, middle, high
        plain = np.frombuffer(given[1], np.uint8)
        plain = plain if plain[3] else np.append(plain[:3], np.uint8(255))  # an alpha of 0 says nothing
    else:
        red, green, blue = high, middle, low
        plain = np.array(DEFAULT_COLOUR, np.uint8)
        if not own.any():
            return None
    colours = np.tile(plain, (len(attributes), 1))
    colours[own] = to_colours(np.stack([red, green, blue], axis=1)[own])
    return colours


def _is_binary(content: Content) -> bool:
    """Whether the file is just as long as its count of facets says, or little longer and is no text. Text may start
    with anything, so may binary.
    """
    head = content.part(0, _HEADER)
    if len(head) < _HEADER:
        return False
    rest = content.size - _HEADER - _FACET.itemsize * _facets(head)
    if rest == 0:
        return True
    odd = 0 < rest <= _MOST_TRAILING and rest % _FACET.itemsize != 0  # else facets are there that are not counted
    return odd and _facets(head) > 0 and b"facet" not in content.part(0, _MOST_TRAILING).lower()


def _facets(head: bytes) -> int:
    """What a binary file says of its number of facets."""
    return int.from_bytes(head[80:_HEADER], "little") if len(head) >= _HEADER else 0


def _solids(file: Path, data: bytes) -> dict[str, np.ndarray]:
    """The solids of a text file: their corners (3 m, 3) by their names. What is no number becomes NaN."""
    lower = data.lower()
    text = _nameless(lower)
    _check(file, text)
    solids: dict[str, np.ndarray] = {}
    end = 0
    while (start := text.find(b"solid", end)) >= 0 and (last := text.find(b"endsolid", start)) >= 0:
        end = last + len(b"endsolid")
        lines = [b" ".join(piece.split(None, 3)[:3]) for piece in text[start:last].split(b"vertex")[1:]]
        if len(lines) % 3:
            raise ModelError(f"{file}: not every facet has three vertices; the file is damaged, export it again")
        if lines:
            first = start + len(b"solid")
            ended = _NAME_END.search(lower, first)
            name = name_of(data[first : ended.start() if ended is not None else last])
            solids[_unused(name, solids)] = rows_of(lines, 3)
    return solids


def _nameless(text: bytes) -> bytes:
    """A text file in lower case with blanks in place of its solids' names, which may hold any word."""
    pieces, at = [], 0
    while (keyword := _NAME.search(text, at)) is not None:
        end = _NAME_END.search(text, keyword.end())
        stop = end.start() if end is not None else len(text)
        pieces += [text[at : keyword.end()], b" " * (stop - keyword.end())]
        at = stop
    return b"".join([*pieces, text[at:]])


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
