"""How much memory an import takes, before it is begun: from headers and counts, never from the geometry itself.

    glTF           its JSON header, and its largest mesh
    PLY, STL       the one mesh that the file is
    OBJ            all its numbers, and the part with most corners
    OFF, DAE, and text of the others    a multiple of the file's size

Files are imported one after the other, so the one that takes most counts. The constants are measured, on meshes that
share their vertices and on triangle soups, and rounded up.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from jobs.importing.formats.gltf_file import TEXTURES_KEPT, unpack
from jobs.importing.formats.ply_file import read_header
from jobs.importing.inputs import model_files
from jobs.importing.read import find_files
from jobs.importing.reading.content import Content, FileContent

#: Bytes for each vertex and each triangle of a mesh while it is read, repaired and written.
VERTEX, TRIANGLE = 290, 110

#: Bytes for each vertex of a mesh that is textured, for each texel that is held, and of the image that is read.
TEXTURED_VERTEX, HELD_TEXEL, TEXEL = 330, 6, 60

#: Bytes for each byte of a glTF file's JSON: it is held as objects, and its nodes become placements.
JSON = 10

#: Bytes for each facet of a binary STL file.
FACET = 760

#: Bytes for each number, and each corner of a face, that an OBJ file holds; for each corner of its largest part; the
#: same if it is textured; and for the lines that are parsed at once.
OBJ_HELD, OBJ_CORNER, OBJ_TEXTURED_CORNER, OBJ_LINES = 52, 180, 330, 70 << 20

#: Bytes for each face of a PLY file whose faces differ in their number of corners, and each of their properties.
PLY_MIXED = 260

#: Bytes for each byte of a file that is text, and is read whole.
TEXT = 20

#: Bytes that are looked through at once.
_BLOCK = 1 << 22

#: An image's size is found in this many bytes from its file's start; if not, each byte counts as that many texels.
_IMAGE_HEAD, _TEXELS = 1 << 16, 20

_IMAGES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tga", ".tif", ".tiff", ".gif", ".dds", ".ppm")
_MARK = re.compile(rb"^[ \t]*[go][ \t]+([^\r\n]*)", re.MULTILINE)


def import_memory(inputs: Sequence[Path]) -> int:
    """Bytes that importing files or folders may take, beside what a process takes anyway: an upper estimate.

    A file that cannot be understood counts nothing: the import says what is wrong with it. Raises ModelError for inputs
    that name no model.
    """
    return max(_of_file(file) for file, _ in find_files(inputs))


def _of_file(file: Path) -> int:
    content = FileContent(file)
    try:
        texels = [_texels(image) for image in model_files(file) if image.suffix.lower() in _IMAGES]
        held = TEXEL * max(texels, default=0) + HELD_TEXEL * sum(texels)
        return held + _KINDS.get(file.suffix.lower(), _text)(file, content)
    except Exception:  # as many kinds as there are kinds of damage
        return 0


def _texels(image: Path, start: int = 0, size: int | None = None) -> int:
    """Texels of an image of `size` bytes that begins somewhere in a file."""
    from PIL import Image

    content = FileContent(image)
    size = content.size if size is None else size
    try:
        with Image.open(io.BytesIO(content.part(start, start + min(size, _IMAGE_HEAD)))) as found:
            return found.width * found.height
    except Exception:  # Pillow raises almost anything on what it does not know, or needs more of
        return _TEXELS * size


def _gltf(file: Path, content: Content) -> int:
    header, chunk = unpack(file, content)
    accessors = header.get("accessors", [])
    inline = sum(
        len(buffer["uri"]) for buffer in header.get("buffers", ()) if buffer.get("uri", "").startswith("data:")
    )
    textured = bool(header.get("textures"))
    largest = texels = 0
    for mesh in header.get("meshes", ()):
        need = 0
        for primitive in mesh["primitives"]:
            vertices = int(accessors[primitive["attributes"]["POSITION"]]["count"])
            corners = int(accessors[primitive["indices"]]["count"]) if "indices" in primitive else vertices
            triangles = corners // 3 if primitive.get("mode", 4) == 4 else corners
            need += (VERTEX + TEXTURED_VERTEX * textured) * vertices + TRIANGLE * triangles
        largest = max(largest, need)
    if chunk is not None:
        for image in header.get("images", ()):
            if "bufferView" in image:
                view = header["bufferViews"][image["bufferView"]]
                start = content.size - chunk.size + view.get("byteOffset", 0)
                texels = max(texels, _texels(file, start, view["byteLength"]))
    text = content.size - (chunk.size if chunk is not None else 0)
    return JSON * (text - inline) + 4 * inline + largest + TEXEL * texels + TEXTURES_KEPT * textured


def _ply(file: Path, content: Content) -> int:
    order, elements, texture, start = read_header(file, content.part(0, _BLOCK))
    if order is None:
        return _text(file, content)
    vertex, face = (next(element for element in elements if element.name == name) for name in ("vertex", "face"))
    fixed = [sum(np.dtype(p.count or p.kind).itemsize for p in element.properties) for element in (vertex, face)]
    lists = content.size - start - fixed[0] * vertex.rows - fixed[1] * face.rows
    index = min(np.dtype(p.kind).itemsize for p in face.properties if p.count is not None)
    triangles = max(lists // index - 2 * face.rows, 0)
    mixed = PLY_MIXED * len(face.properties) * face.rows if face.rows and lists % (index * face.rows) else 0
    each = VERTEX if texture is None else VERTEX + TEXTURED_VERTEX
    return content.size + each * vertex.rows + TRIANGLE * triangles + mixed


def _stl(file: Path, content: Content) -> int:
    facets = int.from_bytes(content.part(80, 84), "little")
    return FACET * facets if content.size == 84 + 50 * facets else _text(file, content)


def _obj(_file: Path, content: Content) -> int:
    corners: Counter[bytes] = Counter()
    rows, textured = 0, False
    name, rest = b"", b""
    for start in range(0, content.size, _BLOCK):
        text = rest + content.part(start, start + _BLOCK)
        end = text.rfind(b"\n") + 1 if start + _BLOCK < content.size else len(text)
        text, rest = text[:end], text[end:]
        marks = list(_MARK.finditer(text))
        starts = [0, *(mark.end() for mark in marks)]
        ends = [*(mark.start() for mark in marks), len(text)]
        names = [name, *(mark[1] for mark in marks)]
        for part, first, last in zip(names, starts, ends, strict=True):
            positions, places, normals = (text.count(key, first, last) for key in (b"v ", b"vt ", b"vn "))
            blanks = text.count(b" ", first, last) + text.count(b"\t", first, last)
            corners[part] += max(blanks - 3 * positions - 2 * places - 3 * normals, 0)
            rows += positions + places + normals
            textured = textured or places > 0
        name = names[-1]
    each = OBJ_TEXTURED_CORNER if textured else OBJ_CORNER
    return OBJ_LINES + OBJ_HELD * (corners.total() + rows) + each * max(corners.values(), default=0)


def _text(_file: Path, content: Content) -> int:
    return TEXT * content.size


_KINDS: dict[str, Callable[[Path, Content], int]] = {
    ".glb": _gltf,
    ".gltf": _gltf,
    ".obj": _obj,
    ".ply": _ply,
    ".stl": _stl,
}
