"""Packs: several meshes in one compressed frame that decodes in a few calls. (first form)"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import zstandard
from numpy.typing import NDArray

from storage.errors import CorruptStoreError

LEVEL = 9


class MeshArrays(NamedTuple):
    """One mesh as it is packed. Positions are integers; local position = integer * scale."""

    positions: NDArray[np.int32]  # (n, 3)
    triangles: NDArray[np.uint32]  # (m, 3), indices into positions
    normals: NDArray[np.float32]  # (n, 3), unit
    colours: NDArray[np.uint8]  # (n, 4)
    source_faces: NDArray[np.uint32] | None  # (m,), faces of the imported mesh; None beyond the finest level
    scale: float  # local units per integer step, a power of two


class Pack(NamedTuple):
    """A decoded pack: all its meshes' arrays one after the other; GEOMETRY says where each begins. Read-only arrays."""

    positions: NDArray[np.int32]  # (n, 3)
    normals: NDArray[np.float32]  # (n, 3), unit
    colours: NDArray[np.uint8]  # (n, 4)
    triangles: NDArray[np.uint32]  # (m, 3), indices relative to the mesh's first vertex

    @property
    def bytes(self) -> int:
        """Size in memory."""
        return self.positions.nbytes + self.normals.nbytes + self.colours.nbytes + self.triangles.nbytes


def pack(meshes: Sequence[MeshArrays]) -> bytes:
    """The meshes' positions, normals, colours and triangles as one frame."""
    parts = [
        np.concatenate([np.asarray(m.positions, np.int32).reshape(-1, 3) for m in meshes]).tobytes(),
        np.concatenate([np.asarray(m.normals, np.float32).reshape(-1, 3) for m in meshes]).tobytes(),
        np.concatenate([np.asarray(m.colours, np.uint8).reshape(-1, 4) for m in meshes]).tobytes(),
        np.concatenate([np.asarray(m.triangles, np.uint32).reshape(-1, 3) for m in meshes]).tobytes(),
    ]
    head = np.array([len(p) for p in parts], "<u4").tobytes()
    return zstandard.ZstdCompressor(LEVEL).compress(head + b"".join(parts))


def unpack(data: bytes) -> Pack:
    """Decodes a frame made by `pack`. Raises CorruptStoreError if the bytes make no sense."""
    try:
        content = zstandard.ZstdDecompressor().decompress(data)
    except zstandard.ZstdError as error:
        raise CorruptStoreError(f"a pack of meshes cannot be decoded: {error}") from error
    n = np.frombuffer(content[:16], "<u4").tolist()
    at = np.cumsum([16, *n]).tolist()
    return Pack(
        np.frombuffer(content[at[0] : at[1]], np.int32).reshape(-1, 3),
        np.frombuffer(content[at[1] : at[2]], np.float32).reshape(-1, 3),
        np.frombuffer(content[at[2] : at[3]], np.uint8).reshape(-1, 4),
        np.frombuffer(content[at[3] : at[4]], np.uint32).reshape(-1, 3),
    )


def pack_source_faces(meshes: Sequence[MeshArrays]) -> bytes:
    """The meshes' source faces as one frame; meshes without any count as faces 0."""
    faces = [
        np.zeros(len(m.triangles), "<u4") if m.source_faces is None else np.asarray(m.source_faces, "<u4") for m in meshes
    ]
    return zstandard.ZstdCompressor(LEVEL).compress(np.concatenate(faces).tobytes())


def unpack_source_faces(data: bytes) -> NDArray[np.uint32]:
    """Source faces of all triangles of a pack (m,) uint32, in its order."""
    try:
        return np.frombuffer(zstandard.ZstdDecompressor().decompress(data), "<u4")
    except (ValueError, zstandard.ZstdError) as error:
        raise CorruptStoreError(f"source faces cannot be decoded: {error}") from error
