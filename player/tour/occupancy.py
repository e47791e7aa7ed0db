"""Kernels on a grid of voxels: where surfaces are, how far off they are, and the cheapest way between them.

Pure functions of arrays. A grid is indexed [x, y, z]; voxel i spans lo + size * i to lo + size * (i + 1) on each axis.

Based on: Schwarz, Seidel: Fast Parallel Surface and Solid Voxelization on GPUs, SIGGRAPH Asia 2010 (triangles to
voxels); Borgefors: Distance Transformations in Digital Images, CVGIP 34, 1986 (chamfer distance); Dijkstra 1959.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel


@allocating_kernel()
def mark_triangles(
    grid: NDArray[np.bool_],
    facing: NDArray[np.float32],
    corners: NDArray[np.float64],
    one_sided: bool,
    lo: NDArray[np.float64],
    size: float,
) -> None:  # pragma: no cover - compiled
    """Sets the voxels of grid (nx, ny, nz) bool that triangles (m, 3, 3) float64 in model units touch, and few others.

    facing (nx, ny, nz, 3) float32: gets the unit normals added, in each voxel, of triangles that can be seen from one
    side only. lo (3,), size: the grid's corner and the voxels' edge, in model units.
    """
    half = 0.5 + 1e-6
    p = np.empty((3, 3))
    first = np.empty(3, np.int64)
    last = np.empty(3, np.int64)
    normal = np.empty(3)
    centre = np.empty(3)
    for t in range(len(corners)):
        for axis in range(3):
            for k in range(3):
                p[k, axis] = (corners[t, k, axis] - lo[axis]) / size
            low = min(p[0, axis], p[1, axis], p[2, axis])
            high = max(p[0, axis], p[1, axis], p[2, axis])
            first[axis] = max(0, int(np.floor(low - 1e-6)))
            last[axis] = min(grid.shape[axis] - 1, int(np.floor(high + 1e-6)))
        reach = 0.0
        for axis in range(3):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            normal[axis] = (p[1, u] - p[0, u]) * (p[2, v] - p[0, v]) - (p[1, v] - p[0, v]) * (p[2, u] - p[0, u])
            reach += half * abs(normal[axis])
        length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        for x in range(first[0], last[0] + 1):
            for y in range(first[1], last[1] + 1):
                for z in range(first[2], last[2] + 1):
                    centre[0], centre[1], centre[2] = x + 0.5, y + 0.5, z + 0.5
                    off = 0.0
                    for axis in range(3):
                        off += normal[axis] * (centre[axis] - p[0, axis])
                    touches = abs(off) <= reach
                    for axis in range(3):  # the triangle's shadow along each axis against the voxel's
                        u, v = (axis + 1) % 3, (axis + 2) % 3
                        turn = 1.0 if normal[axis] >= 0 else -1.0
                        for k in range(3):
                            n = (k + 1) % 3
                            eu, ev = (p[k, v] - p[n, v]) * turn, (p[n, u] - p[k, u]) * turn
                            side = eu * (centre[u] - p[k, u]) + ev * (centre[v] - p[k, v])
                            touches &= side + half * (abs(eu) + abs(ev)) >= 0
                    if touches:
                        grid[x, y, z] = True
                        if one_sided and length > 0:
                            for axis in range(3):
                                facing[x, y, z, axis] += normal[axis] / length


@allocating_kernel()
def clearance(occupied: NDArray[np.bool_]) -> NDArray[np.float32]:  # pragma: no cover - compiled
    """Distance (nx, ny, nz) float32 in voxels from each voxel to the nearest occupied one, at most 13 % too far.

    Voxels beyond the grid count as free.
    """
    nx, ny, nz = occupied.shape
    distance = np.empty(occupied.shape, np.float32)
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                distance[x, y, z] = 0.0 if occupied[x, y, z] else 1e9
    for sign in (1, -1):
        for i in range(nx):
            x = i if sign > 0 else nx - 1 - i
            for j in range(ny):
                y = j if sign > 0 else ny - 1 - j
                for k in range(nz):
                    z = k if sign > 0 else nz - 1 - k
                    best = distance[x, y, z]
                    for dx in range(-1, 2):
                        for dy in range(-1, 2):
                            for dz in range(-1, 2):
                                if (dx * 9 + dy * 3 + dz) * sign >= 0:
                                    continue  # the half of the neighbours that this sweep has passed
                                a, b, c = x + dx, y + dy, z + dz
                                if 0 <= a < nx and 0 <= b < ny and 0 <= c < nz:
                                    step = np.float32(np.sqrt(np.float64(dx * dx + dy * dy + dz * dz)))
                                    best = min(best, distance[a, b, c] + step)
                    distance[x, y, z] = best
    return distance


@allocating_kernel()
def free_run(occupied: NDArray[np.bool_], axis: int, sign: int) -> NDArray[np.int32]:  # pragma: no cover - compiled
    """Free voxels (nx, ny, nz) int32 between each voxel and the next occupied one along an axis; -1: there is none.

    sign: +1 looks towards larger indices, -1 towards smaller ones. Occupied voxels have 0.
    """
    result = np.empty(occupied.shape, np.int32)
    length = occupied.shape[axis]
    u, v = (axis + 1) % 3, (axis + 2) % 3
    index = np.zeros(3, np.int64)
    for i in range(occupied.shape[u]):
        for j in range(occupied.shape[v]):
            run = -1
            for k in range(length):
                index[u], index[v] = i, j
                index[axis] = length - 1 - k if sign > 0 else k
                x, y, z = index[0], index[1], index[2]
                if occupied[x, y, z]:
                    run = 0
                    result[x, y, z] = 0
                else:
                    result[x, y, z] = run
                    if run >= 0:
                        run += 1
    return result


@allocating_kernel()
def enclosure(
    occupied: NDArray[np.bool_],
    facing: NDArray[np.float32],
    voxels: NDArray[np.int64],
    directions: NDArray[np.float64],
) -> NDArray[np.float32]:  # pragma: no cover - compiled
    """For each of the voxels (n, 3): the part of the directions (k, 3), unit vectors, in which something can be seen.

    That is an occupied voxel, unless all that it holds turns its back: facing as in `mark_triangles`. So the inside of
    a solid is not taken for a room.
    """
    result = np.zeros(len(voxels), np.float32)
    for n in range(len(voxels)):
        seen = 0
        for d in range(len(directions)):
            x, y, z = voxels[n, 0] + 0.5, voxels[n, 1] + 0.5, voxels[n, 2] + 0.5
            while True:
                x += directions[d, 0]
                y += directions[d, 1]
                z += directions[d, 2]
                i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
                if not (0 <= i < occupied.shape[0] and 0 <= j < occupied.shape[1] and 0 <= k < occupied.shape[2]):
                    break
                if occupied[i, j, k]:
                    away = 0.0
                    total = 0.0
                    for axis in range(3):
                        away += facing[i, j, k, axis] * directions[d, axis]
                        total += facing[i, j, k, axis] ** 2
                    if away <= 0.1 * np.sqrt(total):
                        seen += 1
                    break
        result[n] = seen / len(directions)
    return result


@allocating_kernel()
def cheapest_ways(
    cost: NDArray[np.float32], start: int
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:  # pragma: no cover - compiled
    """The cheapest ways from voxel `start` (flat index) to all others, through 26 neighbours.

    cost (nx, ny, nz): of one voxel's length of way through each voxel; infinite where no way leads, not even across its
    edges and corners.
    Returns (n,) float32, the cost of the way to each voxel, infinite where there is none; (n,) int32: the one before.
    """
    nx, ny, nz = cost.shape
    flat = cost.ravel()
    total = np.full(flat.size, np.inf, np.float32)
    before = np.full(flat.size, -1, np.int32)
    total[start] = 0.0
    heap = [(np.float32(0.0), np.int64(start))]
    while heap:
        reached, here = heapq.heappop(heap)
        if reached > total[here]:
            continue
        x, y, z = here // (ny * nz), (here // nz) % ny, here % nz
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    a, b, c = x + dx, y + dy, z + dz
                    if a < 0 or b < 0 or c < 0 or a >= nx or b >= ny or c >= nz:
                        continue
                    there = (a * ny + b) * nz + c
                    step = np.sqrt(np.float32(dx * dx + dy * dy + dz * dz)) * np.float32(0.5)
                    cheaper = np.float32(reached + step * (flat[here] + flat[there]))
                    if cheaper < total[there]:
                        passed = np.float32(0.0)  # all voxels that the step touches
                        for i in range(2):
                            for j in range(2):
                                for k in range(2):
                                    passed += flat[((x + i * dx) * ny + y + j * dy) * nz + z + k * dz]
                        if not np.isfinite(passed):
                            continue
                        total[there] = cheaper
                        before[there] = here
                        heapq.heappush(heap, (cheaper, np.int64(there)))
    return total, before
