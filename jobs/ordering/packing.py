"""Packs and shards along an order of meshes: where each begins.

A pack is closed by the bytes of its meshes; yet where it is long enough already, the mesh behind it may close it by
what that is. So where an order is the same as before but for a few meshes, packs and shards become the same again soon
behind them, and keep their bytes and their names.

Based on: A. Muthitacharoen, B. Chen, D. Mazieres, A Low-Bandwidth Network File System, SOSP 2001
(boundaries by content).
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel

#: Bytes of a pack's meshes, uncompressed: from the first on a mesh may close it, at the second it is closed.
PACK_FROM, PACK_MOST = 3 << 14, 5 << 14

#: Packs of a shard, likewise: about a megabyte, compressed.
SHARD_FROM, SHARD_MOST = 96, 160

#: One of so many meshes closes a pack, one of so many packs a shard.
PACK_ODDS, SHARD_ODDS = 8, 32


def pack_starts(sizes: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """The place of each pack's first mesh, and the end: (packs + 1,) int64.

    sizes: (m,) int64 bytes of the meshes, in their order; marks: (m,) uint64 random numbers that follow from each.
    """
    return _starts(sizes, marks % np.uint64(PACK_ODDS) == 0, PACK_FROM, PACK_MOST)


def shard_starts(marks: np.ndarray) -> np.ndarray:
    """The number of each shard's first pack, and the end: (shards + 1,) int64.

    marks: (packs,) uint64 of their first meshes.
    """
    chosen = (marks // np.uint64(PACK_ODDS)) % np.uint64(SHARD_ODDS) == 0
    return _starts(np.ones(len(marks), np.int64), chosen, SHARD_FROM, SHARD_MOST)


@allocating_kernel()
def _starts(sizes: np.ndarray, chosen: np.ndarray, low: int, high: int) -> np.ndarray:
    starts = np.zeros(len(sizes) + 1, np.int64)
    count, filled = 0, 0
    for at in range(len(sizes)):
        if filled >= high or (filled >= low and chosen[at]):
            count += 1
            starts[count] = at
            filled = 0
        filled += sizes[at]
    if len(sizes) > 0:
        count += 1
        starts[count] = len(sizes)
    return starts[: count + 1].copy()
