"""Reader of glTF 2.0 files (.glb, .gltf).

The file is never held: its JSON header is, and of its data what one mesh needs. Read here and not by trimesh, which
decodes all accessors at once and leaves out sparse accessors, normalised integers, triangle fans, skins, morph targets,
instances and colour in linear light. Several primitives of one mesh are joined into one, and the node tree is
multiplied out in float64.

A mesh's primitives are concatenated in the file's order: face k of a mesh is face k - (faces of the primitives before)
of its primitive. Meshes with equal accessors and materials are one mesh; one that nodes pose differently, by morph
weights or skins, is several.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from jobs.importing.formats.format import Format
from jobs.importing.formats.gltf.accessors import Accessors, at, decompressed_bytes, open_buffers
from jobs.importing.formats.gltf.draco import DracoDecoder, decoder_memory
from jobs.importing.formats.gltf.header import (
    DRACO,
    Json,
    check_versions,
    name_of,
    references,
    unpacked,
    unread_extensions,
)
from jobs.importing.formats.gltf.placements import count_instances, placements
from jobs.importing.formats.gltf.poses import Poses
from jobs.importing.formats.gltf.primitives import TRIANGLES, UNPOSED, Pose, Primitives, has_triangles, is_skinned
from jobs.importing.formats.gltf.surfaces import may_split
from jobs.importing.formats.gltf.textures import TEXTURES_KEPT, Textures
from jobs.importing.reading.content import Content, ContentPart
from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.needs import TEXEL, TEXTURED_VERTEX, TRIANGLE, VERTEX, image_needs, texels_of
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceScene, UnreadMeshes

#: Bytes that are looked through at once.
_BLOCK = 1 << 20

#: Bytes of memory for each byte of a file's JSON: it is held as objects, and its nodes become placements.
JSON = 10

#: Bytes of memory for each instance that a node places.
INSTANCE = 1200

#: Bytes of memory for each vertex that morph targets or joints move.
POSED_VERTEX = 250

#: Bytes of memory for each corner of a triangle that may get vertices of its own, because its texture has alpha.
SPLIT_CORNER = 200


def read(file: Path, content: Content, resources: Resources) -> SourceScene:
    """Read a glTF file. Raises ModelError, or whatever damaged content makes the parsers raise."""
    header, chunk = unpacked(file, content)
    check_versions(file, header)
    accessors = Accessors(file, header, open_buffers(file, header, chunk, resources))
    accessors.check()
    tally = Tally()
    meshes = _Meshes(accessors, Poses(accessors), resources, tally)
    nodes = placements(meshes.poses, meshes.of_node, tally)
    return SourceScene(file, UnreadMeshes(len(meshes.entries), meshes.read), nodes, 1.0, "y", "y", tally)


@dataclass(eq=False)
class _Meshes:
    """The meshes of a file in all the poses in which its nodes show them."""

    accessors: Accessors
    poses: Poses
    resources: Resources
    tally: Tally
    entries: list[tuple[str, list[Json], Pose]] = field(default_factory=list)
    _index: dict[int, int] = field(default_factory=dict)  # of the header's meshes with triangles, among the entries
    _rigid: set[int] = field(default_factory=set)  # entries that no node poses
    _posed: dict[tuple[int, Pose], int] = field(default_factory=dict)
    _primitives: Primitives = field(init=False)

    def __post_init__(self) -> None:
        decoder = DracoDecoder(self.accessors.file)
        self._primitives = Primitives(self.accessors, Textures(self.accessors, self.resources), decoder)
        known: dict[bytes, int] = {}
        for number, entry in enumerate(self.accessors.header.get("meshes", ())):
            name = name_of(entry, f"mesh {number}")
            key = hashlib.blake2b(json.dumps(entry["primitives"], sort_keys=True).encode(), digest_size=16).digest()
            if key not in known:
                drawn = [primitive for primitive in entry["primitives"] if has_triangles(primitive)]
                self.tally.add(Defect.NOT_TRIANGLES, name, len(entry["primitives"]) - len(drawn))
                unread = sum(len(unread_extensions(each)) for each in (entry, *drawn))
                self.tally.add(Defect.UNSUPPORTED, name, unread)
                if not drawn:
                    continue
                known[key] = len(self.entries)
                if not any(primitive.get("targets") or is_skinned(primitive) for primitive in drawn):
                    self._rigid.add(known[key])
                self.entries.append((name, drawn, UNPOSED))
            self._index[number] = known[key]

    def of_node(self, number: int) -> tuple[int, bool] | None:
        """The entry that a node places, and whether its skin places it; None if it places none."""
        node = self.poses.nodes[number]
        index = self._index.get(node["mesh"]) if "mesh" in node else None
        if index is None:
            return None
        if index in self._rigid:
            return index, False
        name, primitives, _ = self.entries[index]
        skin = node.get("skin")
        has_joints = skin is not None and any(is_skinned(primitive) for primitive in primitives)
        pose = Pose(self.poses.weights(number), at(skin) if has_joints else None)
        if pose != UNPOSED:
            if (index, pose) not in self._posed:
                self._posed[index, pose] = len(self.entries)
                self.entries.append((name, primitives, pose))
            index = self._posed[index, pose]
        return index, has_joints

    def read(self, number: int) -> SourceMesh:
        """The primitives of one mesh joined."""
        name, primitives, pose = self.entries[number]
        defects: dict[Defect, int] = {}
        joints = None if pose.skin is None else self.poses.joints(pose.skin)
        if joints is not None:  # what does not follow the skin has no place
            bare = sum(not is_skinned(primitive) for primitive in primitives)
            primitives = [primitive for primitive in primitives if is_skinned(primitive)]
            defects |= {Defect.BROKEN: bare} if bare else {}
        pieces = [self._primitives.read(name, primitive, pose.weights, joints, defects) for primitive in primitives]
        starts = np.cumsum([0, *(len(piece.positions) for piece in pieces[:-1])])
        # an index out of range must not reach into the next primitive
        shifted = [
            np.where((piece.triangles >= 0) & (piece.triangles < len(piece.positions)), piece.triangles + start, -1)
            for piece, start in zip(pieces, starts.tolist(), strict=True)
        ]
        return SourceMesh(
            name,
            np.concatenate([piece.positions for piece in pieces]),
            np.concatenate(shifted),
            np.concatenate([piece.normals for piece in pieces]),
            np.concatenate([piece.colours for piece in pieces]),
            defects,
        )


def _is_glb(content: Content) -> bool:
    return content.part(0, 4) == b"glTF"


def _is_gltf(content: Content) -> bool:
    head = content.part(0, 4096).lstrip(b"\xef\xbb\xbf \t\r\n")
    asset = b'"asset"'
    starts = range(0, content.size, _BLOCK)
    return head.startswith(b"{") and any(asset in content.part(at, at + _BLOCK + len(asset)) for at in starts)


def _named_files(file: Path, content: Content, _resources: Resources) -> Iterable[str]:
    header, _ = unpacked(file, content)
    return [*references(header, "buffers"), *references(header, "images")]


def _memory(file: Path, content: Content, resources: Resources) -> int:
    """The JSON header, the largest mesh, the images, what is decompressed, and the instances."""
    header, chunk = unpacked(file, content)
    inline = sum(
        len(buffer["uri"]) for buffer in header.get("buffers", ()) if buffer.get("uri", "").startswith("data:")
    )
    textured = bool(header.get("textures"))
    texels = 0
    largest = max((_of_mesh(header, mesh, textured) for mesh in header.get("meshes", ())), default=0)
    if chunk is not None:
        for image in header.get("images", ()):
            if "bufferView" in image:
                view = header["bufferViews"][image["bufferView"]]
                texels = max(texels, texels_of(ContentPart(chunk, view.get("byteOffset", 0), view["byteLength"])))
    text = content.size - (chunk.size if chunk is not None else 0)
    held = TEXEL * texels + TEXTURES_KEPT * textured + image_needs(references(header, "images"), resources)
    more = decompressed_bytes(header) + INSTANCE * count_instances(header)
    return JSON * (text - inline) + 4 * inline + largest + held + more


def _of_mesh(header: Json, mesh: Json, textured: bool) -> int:
    """Bytes that reading one mesh may take."""
    accessors = header.get("accessors", [])
    need = streams = 0
    for primitive in mesh["primitives"]:
        attributes, extensions = primitive.get("attributes", {}), primitive.get("extensions", {})
        if "POSITION" not in attributes:
            continue
        vertices = int(accessors[attributes["POSITION"]]["count"])
        corners = int(accessors[primitive["indices"]]["count"]) if "indices" in primitive else vertices
        triangles = corners // 3 if primitive.get("mode", TRIANGLES) == TRIANGLES else corners
        posed = bool(primitive.get("targets")) or is_skinned(primitive)
        if textured and "material" in primitive and may_split(header["materials"][primitive["material"]]):
            need += SPLIT_CORNER * 3 * triangles
        need += (VERTEX + TEXTURED_VERTEX * textured + POSED_VERTEX * posed) * vertices + TRIANGLE * triangles
        if DRACO in extensions:
            stream = int(header["bufferViews"][extensions[DRACO]["bufferView"]]["byteLength"])
            streams = max(streams, decoder_memory(vertices, triangles, stream))
    return need + streams


GLB = Format((".glb",), read, _is_glb, _named_files, _memory)
GLTF = Format((".gltf",), read, _is_gltf, _named_files, _memory)
