"""Few, large vertex and index buffers that hold all packs on the GPU, with a free list in each.

A slab is one vertex buffer and one index buffer; it doubles until it reaches its limit, then the next slab begins. So a
model of ordinary size lies in a single slab and is drawn with a handful of calls.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from player.renderer.free_list import FreeList

#: A vertex on the GPU: 20 bytes.
VERTEX = np.dtype(
    [
        ("position", "<f4", (3,)),  # grid units; whole numbers where the mesh lies in model space
        ("normal", "<i2", (2,)),  # octahedral, as stored: storage.meshes.normals
        ("colour", "u1", (4,)),  # red, green, blue, alpha as stored
    ]
)

INDEX_BYTES = 4


class Slab:
    """One vertex buffer and one index buffer."""

    def __init__(self, context: moderngl.Context, vertices: int, indices: int) -> None:
        self._context = context
        self.vertices = FreeList(vertices)
        self.indices = FreeList(indices)
        self.vertex_buffer = context.buffer(reserve=vertices * VERTEX.itemsize)
        self.index_buffer = context.buffer(reserve=indices * INDEX_BYTES)
        self.version = 0  # changes when the buffers are replaced by larger ones

    def allocate(self, vertices: int, indices: int) -> tuple[int, int] | None:
        """Starts of a free vertex and index range, or None if either does not fit."""
        first_vertex = self.vertices.allocate(vertices)
        if first_vertex is None:
            return None
        first_index = self.indices.allocate(indices)
        if first_index is None:
            self.vertices.release(first_vertex, vertices)
            return None
        return first_vertex, first_index

    def grow(self, vertices: int, indices: int) -> None:
        """Replaces the buffers by larger ones of these capacities and copies what they hold."""
        self.vertex_buffer = self._grown(self.vertex_buffer, vertices * VERTEX.itemsize)
        self.index_buffer = self._grown(self.index_buffer, indices * INDEX_BYTES)
        self.vertices.grow(vertices)
        self.indices.grow(indices)
        self.version += 1

    def _grown(self, buffer: moderngl.Buffer, size: int) -> moderngl.Buffer:
        larger = self._context.buffer(reserve=size)
        self._context.copy_buffer(larger, buffer, size=buffer.size)
        buffer.release()
        return larger

    def release(self) -> None:
        """Frees the buffers."""
        self.vertex_buffer.release()
        self.index_buffer.release()


@dataclass(frozen=True)
class _Place:
    slab: int
    first_vertex: int
    vertices: int
    first_index: int
    indices: int


class Arena:
    """Where each pack lies on the GPU.

    slab_of (packs,) int32: the slab that holds the pack, -1 where it is absent; first_index (packs,) int64: its first
    index in the slab's index buffer. Indices in the buffers are absolute, so no base vertex is needed to draw.
    """

    def __init__(
        self,
        context: moderngl.Context,
        packs: int,
        *,
        first_vertices: int = 1 << 17,
        largest_vertices: int = 1 << 24,
        indices_per_vertex: int = 6,
    ) -> None:
        """packs: number of packs in the store; first_vertices and largest_vertices: a slab's size in vertices."""
        self._context = context
        self._first_vertices = first_vertices
        self._largest_vertices = largest_vertices
        self._indices_per_vertex = indices_per_vertex
        self._places: dict[int, _Place] = {}
        self.slabs: list[Slab] = []
        self.slab_of = np.full(packs, -1, np.int32)
        self.first_index = np.zeros(packs, np.int64)
        self.version = 0  # changes whenever a pack comes or goes

    def add(self, pack: int, vertices: NDArray[np.void], triangles: NDArray[np.uint32]) -> None:
        """Uploads a pack: VERTEX records (n,), triangles (m, 3) that count vertices from the pack's first."""
        if pack in self._places:
            return
        place = self._find(len(vertices), triangles.size)
        slab = self.slabs[place.slab]
        if len(vertices):
            slab.vertex_buffer.write(vertices.tobytes(), offset=place.first_vertex * VERTEX.itemsize)
        if triangles.size:
            absolute = triangles.astype(np.uint32) + np.uint32(place.first_vertex)
            slab.index_buffer.write(absolute.tobytes(), offset=place.first_index * INDEX_BYTES)
        self._places[pack] = place
        self.slab_of[pack] = place.slab
        self.first_index[pack] = place.first_index
        self.version += 1

    def remove(self, pack: int) -> None:
        """Frees the room of a pack."""
        place = self._places.pop(pack)
        slab = self.slabs[place.slab]
        slab.vertices.release(place.first_vertex, place.vertices)
        slab.indices.release(place.first_index, place.indices)
        self.slab_of[pack] = -1
        self.version += 1

    def release(self) -> None:
        """Frees all buffers."""
        for slab in self.slabs:
            slab.release()
        self.slabs.clear()
        self._places.clear()
        self.slab_of[:] = -1
        self.version += 1

    def _find(self, vertices: int, indices: int) -> _Place:
        for number, slab in enumerate(self.slabs):
            room = slab.allocate(vertices, indices)
            while room is None and slab.vertices.capacity < self._largest_vertices:
                slab.grow(
                    min(2 * slab.vertices.capacity, self._largest_vertices),
                    min(2 * slab.indices.capacity, self._largest_vertices * self._indices_per_vertex),
                )
                room = slab.allocate(vertices, indices)
            if room is not None:
                return _Place(number, room[0], vertices, room[1], indices)
        first = max(self._first_vertices, vertices, -(-indices // self._indices_per_vertex))
        self.slabs.append(Slab(self._context, first, max(first * self._indices_per_vertex, 1)))
        room = self.slabs[-1].allocate(vertices, indices)
        if room is None:
            raise AssertionError("a new slab holds what it was made for")
        return _Place(len(self.slabs) - 1, room[0], vertices, room[1], indices)
