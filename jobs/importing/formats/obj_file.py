"""Reader of Wavefront OBJ files with their material libraries (.obj, .mtl).

A part is a group: faces under the same `o` and `g` names, wherever they stand in the file; a file without either is one
part. Faces of a part keep the file's order and are split into triangles: a part's face numbers count those triangles.
Vertices are split where position, texture coordinates, normal or material differ. Statements that draw something which
is not read, and those that are not known, are counted by part.

Read here and not by trimesh, which sorts faces by material, drops group names, resolves relative indices against the
whole file, wraps or fails on indices out of range, and says nothing of missing libraries and textures. The file is read
in chunks, and each chunk's numbers are parsed all at once. Numbers are held for the whole file, since any face may use
any vertex; parts are made of them one by one.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.formats.obj_materials import Material, material_named, named_textures, read_materials
from jobs.importing.reading.blended import Alphas
from jobs.importing.reading.content import Content
from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.faces.corners import unify
from jobs.importing.reading.faces.polygons import triangulate
from jobs.importing.reading.needs import image_needs
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene, UnreadMeshes
from jobs.importing.reading.text.numbers import integers_of, rows_of, table_of
from jobs.importing.reading.text.words import name_of, reference_of, without_mark
from jobs.importing.reading.vertex_colours import DEFAULT_COLOUR, to_colours
from storage.meshes.placement import IDENTITY

_CHUNK = 1 << 23

#: Far more vertices than a file can hold: indices are clipped to it, which leaves them out of range.
_MOST = (1 << 31) - 1

#: Bytes of memory for each number, and each corner of a face, that a file holds; for each corner of its largest part;
#: the same if it is textured; and for the lines that are parsed at once.
HELD, CORNER, TEXTURED_CORNER, LINES = 52, 180, 330, 70 << 20

#: Statements that draw something which is not read.
_KNOWN = {
    **dict.fromkeys((b"l", b"p"), Defect.NOT_TRIANGLES),
    **dict.fromkeys((b"curv", b"curv2", b"surf", b"bsp", b"bzp", b"cdc", b"cdp"), Defect.FREE_FORM),
    **dict.fromkeys((b"call", b"csh", b"usemap"), Defect.UNSUPPORTED),
}

#: Statements that change nothing of what is read: smoothing, display, and what belongs to free-form geometry.
_SILENT = frozenset(
    b"s mg lod bevel c_interp d_interp maplib shadow_obj trace_obj ctech stech con res "
    b"cstype deg bmat step vp parm trim hole scrv sp end v vt vn f fo usemtl mtllib".split()
)

_LIBRARY = re.compile(rb"^[^\S\n]*mtllib[^\S\n]+([^\n]*)", re.MULTILINE)
_GROUP = re.compile(rb"^[ \t]*[go][ \t]+([^\r\n]*)", re.MULTILINE)


def read(file: Path, content: Content, resources: Resources) -> SourceScene:
    """Read an OBJ file."""
    tally = Tally()
    lines = _Lines(file.stem)
    for chunk in _chunks(content):
        lines.take(chunk)
    for (defect, part), count in lines.passed_over.items():
        tally.add(defect, part, count)
    materials, complete = read_materials(lines.libraries, resources, tally, file.name)
    vertices = lines.vertices()
    names = list(lines.material_names)
    parts = lines.parts()
    complete = complete or not lines.libraries
    meshes = UnreadMeshes(
        len(parts.names), lambda number: _mesh(parts.part(number), vertices, names, materials, complete)
    )
    nodes = [SourceNode(i, name, IDENTITY) for i, name in enumerate(parts.names)]
    return SourceScene(file, meshes, nodes, usual_up="y", tally=tally)


def _named_files(_file: Path, content: Content, resources: Resources) -> Iterator[str]:
    """Material libraries, and the textures that they name."""
    for chunk in _chunks(content):
        for library in _libraries(chunk):
            yield from _library_files(library, resources)


def _memory(_file: Path, content: Content, resources: Resources) -> int:
    """All numbers, the part with most corners, and the textures."""
    corners: Counter[bytes] = Counter()
    rows, textured = 0, False
    name = b""
    files: list[str] = []
    for text in _chunks(content):
        groups = list(_GROUP.finditer(text))
        starts = [0, *(group.end() for group in groups)]
        ends = [*(group.start() for group in groups), len(text)]
        names = [name, *(group[1] for group in groups)]
        for part, first, last in zip(names, starts, ends, strict=True):
            positions, places, normals = (text.count(key, first, last) for key in (b"v ", b"vt ", b"vn "))
            blanks = text.count(b" ", first, last) + text.count(b"\t", first, last)
            corners[part] += max(blanks - 3 * positions - 2 * places - 3 * normals, 0)
            rows += positions + places + normals
            textured = textured or places > 0
        name = names[-1]
        for library in _libraries(text):
            files.extend(_library_files(library, resources))
    each = TEXTURED_CORNER if textured else CORNER
    numbers = HELD * (corners.total() + rows) + each * max(corners.values(), default=0)
    return LINES + numbers + image_needs(files, resources)


def _libraries(chunk: bytes) -> list[str]:
    return [reference_of(name) for name in _LIBRARY.findall(chunk)] if b"mtllib" in chunk else []


def _library_files(library: str, resources: Resources) -> Iterable[str]:
    return [library, *named_textures(resources.read(library) or b"")]


def _chunks(content: Content) -> Iterator[bytes]:
    """The content in whole lines, continued lines joined."""
    starts = range(0, content.size, _CHUNK)
    old = not any(b"\n" in content.part(start, start + _CHUNK) for start in starts)  # lines end with \r alone
    text = b""
    for start in starts:
        block = content.part(start, start + _CHUNK)
        block = block if start else without_mark(block)
        text += block.replace(b"\r", b"\n") if old else block
        if (end := _end_of_lines(text)) > 0:
            yield _joined(text[:end])
            text = text[end:]
    if text:
        yield _joined(text)


def _end_of_lines(text: bytes) -> int:
    """Where the line ends that begins or goes on at _CHUNK, with all that continue it; -1 if it does not end."""
    end = text.find(b"\n", _CHUNK)
    while end > 0 and text[:end].rstrip(b"\r").endswith(b"\\"):
        end = text.find(b"\n", end + 1)
    return end + 1 if end > 0 else -1


def _joined(lines: bytes) -> bytes:
    return lines.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ") if b"\\" in lines else lines


@dataclass(frozen=True, eq=False)
class _Part:
    """A group's faces."""

    name: str
    counts: np.ndarray  # (f,) corners of each face
    corners: np.ndarray  # (c, 3) indices of position, texture coordinates, normal; negative: none or out of range
    materials: np.ndarray  # (f,) numbers of material names


@dataclass(frozen=True, eq=False)
class _Parts:
    """The groups that have faces, in the order of their first face."""

    names: list[str]
    ends: list[int]  # of each one's faces in `order`
    order: np.ndarray  # (f,) all faces, part by part
    counts: np.ndarray  # (f,) corners of each face
    starts: np.ndarray  # (f,) first corner of each face
    corners: np.ndarray  # (c, 3) see _Part
    materials: np.ndarray  # (f,) numbers of material names

    def part(self, number: int) -> _Part:
        """One of them."""
        faces = self.order[self.ends[number - 1] if number else 0 : self.ends[number]]
        sizes = self.counts[faces].astype(np.int64)
        rows = np.repeat(self.starts[faces] - (np.cumsum(sizes) - sizes), sizes) + np.arange(sizes.sum())
        return _Part(self.names[number], sizes, self.corners[rows], self.materials[faces])


@dataclass(frozen=True, eq=False)
class _Vertices:
    """What corners index."""

    positions: np.ndarray  # (n, 3)
    places: np.ndarray  # (t, 2) texture coordinates
    normals: np.ndarray  # (k, 3)
    colours: np.ndarray  # (n, 3) 0 to 1; (0, 3) if none was given
    given: np.ndarray  # (n,) bool, whether the file gave a colour


@dataclass(eq=False)
class _Lines:
    """What the lines of a file say, gathered chunk by chunk."""

    stem: str
    positions: list[np.ndarray] = field(default_factory=list)  # (n, 3) float64
    colours: list[np.ndarray] = field(default_factory=list)  # (n, 3) float64, 0 to 1
    given: list[np.ndarray] = field(default_factory=list)  # (n,) whether a file gave a colour
    places: list[np.ndarray] = field(default_factory=list)  # (n, 2) texture coordinates
    normals: list[np.ndarray] = field(default_factory=list)  # (n, 3)
    counts: list[np.ndarray] = field(default_factory=list)
    corners: list[np.ndarray] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)
    material_names: dict[str, int] = field(default_factory=dict)
    part_names: dict[str, int] = field(default_factory=dict)
    #: (first face, part, material) of each run of faces of one part and material
    runs: list[tuple[int, int, int]] = field(default_factory=list)
    #: what is not read, by the name of the part that it stands in
    passed_over: Counter[tuple[Defect, str]] = field(default_factory=Counter)
    _totals: list[int] = field(default_factory=lambda: [0, 0, 0])  # positions, texture coordinates, normals so far
    _faces: int = 0
    _object: str = ""
    _group: str = ""
    _material: str = ""

    def take(self, chunk: bytes) -> None:
        """Read some more lines."""
        vertices: list[bytes] = []
        places: list[bytes] = []
        normals: list[bytes] = []
        faces: list[bytes] = []
        totals = self._totals
        marks: list[tuple[int, int, int, int]] = []  # (face, totals before it), where totals changed
        changed, moved = True, True
        for line in chunk.split(b"\n"):
            words = line.split(None, 1)
            if len(words) < 2:
                if words and words[0] in (b"g", b"o"):
                    self._name(words[0], "")
                    moved = True
                elif words:
                    self._pass_over(words[0])
                continue
            key, rest = words
            if key == b"v":
                vertices.append(rest)
                changed = True
            elif key in (b"f", b"fo"):
                if changed:
                    marks.append(
                        (len(faces), totals[0] + len(vertices), totals[1] + len(places), totals[2] + len(normals))
                    )
                    changed = False
                if moved:
                    self._start_run(len(faces))
                    moved = False
                faces.append(rest)
            elif key == b"vt":
                places.append(rest)
                changed = True
            elif key == b"vn":
                normals.append(rest)
                changed = True
            elif key in (b"g", b"o"):
                self._name(key, name_of(rest))
                moved = True
            elif key == b"usemtl":
                self._material = name_of(rest)
                moved = True
            elif key == b"mtllib":
                self.libraries.append(reference_of(rest))
            else:
                self._pass_over(key)
        self._take_vertices(vertices)
        self.places.append(rows_of(places, 2))
        self.normals.append(rows_of(normals, 3))
        if faces:
            self._take_faces(faces, marks)
        self._totals = [totals[0] + len(vertices), totals[1] + len(places), totals[2] + len(normals)]

    def vertices(self) -> _Vertices:
        """All that corners index."""
        given = _taken(self.given, np.empty(0, bool))
        if not given.any():
            self.colours.clear()
        elif max(float(np.nanmax(part, initial=0.0)) for part in self.colours) > 1:
            self.colours[:] = [part / 255 for part in self.colours]
        return _Vertices(
            _taken(self.positions, np.empty((0, 3))),
            _taken(self.places, np.empty((0, 2))),
            _taken(self.normals, np.empty((0, 3))),
            _taken(self.colours, np.empty((0, 3))),
            given,
        )

    def parts(self) -> _Parts:
        """All groups that have faces."""
        counts = _taken(self.counts, np.empty(0, np.int64))
        lengths = np.diff([*(run[0] for run in self.runs), len(counts)])
        part = np.repeat(np.array([run[1] for run in self.runs], np.int32), lengths)
        sizes = np.bincount(part, minlength=len(self.part_names))
        return _Parts(
            [name or self.stem for name, size in zip(self.part_names, sizes.tolist(), strict=True) if size],
            np.cumsum(sizes[sizes > 0]).tolist(),
            np.argsort(part, kind="stable"),
            counts.astype(np.int32),
            np.cumsum(counts) - counts,
            _taken(self.corners, np.empty((0, 3), np.int32)),
            np.repeat(np.array([run[2] for run in self.runs], np.int32), lengths),
        )

    def _name(self, key: bytes, name: str) -> None:
        if key == b"o":
            self._object, self._group = name, ""
        else:
            self._group = name

    def _part(self) -> str:
        return "/".join(step for step in (self._object, self._group) if step)

    def _pass_over(self, key: bytes) -> None:
        """Note a statement that is not read."""
        if key in _SILENT or key.startswith(b"#"):
            return
        defect = _KNOWN.get(key, Defect.UNKNOWN)
        self.passed_over[defect, self._part() or self.stem] += 1

    def _start_run(self, faces: int) -> None:
        name = self._part()
        part = self.part_names.setdefault(name, len(self.part_names))
        material = self.material_names.setdefault(self._material, len(self.material_names))
        self.runs.append((self._faces + faces, part, material))

    def _take_vertices(self, lines: list[bytes]) -> None:
        """Positions, and colours where a line has six numbers, or seven with a weight before them."""
        if not lines:
            return
        values = table_of(lines)
        if values is None:
            values = rows_of(lines, 6)
            given = np.isfinite(values[:, 3:]).any(axis=1)
        else:
            given = np.full(len(lines), values.shape[1] in (6, 7))
        self.positions.append(np.ascontiguousarray(values[:, :3]) if values.shape[1] >= 3 else rows_of(lines, 3))
        self.colours.append(values[:, -3:] if given.any() else np.broadcast_to(np.nan, (len(lines), 3)))
        self.given.append(given)

    def _take_faces(self, lines: list[bytes], marks: list[tuple[int, int, int, int]]) -> None:
        counts, corners = _corners(lines)
        mark = np.array(marks, np.int64)
        lengths = np.diff(np.append(mark[:, 0], len(lines)))
        for column in range(3):
            index = corners[:, column]
            relative = index < 0
            if relative.any():
                total = np.repeat(np.repeat(mark[:, 1 + column], lengths), counts)
                index[relative] += total[relative]
            index[~relative] -= 1
        self.counts.append(counts)
        self.corners.append(np.clip(corners, -1, _MOST).astype(np.int32))
        self._faces += len(lines)


def _taken(arrays: list[np.ndarray], none: np.ndarray) -> np.ndarray:
    """All rows of the arrays, which the list holds no more; `none` stands for an empty list."""
    rows = np.concatenate([none, *arrays])
    arrays.clear()
    return rows


def _corners(lines: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
    """Corners of each face (f,), and each corner's three numbers as written (c, 3), 0 where there is none."""
    counts = np.array([len(line.split()) for line in lines], np.int64)
    slashes = np.array([line.count(b"/") for line in lines], np.int64)
    each = np.where(slashes == slashes // np.maximum(counts, 1) * counts, slashes // np.maximum(counts, 1), -1)
    slow = (each < 0) | (each > 2)
    forms: list[tuple[np.ndarray, np.ndarray]] = []  # faces whose corners are written alike, with all their numbers
    for form in range(3):  # a, a/b, a/b/c
        faces = np.flatnonzero(each == form)
        text = b" ".join(lines if len(faces) == len(lines) else [lines[face] for face in faces.tolist()])
        values = integers_of(text.replace(b"//", b"/0/").replace(b"/", b" "))
        if values is None or len(values) != int(counts[faces].sum()) * (form + 1):
            slow[faces] = True
        else:
            forms.append((faces, values.reshape(-1, form + 1)))
    odd = {face: _odd_corners(lines[face]) for face in np.flatnonzero(slow).tolist()}
    for face, rows in odd.items():
        counts[face] = len(rows)
    starts = np.cumsum(counts) - counts
    corners = np.zeros((int(counts.sum()), 3), np.int64)
    for faces, values in forms:
        sizes = counts[faces]
        at = np.repeat(starts[faces] - (np.cumsum(sizes) - sizes), sizes) + np.arange(len(values))
        corners[at, : values.shape[1]] = values
    for face, rows in odd.items():
        corners[starts[face] : starts[face] + len(rows)] = rows
    return counts, corners


def _odd_corners(line: bytes) -> np.ndarray:
    """The same for one face with comments, mixed forms or words that are no numbers, which become 0."""
    rows = [[_integer(step) for step in word.split(b"/")[:3]] for word in line.split(b"#")[0].split()]
    return np.array([row + [0] * (3 - len(row)) for row in rows], np.int64).reshape(-1, 3)


def _integer(text: bytes) -> int:
    try:
        return min(max(int(text), -_MOST), _MOST)
    except ValueError:
        return 0


def _mesh(
    part: _Part, vertices: _Vertices, names: list[str], materials: dict[str, Material], complete: bool
) -> SourceMesh:
    """One part: its triangles, and vertices with colours. `names` are the materials'; `complete`: all were to be
    found.
    """
    defects = {Defect.POLYGON: int(np.count_nonzero(part.counts < 3))}
    surfaces = [material_named(materials, name) for name in names]
    cut = triangulate(vertices.positions, part.corners[:, 0], part.counts)
    defects[Defect.CROSSING] = cut.crossing
    material = np.repeat(part.materials, cut.counts)
    corners = part.corners[cut.corners.reshape(-1)].astype(np.int64)
    sizes = (len(vertices.positions), len(vertices.places), len(vertices.normals))
    position, place, normal = (np.where(corners[:, i] < size, corners[:, i], -1) for i, size in enumerate(sizes))
    which = np.repeat(material, 3)
    textured = np.array([surface is not None and surface.textured for surface in surfaces])
    place[~textured[which]] = -1
    kept, vertex = unify(np.stack([(position << 32) + place, (normal << 32) + which], axis=1))
    triangles = np.where(position >= 0, vertex, -1).reshape(-1, 3)
    position, place, normal, which = position[kept], place[kept], normal[kept], which[kept]

    colours = np.full((len(kept), 4), DEFAULT_COLOUR, np.uint8)
    painted = np.zeros(len(kept), bool)
    alphas = Alphas()
    if vertices.given.any():
        given = vertices.colours[position]
        painted = np.isfinite(given).all(axis=1) & (position >= 0)
        colours[painted] = to_colours(given[painted])
        defects[Defect.COLOUR] = int(np.count_nonzero(vertices.given[position] & ~painted & (position >= 0)))
    for index in np.unique(material).tolist():
        surface = surfaces[index]
        if surface is None:
            unknown = bool(names[index]) and complete
            defects[Defect.NO_MATERIAL] = defects.get(Defect.NO_MATERIAL, 0) + unknown
            continue
        defects[Defect.NO_TEXTURE] = defects.get(Defect.NO_TEXTURE, 0) + surface.missing
        defects[Defect.COLOUR] = defects.get(Defect.COLOUR, 0) + surface.not_finite
        mine = which == index
        colours[mine & ~painted] = surface.colour
        colours[mine, 3] = surface.colour[3]
        has = mine & (place >= 0)
        if has.any():
            own = (material == index) & (triangles >= 0).all(axis=1)
            coordinates = np.zeros((len(kept), 2))
            coordinates[has] = vertices.places[place[has]]
            surface.apply(colours, alphas, has, coordinates, own, triangles)
    normals = np.zeros((len(kept), 3))
    normals[normal >= 0] = vertices.normals[normal[normal >= 0]]
    positions = np.zeros((len(kept), 3))
    positions[position >= 0] = vertices.positions[position[position >= 0]]
    mesh = SourceMesh(part.name, positions, triangles, normals, colours, {d: n for d, n in defects.items() if n})
    alphas.blend(mesh)
    return mesh


FORMAT = Format((".obj",), read, named_files=_named_files, memory=_memory)
