"""Reader of OFF files as text (.off), with colours (COFF) and normals (NOFF) if they have them.

Polygons are split into fans of triangles from their first corner, in the file's order. Read here and not by trimesh,
which refuses a whole file for one index out of range and drops colours.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.reading.content import Content, whole
from jobs.importing.reading.corners import fan, split_by_face
from jobs.importing.reading.defects import Defect
from jobs.importing.reading.numbers import floats_of, rows_of, table_of
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene
from jobs.importing.reading.vertex_colours import to_colours
from storage.base.errors import ModelError
from storage.meshes.placement import IDENTITY

_HEAD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF\b")


def read(file: Path, content: Content, resources: Resources) -> SourceScene:  # noqa: ARG001  OFF names no other files
    """Read an OFF file. Raises ModelError if it is cut short or of a variant that is not read."""
    text = re.sub(rb"#[^\n]*", b"", whole(content).replace(b"\r", b"\n"))
    head = _HEAD.match(text)
    if head is None:
        raise ModelError(f"{file}: not an OFF file, it does not start with OFF; check its extension or export it again")
    lines = [line for line in text[head.end() :].split(b"\n") if line.strip()]
    if head[1] or head[4] or head[5] or (lines and lines[0].strip().startswith(b"BINARY")):
        raise ModelError(f"{file}: a binary, textured or higher-dimensional OFF file; only plain text OFF is read")
    sizes = floats_of(lines[0]) if lines else np.empty(0)
    if len(sizes) < 2 or not np.isfinite(sizes[:2]).all() or (sizes[:2] < 0).any():
        raise ModelError(f"{file}: the counts of vertices and faces are missing; the file is damaged or cut short")
    vertices, faces = (int(size) for size in sizes[:2])
    if 1 + vertices + faces > len(lines):
        raise ModelError(
            f"{file}: {vertices} vertices and {faces} faces are promised, but there are only {len(lines) - 1} lines; "
            "the file is cut short, export it again"
        )
    counts, corners, face_colours = _faces(file, lines[1 + vertices : 1 + vertices + faces])
    width = 3 + 3 * bool(head[3]) + 4 * bool(head[2])
    table = rows_of(lines[1 : 1 + vertices], max(width, 3))
    colours = None
    if head[2]:
        painted = table[:, -4:]
        painted[np.isnan(painted[:, 3]), 3] = 255 if np.nanmax(painted[:, :3], initial=0) > 1 else 1
        colours = _colours(painted)
    defects = {Defect.POLYGON: int(np.count_nonzero(counts < 3))}
    mesh = SourceMesh(
        file.stem,
        table[:, :3],
        corners[fan(counts)],
        table[:, 3:6] if head[3] else None,
        colours,
        {defect: count for defect, count in defects.items() if count},
    )
    if colours is None and face_colours is not None:
        split_by_face(mesh, np.repeat(face_colours, np.maximum(counts - 2, 0), axis=0))
    return SourceScene(file, [mesh] if len(mesh.triangles) else [], [SourceNode(0, mesh.name, IDENTITY)])


def _sniff(content: Content) -> bool:
    return content.part(0, 5).startswith((b"OFF\n", b"OFF\r", b"COFF\n", b"COFF\r"))


def _faces(file: Path, lines: list[bytes]) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Corners of each face (f,), all corners' indices (c,), and the faces' colours (f, 4) uint8 if all have one."""
    if not lines:
        return np.empty(0, np.int64), np.empty(0, np.int64), None
    table = table_of(lines)
    if table is not None and (table[:, 0] == table[0, 0]).all() and 0 <= table[0, 0] <= table.shape[1] - 1:
        size = int(table[0, 0])
        colours = _colours(table[:, 1 + size :]) if table.shape[1] - 1 - size in (3, 4) else None
        return np.full(len(lines), size, np.int64), _indices(table[:, 1 : 1 + size].reshape(-1)), colours
    counts, corners, painted = [], [], []
    for line in lines:
        values = floats_of(line)
        size = int(values[0]) if np.isfinite(values[0]) else -1
        if not 0 <= size <= len(values) - 1:
            raise ModelError(
                f"{file}: a face of {size} corners has {len(values) - 1} numbers; the file is damaged or cut short"
            )
        counts.append(size)
        corners.append(values[1 : 1 + size])
        painted.append(values[1 + size : 5 + size])
    width = len(painted[0])
    same = width in (3, 4) and all(len(values) == width for values in painted)
    return np.array(counts, np.int64), _indices(np.concatenate(corners)), _colours(np.array(painted)) if same else None


def _indices(values: np.ndarray) -> np.ndarray:
    """Whole numbers as int64; what is none becomes -1, which is out of range."""
    whole = np.isfinite(values) & (values == np.floor(values)) & (np.abs(values) < 2**53)
    return np.where(whole, values, -1).astype(np.int64)


def _colours(values: np.ndarray) -> np.ndarray:
    """Colours (n, 4) uint8 of numbers from 0 to 255, or from 0 to 1 if none is larger."""
    return to_colours(values / 255 if np.nanmax(values, initial=0) > 1 else values)


FORMAT = Format((".off",), read, _sniff)
