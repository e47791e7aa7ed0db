"""Which vertices of different things lie near each other: what simplification may join besides edges.

Vertices are put in the order of a space-filling curve; neighbours along it that belong to different things are pairs.
The curve is drawn twice, the second time shifted, so that what one's jumps keep apart is near on the other.

Based on: M. Garland, P. S. Heckbert, Surface Simplification Using Quadric Error Metrics, SIGGRAPH 1997, section 3
(contraction of pairs that no edge joins); T. M. Chan, Approximate Nearest Neighbor Queries Revisited, Discrete &
Computational Geometry 20, 1998 (shifted space-filling curves).
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel, kernel

#: Bits of a coordinate along the curve.
BITS = 20


@kernel()
def _spread(x: int) -> int:
    """The lowest BITS bits of a number with two zeros between each and the next."""
    x &= 0x1FFFFF
    x = (x | x << 32) & 0x1F00000000FFFF
    x = (x | x << 16) & 0x1F0000FF0000FF
    x = (x | x << 8) & 0x100F00F00F00F00F
    x = (x | x << 4) & 0x10C30C30C30C30C3
    return (x | x << 2) & 0x1249249249249249


@allocating_kernel()
def near_pairs(points: np.ndarray, triangles: np.ndarray, thing: np.ndarray) -> np.ndarray:
    """Pairs (p, 2) int32, at most two a vertex, of near vertices of different things; each once, smaller one first.

    points (n, 3) int32; triangles (m, 3) int32 and the thing (m,) int32 that each belongs to, which share no vertices.
    """
    n = len(points)
    owner = np.full(n, -1, np.int32)
    for t in range(len(triangles)):
        for e in range(3):
            owner[triangles[t, e]] = thing[t]
    low = np.empty(3, np.int64)
    extent = np.int64(1)
    for c in range(3):
        high = np.int64(points[:, c].max())
        low[c] = points[:, c].min()
        extent = max(extent, high - low[c])
    shift = 0
    while (3 * extent // 2) >> shift >= 1 << BITS:
        shift += 1
    codes = np.empty(n, np.int64)
    found = np.empty(2 * n, np.int64)
    count = 0
    for turn in range(2):
        moved = turn * (extent // 3)
        for i in range(n):
            code = np.int64(0)
            for c in range(3):
                code |= _spread((np.int64(points[i, c]) - low[c] + moved) >> shift) << c
            codes[i] = code
        order = np.argsort(codes, kind="mergesort")
        for s in range(n - 1):
            i, j = order[s], order[s + 1]
            if owner[i] >= 0 and owner[j] >= 0 and owner[i] != owner[j]:
                found[count] = min(i, j) * n + max(i, j)
                count += 1
    pairs = np.empty((count, 2), np.int32)
    found = np.sort(found[:count])
    kept = 0
    for i in range(count):
        if i == 0 or found[i] != found[i - 1]:
            pairs[kept, 0], pairs[kept, 1] = found[i] // n, found[i] % n
            kept += 1
    return pairs[:kept].copy()
