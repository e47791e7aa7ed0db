"""Reader of PLY files, text and binary (.ply).

Polygons are split into triangles in the file's order; strips of triangles (`tristrips`, where -1 begins a new one)
follow them. Colours are taken from the vertices, else from the faces, else from a texture (`comment TextureFile`).
Where every alpha of a file is 0 it says nothing, and all is opaque. Read here and not by trimesh, which cannot read a
binary file whose faces differ in their number of corners, and allocates what a header claims.

Based on: Turk: The PLY Polygon File Format (1994), and what writers have added since.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.reading.blended import Alphas
from jobs.importing.reading.content import Content, whole
from jobs.importing.reading.defects import Defect
from jobs.importing.reading.faces.corners import split_by_face, strips, unify
from jobs.importing.reading.faces.polygons import Triangles, triangulate
from jobs.importing.reading.needs import TEXTURED_VERTEX, TRIANGLE, VERTEX, image_needs, text_needs
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene
from jobs.importing.reading.text.numbers import floats_of
from jobs.importing.reading.text.words import reference_of, without_mark
from jobs.importing.reading.vertex_colours import DEFAULT_COLOUR, Texture, to_colours
from storage.base.errors import ModelError
from storage.meshes.placement import IDENTITY

_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}

_CORNERS = ("vertex_indices", "vertex_index")
_ALPHAS = {"red": "alpha", "diffuse_red": "diffuse_alpha", "r": "a"}
_PLACES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))

#: Bytes of memory for each face of a file whose faces differ in their number of corners, and each of their properties.
MIXED = 260

#: A header is looked for in this many bytes from the file's start.
_HEAD = 1 << 22

_TEXTURE = re.compile(rb"(?:^|[\r\n])comment\s+TextureFile\s+([^\r\n]+)")

_END = re.compile(rb"[\r\n][ \t]*end_header[ \t]*(\r\n|\n|\r|$)")

#: Elements that are read, or say nothing of what is drawn.
_SILENT = ("vertex", "face", "tristrips", "camera")


@dataclass(frozen=True)
class _Property:
    name: str
    kind: str  # numpy type without byte order
    count: str | None  # numpy type of a list's length, None for a single value


@dataclass(frozen=True)
class _Element:
    name: str
    rows: int
    properties: list[_Property]


@dataclass(frozen=True, eq=False)
class _List:
    """A list property: all rows' values one after another."""

    counts: np.ndarray  # (rows,) int64
    values: np.ndarray  # (sum of counts,)


_Columns = dict[str, np.ndarray | _List]


def read(file: Path, content: Content, resources: Resources) -> SourceScene:
    """Read a PLY file. Raises ModelError if it is cut short or its header cannot be understood."""
    data = without_mark(whole(content))
    order, elements, texture, start = _header(file, data)
    found = _text(file, data[start:], elements) if order is None else _binary(file, data, start, order, elements)
    mesh = _mesh(file, found, elements, texture, resources)
    if mesh is None:
        return SourceScene(file, [], [])
    return SourceScene(file, [mesh], [SourceNode(0, mesh.name, IDENTITY)])


def _sniff(content: Content) -> bool:
    return without_mark(content.part(0, 7))[:4] in (b"ply\n", b"ply\r", b"ply ")


def _named_files(_file: Path, content: Content, _resources: Resources) -> Iterable[str]:
    header = content.part(0, _HEAD).partition(b"end_header")[0]
    return [reference_of(name) for name in _TEXTURE.findall(header)]


def _memory(file: Path, content: Content, resources: Resources) -> int:
    """The one mesh that the file is."""
    images = image_needs(_named_files(file, content, resources), resources)
    order, elements, texture, start = _header(file, without_mark(content.part(0, _HEAD)))
    if order is None:
        return images + text_needs(file, content, resources)
    vertex, face = (next(element for element in elements if element.name == name) for name in ("vertex", "face"))
    fixed = [sum(np.dtype(p.count or p.kind).itemsize for p in element.properties) for element in (vertex, face)]
    lists = content.size - start - fixed[0] * vertex.rows - fixed[1] * face.rows
    index = min(np.dtype(p.kind).itemsize for p in face.properties if p.count is not None)
    triangles = max(lists // index - 2 * face.rows, 0)
    mixed = MIXED * len(face.properties) * face.rows if face.rows and lists % (index * face.rows) else 0
    each = VERTEX if texture is None else VERTEX + TEXTURED_VERTEX
    return images + content.size + each * vertex.rows + TRIANGLE * triangles + mixed


def _header(file: Path, content: bytes) -> tuple[str | None, list[_Element], str | None, int]:
    """Byte order (None: text), elements, texture file and where the data starts."""
    if not content.startswith(b"ply"):
        raise ModelError(f"{file}: not a PLY file, it does not start with ply; check its extension or export it again")
    end = _END.search(content)
    if end is None:
        raise ModelError(f"{file}: the PLY header has no end; the file is cut short, export it again")
    header = content[: end.start()]
    texture = next((reference_of(name) for name in _TEXTURE.findall(header)), None)
    orders = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
    order: str | None = None
    known = False
    elements: list[_Element] = []
    for line in header.decode("latin-1").splitlines():
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order, known = orders[words[1]], True
            elif words[:1] == ["element"]:
                if int(words[2]) < 0:
                    raise ValueError
                elements.append(_Element(words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_Property(words[2], _TYPES[words[1]], None))
        except (KeyError, IndexError, ValueError):
            raise ModelError(
                f"{file}: the PLY header line {line.strip()[:60]!r} means nothing; export it again"
            ) from None
    if not known:
        raise ModelError(f"{file}: the PLY header names no format; the file is damaged, export it again")
    return order, elements, texture, end.end()


def _cut(file: Path, element: _Element) -> ModelError:
    return ModelError(
        f"{file}: {element.rows} rows of {element.name!r} are promised, but the data ends before; "
        "the file is cut short, export it again"
    )


def _binary(file: Path, content: bytes, start: int, order: str, elements: list[_Element]) -> dict[str, _Columns]:
    found: dict[str, _Columns] = {}
    for element in elements:
        least = sum(np.dtype(p.count or p.kind).itemsize for p in element.properties)
        if start + least * element.rows > len(content):
            raise _cut(file, element)
        columns, start = _uniform(content, start, order, element) or _mixed(file, content, start, order, element)
        found.setdefault(element.name, columns)
    return found


def _uniform(content: bytes, start: int, order: str, element: _Element) -> tuple[_Columns, int] | None:
    """An element whose lists are all as long as the first row's, and where it ends; None if they are not."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    at = start
    for number, p in enumerate(element.properties):
        if p.count is None:
            fields.append((f"{number}", order + p.kind))
            at += np.dtype(p.kind).itemsize
            continue
        if element.rows == 0 or at + np.dtype(p.count).itemsize > len(content):
            return ({}, start) if element.rows == 0 else None
        length = int(np.frombuffer(content, order + p.count, 1, at)[0])
        at += np.dtype(p.count).itemsize + length * np.dtype(p.kind).itemsize
        if length < 0 or at > len(content):
            return None
        fields += [(f"{number} count", order + p.count), (f"{number}", order + p.kind, (length,))]
    dtype = np.dtype(fields)
    end = start + dtype.itemsize * element.rows
    if end > len(content):
        return None
    if not dtype.itemsize:  # no properties
        return {}, start
    table = np.frombuffer(content, dtype, element.rows, start)
    columns: _Columns = {}
    for number, p in enumerate(element.properties):
        values = table[f"{number}"]
        if p.count is None:
            columns[p.name] = values
        elif (table[f"{number} count"] == values.shape[1]).all():
            columns[p.name] = _List(np.full(element.rows, values.shape[1], np.int64), values.reshape(-1))
        else:
            return None
    return columns, end


def _mixed(file: Path, content: bytes, start: int, order: str, element: _Element) -> tuple[_Columns, int]:
    """An element whose lists differ in length, row by row."""
    singles: list[list[np.ndarray]] = [[] for _ in element.properties]
    counts: list[list[int]] = [[] for _ in element.properties]
    kinds = [
        (np.dtype(order + p.kind), None if p.count is None else np.dtype(order + p.count)) for p in element.properties
    ]
    at = start
    for _ in range(element.rows):
        for number, (kind, counter) in enumerate(kinds):
            length = 1
            if counter is not None:
                if at + counter.itemsize > len(content):
                    raise _cut(file, element)
                length = int(np.frombuffer(content, counter, 1, at)[0])
                at += counter.itemsize
                counts[number].append(length)
            if length < 0 or at + length * kind.itemsize > len(content):
                raise _cut(file, element)
            singles[number].append(np.frombuffer(content, kind, length, at))
            at += length * kind.itemsize
    columns: _Columns = {}
    for number, p in enumerate(element.properties):
        values = np.concatenate(singles[number]) if singles[number] else np.empty(0)
        columns[p.name] = values if p.count is None else _List(np.array(counts[number], np.int64), values)
    return columns, at


def _text(file: Path, body: bytes, elements: list[_Element]) -> dict[str, _Columns]:
    values = floats_of(body)
    found: dict[str, _Columns] = {}
    start = 0
    for element in elements:
        width = len(element.properties)
        if start + width * element.rows > len(values):
            raise _cut(file, element)
        columns: _Columns = {}
        if not width:
            continue
        if not any(p.count for p in element.properties):
            table = values[start : start + width * element.rows].reshape(element.rows, width)
            columns = {p.name: table[:, number] for number, p in enumerate(element.properties)}
            start += table.size
        else:
            columns, start = _text_lists(file, values, start, element)
        found.setdefault(element.name, columns)
    return found


def _text_lists(file: Path, values: np.ndarray, start: int, element: _Element) -> tuple[_Columns, int]:
    """An element with lists: where each row's values lie is found row by row, the values are taken all at once."""
    places = [np.empty(element.rows, np.int64) for _ in element.properties]
    counts = [np.ones(element.rows, np.int64) for _ in element.properties]
    at, total = start, len(values)
    lengths = (
        np.where((values >= 0) & (values < total) & (values == np.floor(values)), values, -1).astype(np.int64).tolist()
    )
    for row in range(element.rows):
        for number, p in enumerate(element.properties):
            length = 1
            if p.count is not None:
                length = lengths[at] if at < total else -1
                at += 1
                counts[number][row] = length
            if length < 0 or at + length > total:
                raise _cut(file, element)
            places[number][row] = at
            at += length
    columns: _Columns = {}
    for number, p in enumerate(element.properties):
        size = counts[number]
        index = np.repeat(places[number] - (np.cumsum(size) - size), size) + np.arange(size.sum())
        taken = values[index]
        columns[p.name] = taken if p.count is None else _List(size, taken)
    return columns, at


def _mesh(
    file: Path, found: dict[str, _Columns], elements: list[_Element], texture: str | None, resources: Resources
) -> SourceMesh | None:
    vertex, face = found.get("vertex", {}), found.get("face", {})
    defects = _passed_over(elements)
    polygons = next((face[name] for name in _CORNERS if isinstance(face.get(name), _List)), None)
    position = _stack(vertex, ("x", "y", "z"))
    if not isinstance(polygons, _List):
        rows = sum(element.rows for element in elements if element.name == "face")
        defects[Defect.UNSUPPORTED] = defects.get(Defect.UNSUPPORTED, 0) + rows
        polygons = _List(np.empty(0, np.int64), np.empty(0, np.int64))
    stripped = _strips(found.get("tristrips", {}))
    if not len(polygons.counts) and not len(stripped):
        return None
    if position is None:
        raise ModelError(f"{file}: the vertices have no x, y and z; export the model again")
    corners = _indices(polygons.values)
    cut = triangulate(position, corners, polygons.counts)
    triangles = np.concatenate([corners[cut.corners], stripped])
    defects[Defect.POLYGON] = int(np.count_nonzero(polygons.counts < 3))
    defects[Defect.CROSSING] = cut.crossing
    colours = _colours(vertex, elements, "vertex", defects)
    alphas = Alphas()
    mesh = SourceMesh(file.stem, position, triangles, _stack(vertex, ("nx", "ny", "nz")), colours, defects)
    if colours is None and texture is not None:
        _texture(file, mesh, Texture.decode(resources.read(texture)), vertex, face, polygons, cut, alphas)
    elif colours is None and (painted := _colours(face, elements, "face", defects)) is not None:
        plain = np.tile(np.array(DEFAULT_COLOUR, np.uint8), (len(stripped), 1))
        split_by_face(mesh, np.concatenate([np.repeat(painted, cut.counts, axis=0), plain]))
    alphas.blend(mesh)
    mesh.defects = {defect: count for defect, count in defects.items() if count}
    return mesh if len(triangles) else None


def _passed_over(elements: list[_Element]) -> dict[Defect, int]:
    """Rows of elements that are not read."""
    defects: dict[Defect, int] = {}
    for element in elements:
        if element.name in _SILENT or not element.rows:
            continue
        lists = any(p.count is not None for p in element.properties)
        unread = Defect.UNSUPPORTED if lists else Defect.UNKNOWN
        defect = Defect.NOT_TRIANGLES if element.name == "edge" else unread
        defects[defect] = defects.get(defect, 0) + element.rows
    return defects


def _strips(element: _Columns) -> np.ndarray:
    """Triangles (m, 3) int64 of strips; in a strip -1 begins a new one."""
    lists = next((element[name] for name in _CORNERS if isinstance(element.get(name), _List)), None)
    if not isinstance(lists, _List):
        return np.empty((0, 3), np.int64)
    index = _indices(lists.values)
    ends = np.zeros(len(index) + 1, bool)
    ends[np.cumsum(lists.counts)] = True
    breaks = np.flatnonzero(index == -1)
    starts = np.unique(np.concatenate([[0], np.flatnonzero(ends), breaks, breaks + 1]))
    sizes = np.diff(np.append(starts, len(index)))
    return index[strips(starts, sizes)]


def _texture(
    file: Path,
    mesh: SourceMesh,
    image: Texture | None,
    vertex: _Columns,
    face: _Columns,
    polygons: _List,
    cut: Triangles,
    alphas: Alphas,
) -> None:
    """Colour a mesh by its texture, at the corners' texture coordinates or else the vertices'."""
    corners = face.get("texcoord")
    places = next((pair for names in _PLACES if (pair := _stack(vertex, names)) is not None), None)
    by_corner = isinstance(corners, _List)
    if image is None or (places is None and not by_corner):
        mesh.defects[Defect.NO_TEXTURE] = 1
        return
    if isinstance(corners, _List):
        if not np.array_equal(corners.counts, 2 * polygons.counts):
            raise ModelError(f"{file}: the faces have texture coordinates that do not match; export the model again")
        textured = np.arange(len(mesh.triangles)) < len(cut.corners)
        at = np.zeros((len(textured), 3, 2))
        at[textured] = corners.values.reshape(-1, 2).astype(np.float64)[cut.corners]
        places = _split_by_place(mesh, at.reshape(-1, 2))
    else:
        textured = np.ones(len(mesh.triangles), bool)
    if places is None:
        return
    places = np.stack([places[:, 0], 1 - places[:, 1]], axis=1)
    inside = ((mesh.triangles >= 0) & (mesh.triangles < len(mesh.positions))).all(axis=1) & textured
    mesh.colours = image.sample(places, mesh.triangles[inside])
    mesh.colours[:, 3] = 255
    alphas.take(inside, image.alpha, places, mesh.triangles)


def _stack(columns: _Columns, names: tuple[str, ...]) -> np.ndarray | None:
    """Single-valued columns side by side, float64; None unless all are there."""
    values = [columns.get(name) for name in names]
    arrays = [value for value in values if isinstance(value, np.ndarray)]
    return np.stack([array.astype(np.float64) for array in arrays], axis=1) if len(arrays) == len(names) else None


def _indices(values: np.ndarray) -> np.ndarray:
    """Whole numbers as int64; what is none becomes -1, which is out of range."""
    if values.dtype.kind in "iu":
        return values.astype(np.int64)
    whole = np.isfinite(values) & (values == np.floor(values)) & (np.abs(values) < 2**53)
    return np.where(whole, values, -1).astype(np.int64)


def _colours(
    columns: _Columns, elements: list[_Element], element: str, defects: dict[Defect, int]
) -> np.ndarray | None:
    """An element's colours (n, 4) uint8, None if it has none."""
    kinds = {p.name: p.kind for e in elements if e.name == element for p in e.properties}
    for names in (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")):
        values = _stack(columns, names)
        if values is None:
            continue
        alpha = _stack(columns, (_ALPHAS[names[0]],))
        if alpha is not None and (alpha > 0).any():
            values = np.concatenate([values, alpha], axis=1)
        kind = np.dtype(kinds[names[0]])
        if kind.kind in "iu":
            values = values / np.iinfo(kind).max
        elif np.nanmax(np.where(np.isfinite(values), values, 0), initial=0.0) > 1:  # some write up to 255
            values = values / 255
        bad = ~np.isfinite(values).all(axis=1)
        if bad.any():
            defects[Defect.COLOUR] = defects.get(Defect.COLOUR, 0) + int(bad.sum())
        colours = to_colours(values)
        colours[bad] = DEFAULT_COLOUR
        return colours
    return None


def _split_by_place(mesh: SourceMesh, places: np.ndarray) -> np.ndarray:
    """Split a mesh's vertices where their corners' texture coordinates (3 m, 2) differ; returns those of the vertices
    (n, 2).
    """
    flat = mesh.triangles.reshape(-1)
    valid = (flat >= 0) & (flat < len(mesh.positions))
    vertex_bits = np.where(valid, flat, -1)[:, None].view(np.float64)
    kept, vertex = unify(np.concatenate([vertex_bits, places + 0.0], axis=1))
    source = np.where(valid, flat, 0)[kept]
    mesh.positions = mesh.positions[source]
    if mesh.normals is not None:
        mesh.normals = mesh.normals[source]
    mesh.triangles = np.where(valid, vertex, -1).reshape(-1, 3)
    return places[kept]


FORMAT = Format((".ply",), read, _sniff, _named_files, _memory)
