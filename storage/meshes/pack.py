"""Packs: several meshes in one compressed frame.

A mesh is first brought into the order that compresses best (`ordered`); a pack of such meshes gives back the very same
arrays. Stored are, in one zstd frame: the triangles between positions (see `connectivity`), which of a position's
vertices each corner uses (see `wedges`), positions as differences from what the triangles foretell, normals as
differences from what the shape foretells (storage.meshes.normals), and colours as differences from the vertex before.
FORMAT.md has the layout.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import zstandard
from numpy.typing import NDArray

from storage.base.errors import CorruptStoreError
from storage.meshes.arrangement import arranged
from storage.meshes.byte_planes import step_planes, unstep_planes, unzigzag_planes, zigzag_planes
from storage.meshes.connectivity import decode_triangles, encode_triangles, foretell, fulfil, make_local
from storage.meshes.mesh_order import same_rows
from storage.meshes.normals import foretell_normals, to_octahedral
from storage.meshes.wedges import decode_wedges, encode_wedges

#: zstd level of packs: they are written once and decode as fast as any other.
LEVEL = 10

#: Numbers (u4) at a pack's head: meshes, positions, vertices, triangles, bytes of more, named vertices, wedge codes.
_HEAD = 7


class MeshArrays(NamedTuple):
    """One mesh as it is packed. Positions are integers; local position = integer * scale."""

    positions: NDArray[np.int32]  # (n, 3)
    triangles: NDArray[np.uint32]  # (m, 3), indices into positions
    normals: NDArray[np.float32]  # (n, 3), unit
    colours: NDArray[np.uint8]  # (n, 4)
    source_faces: NDArray[np.uint32] | None  # (m, 2), part and face of the model; None for coarser levels
    scale: float  # local units per integer step, a power of two


class Pack(NamedTuple):
    """A decoded pack: all its meshes' arrays one after the other; GEOMETRY says where each begins. Read-only arrays."""

    positions: NDArray[np.int32]  # (n, 3)
    folded: NDArray[np.int16]  # (n, 2), the normals in octahedral coordinates: storage.meshes.normals
    colours: NDArray[np.uint8]  # (n, 4)
    triangles: NDArray[np.uint32]  # (m, 3), indices relative to the mesh's first vertex

    @property
    def bytes(self) -> int:
        """Size in memory."""
        return sum(array.nbytes for array in self)


def ordered(mesh: MeshArrays) -> MeshArrays:
    """The same mesh in the order that packs keep.

    Triangles are reordered and turned (orientation and source faces stay with them), vertices are numbered by first
    use; unused ones are dropped, and those that agree in position, normal and colour become one. Normals are rounded
    to what a pack holds (within 0.25 degrees). Raises ValueError for arrays that do not fit together.
    """
    positions = np.ascontiguousarray(mesh.positions, np.int32).reshape(-1, 3)
    triangles = np.ascontiguousarray(mesh.triangles, np.uint32).reshape(-1, 3)
    normals = np.ascontiguousarray(mesh.normals, np.float32).reshape(-1, 3)
    colours = np.ascontiguousarray(mesh.colours, np.uint8).reshape(-1, 4)
    if not len(positions) == len(normals) == len(colours):
        raise ValueError(f"{len(positions)} positions, {len(normals)} normals, {len(colours)} colours")
    if len(triangles) and int(triangles.max()) >= len(positions):
        raise ValueError(f"a triangle names vertex {int(triangles.max())} of {len(positions)}")
    if mesh.source_faces is not None and mesh.source_faces.shape != (len(triangles), 2):
        raise ValueError(f"source faces {mesh.source_faces.shape} for {len(triangles)} triangles")

    placed, turned, painted, renamed, order = arranged(positions, normals, colours, triangles)
    faces = None if mesh.source_faces is None else np.ascontiguousarray(mesh.source_faces, np.uint32)[order]
    return MeshArrays(placed, renamed, turned, painted, faces, float(mesh.scale))


def pack(meshes: Sequence[MeshArrays]) -> bytes:
    """The meshes' positions, normals, colours and triangles as one frame.

    The meshes must come from `ordered`: raises ValueError where they do not.
    """
    sizes = np.zeros((len(meshes), 3), np.uint32)
    places, corners, vertices = [], [], []
    place_start = vertex_start = 0
    for number, mesh in enumerate(meshes):
        numbers, firsts = same_rows(mesh.positions)
        places.append(mesh.positions[firsts])
        corners.append(numbers[mesh.triangles] + np.uint32(place_start))
        vertices.append(mesh.triangles + np.uint32(vertex_start))
        sizes[number] = len(firsts), len(mesh.positions), len(mesh.triangles)
        place_start += len(firsts)
        vertex_start += len(mesh.positions)
    positions = _joined(places, np.int32, 3)
    triangles = _joined(corners, np.uint32, 3)
    names = _joined(vertices, np.uint32, 3)
    codes, more, named, turns = encode_triangles(triangles)
    wedge_codes, wedges, sources = encode_wedges(triangles.ravel(), names.ravel(), len(positions))
    if turns.any() or not np.array_equal(wedges, names.ravel()) or len(sources) != vertex_start:
        raise ValueError("meshes must be brought into order (storage.meshes.pack.ordered) before they are packed")
    _, guides = decode_triangles(codes, more, named, len(positions))

    every = _joined([mesh.positions for mesh in meshes], np.int32, 3)
    folded = to_octahedral(_joined([mesh.normals for mesh in meshes], np.float32, 3))
    turned = folded - foretell_normals(every, names)
    colours = _joined([mesh.colours for mesh in meshes], np.uint8, 4)
    counts = (len(meshes), len(positions), vertex_start, len(triangles), len(more), len(named), len(wedge_codes))
    streams = (
        np.array(counts, "<u4").tobytes(),
        sizes.tobytes(),
        codes.tobytes(),
        more.tobytes(),
        named.tobytes(),
        wedge_codes.tobytes(),
        zigzag_planes(foretell(positions, guides), 4).tobytes(),
        zigzag_planes(turned, 2).tobytes(),
        step_planes(colours).tobytes(),
    )
    return zstandard.ZstdCompressor(LEVEL).compress(b"".join(streams))


def unpack(data: bytes) -> Pack:
    """Decodes a frame made by `pack`. Raises CorruptStoreError if the bytes make no sense."""
    try:
        return _unpack(zstandard.ZstdDecompressor().decompress(data))
    except (ValueError, OverflowError, zstandard.ZstdError) as error:
        raise CorruptStoreError(f"a pack of meshes cannot be decoded: {error}") from error


def pack_source_faces(meshes: Sequence[MeshArrays]) -> bytes:
    """The meshes' source faces as one frame; those of meshes without any are 0."""
    faces = [np.zeros((len(m.triangles), 2), np.uint32) if m.source_faces is None else m.source_faces for m in meshes]
    steps = np.diff(_joined(faces, np.uint32, 2).astype(np.int64), axis=0, prepend=0)
    return zstandard.ZstdCompressor(LEVEL).compress(zigzag_planes(steps.astype(np.int32), 4).tobytes())


def unpack_source_faces(data: bytes) -> NDArray[np.uint32]:
    """Part and face of all triangles of a pack (m, 2) uint32, in its order. Raises CorruptStoreError."""
    try:
        content = zstandard.ZstdDecompressor().decompress(data)
        steps = unzigzag_planes(np.frombuffer(content, np.uint8), 2, 4)
    except (ValueError, zstandard.ZstdError) as error:
        raise CorruptStoreError(f"source faces cannot be decoded: {error}") from error
    faces = np.cumsum(steps, axis=0, dtype=np.uint32)
    faces.flags.writeable = False
    return faces


def _unpack(content: bytes) -> Pack:
    head = np.frombuffer(content[: 4 * _HEAD], "<u4").tolist()
    if len(head) < _HEAD:
        raise ValueError("it is too short")
    meshes, positions, vertices, triangles, more, named, wedge_codes = head
    lengths = (12 * meshes, triangles, more, 4 * named, wedge_codes, 12 * positions, 4 * vertices, 4 * vertices)
    ends = np.cumsum([4 * _HEAD, *lengths]).tolist()
    if ends[-1] != len(content):
        raise ValueError(f"it has {len(content)} bytes, not {ends[-1]}")
    streams = [np.frombuffer(content, np.uint8)[start:end] for start, end in pairwise(ends)]
    sizes = np.frombuffer(streams[0].tobytes(), "<u4").reshape(-1, 3)
    if sizes.sum(axis=0, dtype=np.int64).tolist() != [positions, vertices, triangles]:
        raise ValueError("its meshes do not add up")
    names_of_places = np.frombuffer(streams[3].tobytes(), "<u4")
    corners, guides = decode_triangles(streams[1], streams[2], names_of_places, positions)
    wedges, places = decode_wedges(corners.ravel(), streams[4], positions, vertices)
    names = wedges.reshape(-1, 3)
    every = fulfil(unzigzag_planes(streams[5], 3, 4), guides)[places]
    turned = unzigzag_planes(streams[6], 2, 2)
    decoded = Pack(
        every,
        (foretell_normals(every, names) + turned).astype(np.int16),
        unstep_planes(streams[7], 4),
        make_local(names, sizes),
    )
    for array in decoded:
        array.flags.writeable = False
    return decoded


def _joined(arrays: Sequence[np.ndarray], dtype: type, width: int) -> np.ndarray:
    """Arrays (n, width) one after the other; (0, width) for none."""
    return np.concatenate([np.zeros((0, width), dtype), *(array.reshape(-1, width) for array in arrays)])
