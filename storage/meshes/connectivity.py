"""Triangles as one or two bytes each, and which vertices foretell each vertex's position.

A triangle that shares an edge with one of the last ones is coded by that edge and by its third vertex, which is mostly
the next new one. Across the shared edge lies the vertex that foretells the new one: the fourth corner of the
parallelogram.

Based on: Kapoulkine, meshoptimizer's index codec (https://github.com/zeux/meshoptimizer, src/indexcodec.cpp);
Touma and Gotsman, Triangle Mesh Compression, Graphics Interface 1998 (the parallelogram rule).

Codes, one byte a triangle: high nibble 0-14: the directed edge of that age among the last ones, 15: none; low nibble:
the third (or, without an edge, the first) vertex: 0: the next new one, 1-14: the vertex of that age, less one, among
the last ones, 15: named by a number. Without an edge, a further byte in `more` has the second vertex in its high and
the third in its low nibble. Named vertices go into `named`: the difference from the last named one, zigzagged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel

#: How many edges and vertices are remembered (a power of two).
MEMORY = 16


@allocating_kernel(inline="always")
def _remember_vertex(ring: NDArray[np.int64], at: int, vertex: int) -> int:
    ring[at & (MEMORY - 1)] = vertex
    return at + 1


@allocating_kernel(inline="always")
def _remember_edge(ring: NDArray[np.int64], at: int, a: int, b: int, across: int) -> int:
    ring[at & (MEMORY - 1), 0] = a
    ring[at & (MEMORY - 1), 1] = b
    ring[at & (MEMORY - 1), 2] = across
    return at + 1


@allocating_kernel()
def _vertex_code(vertex: int, fresh: int, ring: NDArray[np.int64], at: int) -> int:
    """0: the next new vertex, 1-14: one of the last ones, 15: to be named."""
    if vertex == fresh:
        return 0
    for age in range(14):
        if ring[(at - 1 - age) & (MEMORY - 1)] == vertex:
            return age + 1
    return 15


@allocating_kernel()
def encode_triangles(
    triangles: NDArray[np.uint32],
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint32], NDArray[np.int64]]:
    """Codes (m,) uint8, more (k,) uint8, named (j,) uint32 and turns (m,) int64 of triangles (m, 3) uint32.

    Decoding gives each triangle again, but turned so that it starts at its corner number `turns`.
    """
    count = len(triangles)
    codes = np.empty(count, np.uint8)
    more = np.empty(count, np.uint8)
    named = np.empty(3 * count, np.uint32)
    mores = 0
    names = 0
    turns = np.empty(count, np.int64)
    edges = np.full((MEMORY, 3), -1, np.int64)
    edge_at = 0
    ring = np.full(MEMORY, -1, np.int64)
    ring_at = 0
    fresh = 0
    last = 0
    corners = np.empty(3, np.int64)
    for t in range(count):
        found = 15
        first = 0
        for age in range(15):
            slot = (edge_at - 1 - age) & (MEMORY - 1)
            for k in range(3):
                if edges[slot, 0] == triangles[t, k] and edges[slot, 1] == triangles[t, (k + 1) % 3]:
                    found = age
                    first = k
                    break
            if found < 15:
                break
        if found == 15:
            # Start where the next new vertex is the first corner, so that fewer vertices are named.
            for k in range(3):
                if triangles[t, k] == fresh:
                    first = k
                    break
        turns[t] = first
        for k in range(3):
            corners[k] = triangles[t, (first + k) % 3]
        code = 0
        for k in range(2 if found < 15 else 0, 3):
            vertex = corners[k]
            nibble = _vertex_code(vertex, fresh, ring, ring_at)
            if nibble == 0:
                fresh += 1
            if nibble == 15:
                difference = vertex - last
                named[names] = 2 * difference if difference >= 0 else -2 * difference - 1
                names += 1
                last = vertex
            if nibble in (0, 15):
                ring_at = _remember_vertex(ring, ring_at, vertex)
            if found < 15 or k == 0:
                code = (found << 4) | nibble
            elif k == 1:
                more[mores] = nibble << 4
            else:
                more[mores] |= nibble
                mores += 1
        codes[t] = code
        a, b, c = corners[0], corners[1], corners[2]
        if found == 15:
            edge_at = _remember_edge(edges, edge_at, b, a, c)
        edge_at = _remember_edge(edges, edge_at, c, b, a)
        edge_at = _remember_edge(edges, edge_at, a, c, b)
    return codes, more[:mores].copy(), named[:names].copy(), turns


@allocating_kernel()
def decode_triangles(
    codes: NDArray[np.uint8], more: NDArray[np.uint8], named: NDArray[np.uint32], vertices: int
) -> tuple[NDArray[np.uint32], NDArray[np.int32]]:
    """Triangles (m, 3) uint32 of what `encode_triangles` gave, and what foretells each vertex (vertices, 3) int32.

    A vertex v lies about where a + b - c does, (a, b, c) its row, all of them below v; -1 for b and c: about where a
    does; -1 for all: nothing is known. Raises ValueError for codes that make no sense.
    """
    count = len(codes)
    triangles = np.empty((count, 3), np.uint32)
    guides = np.empty((vertices, 3), np.int32)
    for v in range(vertices):
        guides[v, 0] = v - 1
        guides[v, 1] = -1
        guides[v, 2] = -1
    mores = 0
    names = 0
    edges = np.full((MEMORY, 3), -1, np.int64)
    edge_at = 0
    ring = np.full(MEMORY, -1, np.int64)
    ring_at = 0
    fresh = 0
    last = 0
    corners = np.empty(3, np.int64)
    for t in range(count):
        found = int(codes[t]) >> 4
        across = -1
        second = 0
        if found < 15:
            slot = (edge_at - 1 - found) & (MEMORY - 1)
            corners[0], corners[1], across = edges[slot, 0], edges[slot, 1], int(edges[slot, 2])
        else:
            if mores >= len(more):
                raise ValueError("the codes of triangles end too soon")
            second = int(more[mores])
            mores += 1
        for k in range(2 if found < 15 else 0, 3):
            if found < 15 or k == 0:
                nibble = int(codes[t]) & 15
            elif k == 1:
                nibble = second >> 4
            else:
                nibble = second & 15
            if nibble == 0:
                vertex = fresh
                fresh += 1
            elif nibble < 15:
                vertex = int(ring[(ring_at - nibble) & (MEMORY - 1)])
            else:
                if names >= len(named):
                    raise ValueError("the names of vertices end too soon")
                zigzag = int(named[names])
                names += 1
                vertex = last + ((zigzag >> 1) ^ -(zigzag & 1))
                last = vertex
            if vertex < 0 or vertex >= vertices:
                raise ValueError("a triangle has a vertex that does not exist")
            if nibble in (0, 15):
                ring_at = _remember_vertex(ring, ring_at, vertex)
            if nibble == 0 and found < 15:
                a, b = corners[0], corners[1]
                if a < vertex and b < vertex and across >= 0 and across < vertex:
                    guides[vertex, 0] = a
                    guides[vertex, 1] = b
                    guides[vertex, 2] = across
            corners[k] = vertex
        a, b, c = corners[0], corners[1], corners[2]
        if a < 0 or b < 0:
            raise ValueError("a triangle has an edge that does not exist")
        triangles[t, 0] = a
        triangles[t, 1] = b
        triangles[t, 2] = c
        if found == 15:
            edge_at = _remember_edge(edges, edge_at, b, a, c)
        edge_at = _remember_edge(edges, edge_at, c, b, a)
        edge_at = _remember_edge(edges, edge_at, a, c, b)
    if mores != len(more) or names != len(named):
        raise ValueError("codes of triangles are left over")
    return triangles, guides


@allocating_kernel()
def foretell(values: NDArray[np.int32], guides: NDArray[np.int32]) -> NDArray[np.int32]:
    """Differences (n, k) int32 between values (n, k) int32 and what their guides (n, 3) foretell, modulo 2**32."""
    count, width = values.shape
    out = np.empty((count, width), np.int32)
    for v in range(count):
        a, b, c = guides[v, 0], guides[v, 1], guides[v, 2]
        for k in range(width):
            guess = np.int64(0)
            if b >= 0:
                guess = np.int64(values[a, k]) + values[b, k] - values[c, k]
            elif a >= 0:
                guess = np.int64(values[a, k])
            out[v, k] = np.int32(values[v, k] - guess)
    return out


@allocating_kernel()
def fulfil(differences: NDArray[np.int32], guides: NDArray[np.int32]) -> NDArray[np.int32]:
    """The values (n, k) int32 that `foretell` was given."""
    count, width = differences.shape
    out = np.empty((count, width), np.int32)
    for v in range(count):
        a, b, c = guides[v, 0], guides[v, 1], guides[v, 2]
        for k in range(width):
            guess = np.int64(0)
            if b >= 0:
                guess = np.int64(out[a, k]) + out[b, k] - out[c, k]
            elif a >= 0:
                guess = np.int64(out[a, k])
            out[v, k] = np.int32(guess + differences[v, k])
    return out


@allocating_kernel()
def make_local(names: NDArray[np.uint32], sizes: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Triangles (m, 3) of meshes one after the other, renumbered to count from each mesh's first vertex.

    sizes: (k, 3), for each mesh anything, its vertices, its triangles; they must add up to m triangles.
    Raises ValueError where a triangle names another mesh's vertex.
    """
    out = np.empty_like(names)
    first = 0
    t = 0
    for mesh in range(len(sizes)):
        end = first + int(sizes[mesh, 1])
        for _ in range(sizes[mesh, 2]):
            for k in range(3):
                name = int(names[t, k])
                if name < first or name >= end:
                    raise ValueError("a triangle names another mesh's vertex")
                out[t, k] = name - first
            t += 1
        first = end
    return out
