"""The order of a mesh's triangles and vertices: near triangles follow each other, vertices are numbered by first use.

Such meshes compress well (see `connectivity`) and draw fast, since a graphics card's vertex cache finds them again.

Based on: Sander, Nehab, Barczak: Fast Triangle Reordering for Vertex Locality and Reduced Overdraw, SIGGRAPH 2007
(the "tipsify" algorithm).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel

#: Size of the vertex cache, in vertices, that the order is made for.
CACHE = 16


@allocating_kernel()
def triangle_order(triangles: NDArray[np.uint32], vertices: int, cache: int) -> NDArray[np.int64]:
    """An order (m,) int64 of triangles (m, 3) in which near ones follow each other.

    triangles: indices below `vertices`; cache: vertices in the cache, 3 or more. Linear time.
    """
    count = len(triangles)
    starts = np.zeros(vertices + 1, np.int64)
    for t in range(count):
        for k in range(3):
            starts[triangles[t, k] + 1] += 1
    for vertex in range(vertices):
        starts[vertex + 1] += starts[vertex]
    live = starts[1:] - starts[:-1]
    fill = starts[:-1].copy()
    around = np.empty(3 * count, np.int64)
    for t in range(count):
        for k in range(3):
            v = triangles[t, k]
            around[fill[v]] = t
            fill[v] += 1

    order = np.empty(count, np.int64)
    done = 0
    emitted = np.zeros(count, np.bool_)
    stamps = np.zeros(vertices, np.int64)
    time = cache + 1
    dead_ends = np.empty(3 * count, np.int64)
    ends = 0
    cursor = 0
    candidates = np.empty(3 * count, np.int64)
    while cursor < vertices and live[cursor] == 0:
        cursor += 1
    fan = cursor if cursor < vertices else -1
    while fan >= 0:
        found = 0
        for i in range(starts[fan], starts[fan + 1]):
            triangle = around[i]
            if emitted[triangle]:
                continue
            emitted[triangle] = True
            order[done] = triangle
            done += 1
            for k in range(3):
                v = np.int64(triangles[triangle, k])
                dead_ends[ends] = v
                ends += 1
                candidates[found] = v
                found += 1
                live[v] -= 1
                if time - stamps[v] > cache:
                    stamps[v] = time
                    time += 1
        # The next fan: a vertex just used that will still be in the cache when its own fan is done, the oldest first.
        best = -1
        best_age = np.int64(-1)
        for i in range(found):
            v = candidates[i]
            if live[v] > 0:
                age = np.int64(0)
                if time - stamps[v] + 2 * live[v] <= cache:
                    age = time - stamps[v]
                if age > best_age:
                    best_age = age
                    best = v
        while best < 0 and ends > 0:
            ends -= 1
            if live[dead_ends[ends]] > 0:
                best = dead_ends[ends]
        while best < 0 and cursor < vertices:
            if live[cursor] > 0:
                best = cursor
            else:
                cursor += 1
        fan = best
    return order


@allocating_kernel()
def same_rows(rows: NDArray[np.int32]) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """Numbers (n,) uint32 of rows (n, k) int32, equal for equal rows, counting up by first occurrence.

    Also gives the first row (j,) int64 with each number.
    """
    count, width = rows.shape
    slots = 16
    while slots < 2 * count:
        slots *= 2
    table = np.full(slots, -1, np.int64)
    numbers = np.empty(count, np.uint32)
    firsts = np.empty(count, np.int64)
    used = 0
    for i in range(count):
        mixed = 0
        for k in range(width):
            mixed = ((mixed ^ int(rows[i, k])) & 0xFFFFFFFF) * 0x45D9F3B
            mixed ^= mixed >> 29
        slot = mixed & (slots - 1)
        while table[slot] >= 0:
            other = firsts[table[slot]]
            equal = True
            for k in range(width):
                if rows[i, k] != rows[other, k]:
                    equal = False
                    break
            if equal:
                break
            slot = (slot + 1) & (slots - 1)
        if table[slot] < 0:
            table[slot] = used
            firsts[used] = i
            used += 1
        numbers[i] = table[slot]
    return numbers, firsts[:used].copy()


@allocating_kernel()
def first_use(triangles: NDArray[np.uint32], vertices: int) -> tuple[NDArray[np.uint32], NDArray[np.int64]]:
    """Renumbers vertices by first use: the triangles (m, 3) uint32 anew, and the old number (k,) int64 of each vertex.

    Vertices that no triangle uses are left out.
    """
    numbers = np.full(vertices, -1, np.int64)
    old = np.empty(vertices, np.int64)
    used = 0
    result = np.empty_like(triangles)
    for t in range(len(triangles)):
        for k in range(3):
            v = triangles[t, k]
            if numbers[v] < 0:
                numbers[v] = used
                old[used] = v
                used += 1
            result[t, k] = numbers[v]
    return result, old[:used].copy()
