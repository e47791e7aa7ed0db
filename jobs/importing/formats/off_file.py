"""Reader of OFF files as text (.off), with colours and normals if they have them.

All variants of vertices are read: normals (N), colours (C), texture coordinates (ST; no picture goes with them),
homogeneous coordinates (4), and the number of dimensions (n) where it is three; the word OFF itself may be left out.
Vertices and faces are read word by word, wherever lines end; where each stands on a line of its own, as nearly all
writers have it, vertices may have three colour components in place of four, and faces colours of their own. Polygons
are split into triangles in the file's order. Read here and not by trimesh, which refuses a whole file for one index out
of range and drops colours.

Based on: Geomview Manual, "OFF Files".
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.reading.content import Content, whole
from jobs.importing.reading.defects import Defect
from jobs.importing.reading.faces.corners import split_by_face
from jobs.importing.reading.faces.polygons import triangulate
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene
from jobs.importing.reading.text.numbers import floats_of, table_of
from jobs.importing.reading.text.words import without_mark
from jobs.importing.reading.vertex_colours import DEFAULT_COLOUR, to_colours
from storage.base.errors import ModelError
from storage.meshes.placement import IDENTITY

_HEAD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b|\s*(?=\d)")
_WORD = re.compile(rb"\S+")


class _Faces(NamedTuple):
    """What a file says of its faces."""

    counts: np.ndarray  # (f,) int64 corners
    corners: np.ndarray  # (c,) int64 indices of vertices
    colours: np.ndarray | None  # (f, 4) float64 as written, NaN where there is none; None if no face has one
    by_number: int  # faces whose colour is a number in a map that the file does not hold


def read(file: Path, content: Content, resources: Resources) -> SourceScene:  # noqa: ARG001  OFF names no other files
    """Read an OFF file. Raises ModelError if it is cut short or of a variant that is not read."""
    text = re.sub(rb"#[^\n]*", b"", without_mark(whole(content)).replace(b"\r", b"\n"))
    head = _HEAD.match(text)
    if head is None:
        raise ModelError(f"{file}: not an OFF file, it does not start with OFF; check its extension or export it again")
    at = head.end()
    if text[at : at + 40].split()[:1] == [b"BINARY"]:
        raise ModelError(f"{file}: a binary OFF file; only OFF as text is read, so export it as text")
    wanted = 3 if head[5] else 2
    words = [word for word, _ in zip(_WORD.finditer(text, at), range(wanted + 1), strict=False)]
    sizes = floats_of(b" ".join(word[0] for word in words[:wanted]))
    if len(sizes) < wanted or not (np.isfinite(sizes) & (sizes >= 0) & (sizes < 2**53)).all():
        raise ModelError(f"{file}: the counts of vertices and faces are missing; the file is damaged or cut short")
    if head[5] and sizes[0] != 3:
        raise ModelError(f"{file}: vertices in {sizes[0]:g} dimensions; only three are read")
    vertices, faces = (int(size) for size in sizes[-2:])
    end = text.find(b"\n", words[wanted - 1].end())
    end = end if end >= 0 else len(text)
    # the count of edges says nothing, and some writers leave it out
    between = text[words[wanted - 2].end() : words[wanted - 1].start()]
    edges = len(words) > wanted and (words[wanted].start() < end or b"\n" in between)
    body = text[words[wanted].end() if edges else end :]
    flat, rest = 3 + bool(head[4]), (3 * bool(head[3]), 2 * bool(head[1]))
    table, found = _body(file, body, vertices, faces, flat + sum(rest), bool(head[2]))
    positions = table[:, :3]
    if head[4]:
        with np.errstate(divide="ignore", invalid="ignore"):
            positions = positions / table[:, 3:4]
    colours = None
    if head[2]:
        last = table.shape[1] - rest[1]
        colours = _colours(table[:, flat + rest[0] : last])
    cut = triangulate(positions, found.corners, found.counts)
    defects = {
        Defect.POLYGON: int(np.count_nonzero(found.counts < 3)),
        Defect.CROSSING: cut.crossing,
        Defect.UNSUPPORTED: found.by_number,
    }
    mesh = SourceMesh(
        file.stem,
        positions,
        found.corners[cut.corners],
        table[:, flat : flat + 3] if head[3] else None,
        colours,
        {defect: count for defect, count in defects.items() if count},
    )
    if colours is None and found.colours is not None:
        split_by_face(mesh, np.repeat(_colours(found.colours), cut.counts, axis=0))
    return SourceScene(file, [mesh] if len(mesh.triangles) else [], [SourceNode(0, mesh.name, IDENTITY)])


def _sniff(content: Content) -> bool:
    head = without_mark(content.part(0, 16))
    return _HEAD.match(head) is not None and head.split(None, 1)[0].endswith(b"OFF")


def _body(file: Path, body: bytes, vertices: int, faces: int, width: int, coloured: bool) -> tuple[np.ndarray, _Faces]:
    """The vertices' numbers (n, `width` and colours) float64, and the faces."""
    lines = [line for line in body.split(b"\n") if line.strip()]
    if len(lines) >= vertices + faces:
        table = _vertex_lines(lines[:vertices], width, coloured)
        found = _face_lines(lines[vertices : vertices + faces])
        if table is not None and found is not None:
            return table, found
    values = floats_of(body)
    width += 4 * coloured
    if vertices * width + faces > len(values):
        raise ModelError(
            f"{file}: {vertices} vertices and {faces} faces are promised, but there are only {len(values)} numbers; "
            "the file is cut short, export it again"
        )
    table = values[: vertices * width].reshape(vertices, width)
    counts, starts = [], []
    at = vertices * width
    for _ in range(faces):
        size = int(values[at]) if at < len(values) and np.isfinite(values[at]) else -1
        if not 0 <= size < len(values) - at:
            raise ModelError(
                f"{file}: a face of {size} corners stands among the last {max(len(values) - at, 0)} numbers; "
                "the file is damaged or cut short"
            )
        counts.append(size)
        starts.append(at + 1)
        at += 1 + size
    sizes = np.array(counts, np.int64)
    index = np.repeat(np.array(starts, np.int64) - (np.cumsum(sizes) - sizes), sizes) + np.arange(sizes.sum())
    return table, _Faces(sizes, _indices(values[index]), None, 0)


def _vertex_lines(lines: list[bytes], width: int, coloured: bool) -> np.ndarray | None:
    """Vertices that stand on a line each, with as many numbers on each; None if they do not."""
    if not lines:
        return np.empty((0, width + 4 * coloured))
    size = len(lines[0].split())
    if size < width + 3 * coloured or any(len(line.split()) != size for line in lines):
        return None
    table = table_of(lines)
    if table is None:  # words among the numbers
        table = floats_of(b" ".join(lines)).reshape(len(lines), size)
    most = width + min(size - width, 4) * coloured
    return table[:, :most]


def _face_lines(lines: list[bytes]) -> _Faces | None:
    """Faces that stand on a line each, and their colours behind their corners; None if they do not."""
    if not lines:
        return _Faces(np.empty(0, np.int64), np.empty(0, np.int64), None, 0)
    table = table_of(lines)
    if table is not None and (table[:, 0] == table[0, 0]).all() and 0 <= table[0, 0] <= table.shape[1] - 1:
        size = int(table[0, 0])
        painted = table[:, 1 + size :]
        return _Faces(
            np.full(len(lines), size, np.int64),
            _indices(table[:, 1 : 1 + size].reshape(-1)),
            painted[:, :4] if painted.shape[1] >= 3 else None,
            len(lines) if painted.shape[1] == 1 else 0,
        )
    counts, corners = [], []
    colours = np.full((len(lines), 4), np.nan)
    by_number = 0
    for line, colour in zip(lines, colours, strict=True):
        values = floats_of(line)
        size = int(values[0]) if np.isfinite(values[0]) else -1
        if not 0 <= size <= len(values) - 1:
            return None
        counts.append(size)
        corners.append(values[1 : 1 + size])
        painted = values[1 + size : 5 + size]
        by_number += len(painted) == 1
        if len(painted) >= 3:
            colour[: len(painted)] = painted
    given = np.isfinite(colours[:, :3]).all(axis=1).any()
    return _Faces(np.array(counts, np.int64), _indices(np.concatenate(corners)), colours if given else None, by_number)


def _indices(values: np.ndarray) -> np.ndarray:
    """Whole numbers as int64; what is none becomes -1, which is out of range."""
    whole = np.isfinite(values) & (values == np.floor(values)) & (np.abs(values) < 2**53)
    return np.where(whole, values, -1).astype(np.int64)


def _colours(values: np.ndarray) -> np.ndarray:
    """Colours (n, 4) uint8 of numbers (n, 3 or 4) from 0 to 255, or from 0 to 1 if none is larger.

    Alpha is 255 where there is none, and everywhere if all is 0; what has no colour gets the default.
    """
    finite = np.where(np.isfinite(values), values, 0.0)
    scale = 255.0 if finite.max(initial=0.0) > 1 else 1.0
    colours = to_colours(values[:, :3] / scale)
    colours[~np.isfinite(values[:, :3]).all(axis=1)] = DEFAULT_COLOUR
    if values.shape[1] > 3 and (finite[:, 3] > 0).any():
        alpha = np.where(np.isfinite(values[:, 3]), values[:, 3] / scale, 1.0)
        colours[:, 3] = np.rint(np.clip(alpha, 0, 1) * 255).astype(np.uint8)
    return colours


FORMAT = Format((".off",), read, _sniff)
