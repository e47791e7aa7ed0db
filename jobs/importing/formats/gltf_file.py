"""Reader of glTF 2.0 files (.glb, .gltf).

The file is never held: its JSON header is, and of its data what one mesh needs. Every declared size is checked against
the bytes that are there before anything is read. Read here and not by trimesh, which decodes all accessors at once and
leaves out sparse accessors, normalised integers, triangle fans and colour in linear light. Several primitives of one
mesh are joined into one, and the node tree is multiplied out in float64.

A mesh's primitives are concatenated in the file's order: face k of a mesh is face k - (faces of the primitives before)
of its primitive. Meshes with equal accessors and materials are one mesh. Skins, morph targets and animations are left
at rest.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.reading.content import Content, ContentPart, whole
from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.needs import TEXEL, TEXTURED_VERTEX, TRIANGLE, VERTEX, image_needs, texels_of
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene, UnreadMeshes, compose
from jobs.importing.reading.vertex_colours import DEFAULT_COLOUR, Texture, from_linear, srgb_to_linear, to_colours
from storage.base.errors import ModelError
from storage.meshes.placement import IDENTITY

Json = dict[str, Any]

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6

#: Extensions without which the geometry cannot be read.
_COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")

#: The most zeros that an accessor without data may stand for.
_ZEROS = 1 << 24

#: Bytes that are looked through at once.
_BLOCK = 1 << 20

#: Textures are kept for the next mesh up to this many bytes of pixels.
TEXTURES_KEPT = 1 << 26

#: Bytes of memory for each byte of a file's JSON: it is held as objects, and its nodes become placements.
JSON = 10


def read(file: Path, content: Content, resources: Resources) -> SourceScene:
    """Read a glTF file. Raises ModelError, or whatever damaged content makes the parsers raise."""
    header, chunk = _unpacked(file, content)
    version = str(header.get("asset", {}).get("version", "2.0"))
    if not version.startswith("2"):
        raise ModelError(f"{file}: glTF version {version[:20]}; only version 2 is read, convert the file")
    for extension in _COMPRESSED:
        if extension in header.get("extensionsRequired", ()):
            raise ModelError(f"{file}: compressed with {extension}, which is not read; export it without compression")
    source = _Source(file, header, _buffers(file, header, chunk, resources), resources)
    source.check()
    tally = Tally()
    entries, index = _entries(source, tally)
    meshes = UnreadMeshes(len(entries), lambda number: _mesh(source, *entries[number]))
    return SourceScene(file, meshes, _nodes(header, index, tally), 1.0, "y", "y", tally)


def _is_glb(content: Content) -> bool:
    return content.part(0, 4) == b"glTF"


def _is_gltf(content: Content) -> bool:
    head = content.part(0, 4096).lstrip(b"\xef\xbb\xbf \t\r\n")
    asset = b'"asset"'
    starts = range(0, content.size, _BLOCK)
    return head.startswith(b"{") and any(asset in content.part(at, at + _BLOCK + len(asset)) for at in starts)


def _named_files(file: Path, content: Content, _resources: Resources) -> Iterable[str]:
    header, _ = _unpacked(file, content)
    return [*_references(header, "buffers"), *_references(header, "images")]


def _references(header: Json, section: str) -> list[str]:
    """The files that the entries of a section name."""
    uris = [str(entry["uri"]) for entry in header.get(section, ()) if "uri" in entry]
    return [uri for uri in uris if not uri.startswith("data:")]


def _memory(file: Path, content: Content, resources: Resources) -> int:
    """The JSON header, the largest mesh, and the images."""
    header, chunk = _unpacked(file, content)
    accessors = header.get("accessors", [])
    inline = sum(
        len(buffer["uri"]) for buffer in header.get("buffers", ()) if buffer.get("uri", "").startswith("data:")
    )
    textured = bool(header.get("textures"))
    largest = texels = 0
    for mesh in header.get("meshes", ()):
        need = 0
        for primitive in mesh["primitives"]:
            if "POSITION" not in primitive.get("attributes", {}):
                continue
            vertices = int(accessors[primitive["attributes"]["POSITION"]]["count"])
            corners = int(accessors[primitive["indices"]]["count"]) if "indices" in primitive else vertices
            triangles = corners // 3 if primitive.get("mode", _TRIANGLES) == _TRIANGLES else corners
            need += (VERTEX + TEXTURED_VERTEX * textured) * vertices + TRIANGLE * triangles
        largest = max(largest, need)
    if chunk is not None:
        for image in header.get("images", ()):
            if "bufferView" in image:
                view = header["bufferViews"][image["bufferView"]]
                texels = max(texels, texels_of(ContentPart(chunk, view.get("byteOffset", 0), view["byteLength"])))
    text = content.size - (chunk.size if chunk is not None else 0)
    held = TEXEL * texels + TEXTURES_KEPT * textured + image_needs(_references(header, "images"), resources)
    return JSON * (text - inline) + 4 * inline + largest + held


def _unpacked(file: Path, content: Content) -> tuple[Json, Content | None]:
    """The JSON header and, in a .glb file, the binary chunk."""
    if file.suffix.lower() == ".gltf":
        header = json.loads(whole(content))
        chunk: Content | None = None
    else:
        if content.part(0, 4) != b"glTF":
            raise ModelError(
                f"{file}: not a GLB file, it does not start with glTF; check its extension or export it again"
            )
        if content.size < 20:
            raise _cut(file, 20, content.size)
        version, total, length = (int(n) for n in np.frombuffer(content.part(4, 16), "<u4"))
        if version != 2:
            raise ModelError(f"{file}: GLB version {version}; only version 2 is read, convert the file")
        if total > content.size or 20 + length > content.size:
            raise _cut(file, max(total, 20 + length), content.size)
        header = json.loads(content.part(20, 20 + length))
        start, chunk = 20 + length, None
        while start + 8 <= content.size and chunk is None:
            head = content.part(start, start + 8)
            length = int.from_bytes(head[:4], "little")
            if start + 8 + length > content.size:
                raise _cut(file, start + 8 + length, content.size)
            chunk = ContentPart(content, start + 8, length) if head[4:] == b"BIN\0" else None
            start += 8 + length
    if not isinstance(header, dict) or "asset" not in header:
        raise ModelError(f"{file}: JSON, but not glTF (it has no asset); check its extension")
    return header, chunk


def _cut(file: Path, expected: int, found: int) -> ModelError:
    return ModelError(f"{file}: cut short, {found} of {expected} bytes are there; copy or export it again")


def _buffers(file: Path, header: Json, chunk: Content | None, resources: Resources) -> list[Content]:
    buffers: list[Content] = []
    for number, buffer in enumerate(header.get("buffers", ())):
        uri = buffer.get("uri")
        data = chunk if uri is None and number == 0 else None
        if uri is not None:
            data = resources.open(str(uri))
        if data is None:
            name = "its binary chunk" if uri is None else f"the buffer {str(uri)[:80]!r}"
            raise ModelError(f"{file}: {name} is missing; put it into the model's folder, or export the model again")
        if data.size < int(buffer["byteLength"]):
            name = "the binary chunk" if uri is None else f"the buffer {str(uri)[:80]!r}"
            raise ModelError(
                f"{file}: {name} is cut short, {data.size} of {buffer['byteLength']} bytes; copy or export it again"
            )
        buffers.append(data)
    return buffers


@dataclass(eq=False)
class _Source:
    """A file's content, decoded as it is asked for."""

    file: Path
    header: Json
    buffers: list[Content]
    resources: Resources
    _textures: dict[int, Texture | None] = field(default_factory=dict)  # the one used last comes last

    def check(self) -> None:
        """Raise ModelError unless all the bytes of every accessor are there."""
        for number, accessor in enumerate(self.header.get("accessors", ())):
            self._check(number, accessor)
            for extra in _patches(accessor) if "sparse" in accessor else ():
                self._check(number, extra)

    def _check(self, number: int, accessor: Json) -> None:
        """Raise ModelError unless all the bytes of an accessor are there."""
        count = accessor["count"]
        item = np.dtype(_COMPONENTS[accessor["componentType"]]).itemsize * _WIDTHS[accessor["type"]]
        if not isinstance(count, int) or count < 0:
            raise ModelError(f"{self.file}: accessor {number} has the count {count!r}; export the model again")
        if "bufferView" not in accessor:
            if count > _ZEROS:
                raise ModelError(
                    f"{self.file}: accessor {number} claims {count} items but has no data; export the model again"
                )
            return
        view = self.header["bufferViews"][_at(accessor["bufferView"])]
        start, length = view.get("byteOffset", 0), view["byteLength"]
        offset, stride = accessor.get("byteOffset", 0), view.get("byteStride", item)
        needed = offset + (count - 1) * stride + item if count else 0
        sane = (
            all(isinstance(n, int) and n >= 0 for n in (start, length, offset))
            and isinstance(stride, int)
            and stride > 0
        )
        if not sane or needed > length or start + length > self.buffers[_at(view["buffer"])].size:
            raise ModelError(
                f"{self.file}: accessor {number} ({count} items) reaches beyond the file's data; "
                "the file is damaged or cut short, export it again"
            )

    def integers(self, accessor: int) -> np.ndarray:
        """An accessor's values as int64, in one row."""
        return self._values(accessor).reshape(-1).astype(np.int64)

    def floats(self, accessor: int) -> np.ndarray:
        """An accessor's values (count, width) as float64; normalised integers become -1 to 1 or 0 to 1."""
        values = self._values(accessor)
        if self.header["accessors"][accessor].get("normalized") and values.dtype.kind in "iu":
            return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
        return values.astype(np.float64)

    def _values(self, number: int) -> np.ndarray:
        """An accessor's values (count, width) as they are stored."""
        accessor = self.header["accessors"][_at(number)]
        values = self._stored(accessor)
        if "sparse" in accessor:
            values = values.copy()
            places, changed = (self._stored(extra) for extra in _patches(accessor))
            values[places[:, 0]] = changed
        return values

    def _stored(self, accessor: Json) -> np.ndarray:
        """The same without what a sparse accessor changes; read from the file now."""
        shape = (accessor["count"], _WIDTHS[accessor["type"]])
        dtype = np.dtype(_COMPONENTS[accessor["componentType"]])
        if "bufferView" not in accessor or not shape[0]:
            return np.zeros(shape, dtype)
        view = self.header["bufferViews"][_at(accessor["bufferView"])]
        item = dtype.itemsize * shape[1]
        stride = view.get("byteStride", item)
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        data = self.buffers[_at(view["buffer"])].part(start, start + (shape[0] - 1) * stride + item)
        return np.ndarray(shape, dtype, data, strides=(stride, dtype.itemsize))

    def texture(self, number: int) -> Texture | None:
        """A texture's image, None if it is missing or cannot be read."""
        if number in self._textures:
            self._textures[number] = self._textures.pop(number)
        else:
            self._textures[number] = Texture.decode(self._image(number))
            while len(self._textures) > 1 and self._pixels() > TEXTURES_KEPT:
                del self._textures[next(iter(self._textures))]
        return self._textures[number]

    def _pixels(self) -> int:
        return sum(texture.pixels.nbytes for texture in self._textures.values() if texture is not None)

    def _image(self, number: int) -> bytes | None:
        """The file of a texture's image, None if it is missing."""
        entry = self.header["textures"][_at(number)]
        source = entry.get("source", entry.get("extensions", {}).get("EXT_texture_webp", {}).get("source"))
        image = {} if source is None else self.header["images"][_at(source)]
        if "bufferView" in image:
            view = self.header["bufferViews"][_at(image["bufferView"])]
            start = view.get("byteOffset", 0)
            return self.buffers[_at(view["buffer"])].part(start, start + view["byteLength"])
        return self.resources.read(str(image["uri"])) if "uri" in image else None


def _at(index: Any) -> int:
    """An index into one of the header's lists; negative ones must not count from the end."""
    if not isinstance(index, int) or index < 0:
        raise IndexError(f"index {index!r} is out of range")
    return index


def _patches(accessor: Json) -> list[Json]:
    """A sparse accessor's places and values, as accessors of their own."""
    sparse = accessor["sparse"]
    common = {"count": sparse["count"], "componentType": accessor["componentType"]}
    return [{**common, "type": "SCALAR", **sparse["indices"]}, {**common, "type": accessor["type"], **sparse["values"]}]


def _entries(source: _Source, tally: Tally) -> tuple[list[tuple[str, list[Json]]], dict[int, int]]:
    """Name and primitives of all meshes with triangles, and which of them each mesh of the header is."""
    entries: list[tuple[str, list[Json]]] = []
    index: dict[int, int] = {}
    known: dict[bytes, int] = {}
    for number, entry in enumerate(source.header.get("meshes", ())):
        name = str(entry.get("name") or f"mesh {number}")
        key = hashlib.blake2b(json.dumps(entry["primitives"], sort_keys=True).encode(), digest_size=16).digest()
        if key not in known:
            drawn = [primitive for primitive in entry["primitives"] if _has_triangles(source.file, primitive)]
            tally.add(Defect.NOT_TRIANGLES, name, len(entry["primitives"]) - len(drawn))
            if not drawn:
                continue
            known[key] = len(entries)
            entries.append((name, drawn))
        index[number] = known[key]
    return entries, index


def _has_triangles(file: Path, primitive: Json) -> bool:
    for extension in _COMPRESSED:
        if extension in primitive.get("extensions", {}):
            raise ModelError(f"{file}: compressed with {extension}, which is not read; export it without")
    return primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN) and "POSITION" in primitive.get(
        "attributes", {}
    )


def _mesh(source: _Source, name: str, primitives: Sequence[Json]) -> SourceMesh:
    """The primitives of one mesh joined."""
    defects: dict[Defect, int] = {}
    pieces = []
    for primitive in primitives:
        attributes = primitive["attributes"]
        mode = primitive.get("mode", _TRIANGLES)
        positions = source.floats(attributes["POSITION"])
        corners = source.integers(primitive["indices"]) if "indices" in primitive else np.arange(len(positions))
        triangles = _triangles(corners, mode)
        normals = np.zeros(positions.shape, np.float32)
        if "NORMAL" in attributes:
            normals = source.floats(attributes["NORMAL"]).astype(np.float32)
        if positions.shape[1] != 3:
            raise ModelError(f"{source.file}: mesh {name!r} has positions without x, y and z; export it again")
        if normals.shape != positions.shape:
            defects[Defect.BROKEN] = defects.get(Defect.BROKEN, 0) + 1
            normals = np.zeros(positions.shape, np.float32)
        colours = _colours(source, primitive, positions, triangles, defects)
        pieces.append((positions, triangles, normals, colours))
    starts = np.cumsum([0, *(len(piece[0]) for piece in pieces[:-1])])
    # an index out of range must not reach into the next primitive
    shifted = [
        np.where((piece[1] >= 0) & (piece[1] < len(piece[0])), piece[1] + start, -1)
        for piece, start in zip(pieces, starts.tolist(), strict=True)
    ]
    return SourceMesh(
        name,
        np.concatenate([piece[0] for piece in pieces]),
        np.concatenate(shifted),
        np.concatenate([piece[2] for piece in pieces]),
        np.concatenate([piece[3] for piece in pieces]),
        defects,
    )


def _triangles(corners: np.ndarray, mode: int) -> np.ndarray:
    """Triangles (m, 3) of a list, strip or fan. The faces without area that stitch strips together are left out."""
    if mode == _TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    number = np.arange(max(len(corners) - 2, 0))
    if mode == _FAN:
        return corners[np.stack([np.zeros_like(number), number + 1, number + 2], axis=1)]
    odd = number % 2
    strip = corners[np.stack([number, number + 1 + odd, number + 2 - odd], axis=1)]
    a, b, c = strip.T
    return strip[(a != b) & (b != c) & (c != a)]


def _colours(
    source: _Source, primitive: Json, positions: np.ndarray, triangles: np.ndarray, defects: dict[Defect, int]
) -> np.ndarray:
    """Base colour times texture times vertex colour (n, 4) uint8."""
    attributes = primitive["attributes"]
    number = primitive.get("material")
    if number is None and "COLOR_0" not in attributes:
        return np.broadcast_to(np.array(DEFAULT_COLOUR, np.uint8), (len(positions), 4))
    factor, image = _surface({} if number is None else source.header["materials"][_at(number)])
    linear = np.ones((len(positions), 4))
    linear *= np.nan_to_num(np.array(factor, np.float64).reshape(4))
    if image is not None:
        coordinates = f"TEXCOORD_{image.get('texCoord', 0)}"
        texture = source.texture(image["index"])
        if texture is None:
            defects[Defect.NO_TEXTURE] = defects.get(Defect.NO_TEXTURE, 0) + 1
        elif coordinates in attributes:
            places = source.floats(attributes[coordinates])
            inside = ((triangles >= 0) & (triangles < len(places))).all(axis=1)
            sampled = texture.sample(_moved(places, image), triangles[inside])
            linear[:, :3] *= srgb_to_linear(sampled[:, :3])
            linear[:, 3] *= sampled[:, 3] / 255
    if "COLOR_0" not in attributes:
        return from_linear(linear)
    painted = source.floats(attributes["COLOR_0"])
    bad = ~np.isfinite(painted).all(axis=1)
    if bad.any():
        painted = np.where(bad[:, None], 1.0, painted)
        defects[Defect.COLOUR] = defects.get(Defect.COLOUR, 0) + int(bad.sum())
    if _writes_srgb(source.header) and (linear == 1).all():
        return to_colours(painted)
    linear[:, : painted.shape[1]] *= painted
    return from_linear(linear)


def _surface(material: Json) -> tuple[Sequence[float], Json | None]:
    """A material's base colour and the texture that goes with it."""
    older = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if older is not None and "pbrMetallicRoughness" not in material:
        return older.get("diffuseFactor", (1, 1, 1, 1)), older.get("diffuseTexture")
    surface = material.get("pbrMetallicRoughness", {})
    return surface.get("baseColorFactor", (1, 1, 1, 1)), surface.get("baseColorTexture")


def _writes_srgb(header: Json) -> bool:
    """Whether the file's author is trimesh, which stores sRGB vertex colours where glTF wants linear ones."""
    return "trimesh" in str(header["asset"].get("generator", ""))


def _moved(places: np.ndarray, image: Json) -> np.ndarray:
    """Texture coordinates under KHR_texture_transform."""
    transform = image.get("extensions", {}).get("KHR_texture_transform")
    if transform is None:
        return places
    angle = float(transform.get("rotation", 0.0))
    across, down = (float(value) for value in transform.get("scale", (1.0, 1.0)))
    u, v = places[:, 0] * across, places[:, 1] * down
    x, y = (float(value) for value in transform.get("offset", (0.0, 0.0)))
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.stack([u * cosine + v * sine + x, v * cosine - u * sine + y], axis=1)


def _nodes(header: Json, index: dict[int, int], tally: Tally) -> list[SourceNode]:
    """All placements of meshes in the file's scene, depth first."""
    nodes = header.get("nodes", ())
    if header.get("scenes"):
        roots = header["scenes"][_at(header.get("scene", 0))].get("nodes", ())
    else:
        children = {child for node in nodes for child in node.get("children", ())}
        roots = [number for number in range(len(nodes)) if number not in children]
    placed = []
    seen: set[int] = set()
    stack = [(number, IDENTITY) for number in reversed(roots)]
    while stack:
        number, parent = stack.pop()
        node = nodes[_at(number)]
        if number in seen:  # glTF nodes form a tree
            tally.add(Defect.BROKEN, str(node.get("name") or f"node {number}"))
            continue
        seen.add(number)
        local = _matrix(node)
        matrix = local if parent is IDENTITY else parent if local is IDENTITY else compose(parent, local)
        mesh = index.get(node["mesh"]) if "mesh" in node else None
        if mesh is not None:
            name = str(node.get("name") or header["meshes"][node["mesh"]].get("name") or f"node {number}")
            placed.append(SourceNode(mesh, name, matrix))
            if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
                tally.add(Defect.UNSUPPORTED, name)
        stack.extend((child, matrix) for child in reversed(node.get("children", ())))
    return placed


def _matrix(node: Json) -> np.ndarray:
    """A node's (3, 4) matrix; IDENTITY itself if it has none."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T[:3]
    if not any(key in node for key in ("translation", "rotation", "scale")):
        return IDENTITY
    x, y, z, w = (float(value) for value in node.get("rotation", (0, 0, 0, 1)))
    norm = math.sqrt(x * x + y * y + z * z + w * w) or 1.0
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    scale = np.array(node.get("scale", (1, 1, 1)), np.float64).reshape(3)
    shift = np.array(node.get("translation", (0, 0, 0)), np.float64).reshape(3)
    return np.column_stack([rotation * scale, shift])


GLB = Format((".glb",), read, _is_glb, _named_files, _memory)
GLTF = Format((".gltf",), read, _is_gltf, _named_files, _memory)
