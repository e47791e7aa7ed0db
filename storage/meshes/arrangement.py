"""A mesh in the order in which it compresses best: triangles along strips, each turned as the connectivity codec turns
it, vertices numbered by first use.

All in one kernel: most levels have a hundred triangles, for which steps in numpy would cost more than the work itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel
from storage.meshes.connectivity import encode_triangles
from storage.meshes.mesh_order import CACHE, first_use, same_rows, triangle_order
from storage.meshes.normals import from_octahedral, to_octahedral


@allocating_kernel()
def arranged(
    positions: NDArray[np.int32],
    normals: NDArray[np.float32],
    colours: NDArray[np.uint8],
    triangles: NDArray[np.uint32],
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint32], NDArray[np.int64]]:
    """Positions (k, 3), normals (k, 3), colours (k, 4) and triangles (m, 3) as a pack keeps them: see `pack`.

    positions (n, 3), normals (n, 3), colours (n, 4), triangles (m, 3) with indices below n. Vertices that agree in
    position, rounded normal and colour become one. Also gives the order (m,) in which the triangles were taken.
    """
    n, m = len(positions), len(triangles)
    folded = to_octahedral(normals)
    whole = np.empty((n, 6), np.int32)
    for v in range(n):
        whole[v, 0], whole[v, 1], whole[v, 2] = positions[v, 0], positions[v, 1], positions[v, 2]
        whole[v, 3], whole[v, 4] = folded[v, 0], folded[v, 1]
        colour = np.int64(0)
        for c in range(4):
            colour = (colour << 8) | np.int64(colours[v, c])
        whole[v, 5] = np.int32(colour - (1 << 31))
    vertex, _ = same_rows(whole)
    place, _ = same_rows(positions)
    corners = np.empty((m, 3), np.uint32)
    for t in range(m):
        for e in range(3):
            corners[t, e] = place[triangles[t, e]]
    order = triangle_order(corners, n, CACHE)
    taken = np.empty((m, 3), np.uint32)
    for t in range(m):
        for e in range(3):
            taken[t, e] = corners[order[t], e]
    numbered, _ = first_use(taken, n)
    turns = encode_triangles(numbered)[3]
    chosen = taken
    for t in range(m):
        for e in range(3):
            chosen[t, e] = vertex[triangles[order[t], (turns[t] + e) % 3]]
    renamed, firsts = first_use(chosen, n)
    picked = np.full(len(firsts), -1, np.int64)
    for t in range(m):
        for e in range(3):
            if picked[renamed[t, e]] < 0:
                picked[renamed[t, e]] = triangles[order[t], (turns[t] + e) % 3]
    placed = np.empty((len(picked), 3), np.int32)
    painted = np.empty((len(picked), 4), np.uint8)
    kept = np.empty((len(picked), 2), np.int32)
    for v in range(len(picked)):
        i = picked[v]
        placed[v, 0], placed[v, 1], placed[v, 2] = positions[i, 0], positions[i, 1], positions[i, 2]
        kept[v, 0], kept[v, 1] = folded[i, 0], folded[i, 1]
        for c in range(4):
            painted[v, c] = colours[i, c]
    return placed, from_octahedral(kept), painted, renamed, order
