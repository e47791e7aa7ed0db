"""Keys of octree cells: neighbours, point location and boxes for leaf sets of mixed depths.

A key is a location code: a leading 1, then three bits a level (bit 0: x, bit 1: y, bit 2: z), coarsest level first, as
a uint64. The root is 1, its children are 8 to 15. A *leaf set* is any set of keys of which none is another's ancestor;
it may have holes. All functions are vectorised over keys and hold no Python loop over cells.

Based on: Gargantini, An Effective Way to Represent Quadtrees, CACM 25(12), 1982 (location codes);
Frisken and Perry, Simple and Efficient Traversal Methods for Quadtrees and Octrees, JGT 7(3), 2002 (neighbours).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: The key of the whole octree.
ROOT = 1

#: Deepest level of a key; finest cells are size / 2**MAX_DEPTH wide.
MAX_DEPTH = 20

Keys = NDArray[np.uint64]


def depths(keys: ArrayLike) -> NDArray[np.int64]:
    """Depth of each key (int64, same shape); the root's is 0.

    Raises ValueError for numbers that are no keys.
    """
    codes = np.asarray(keys, np.uint64)
    result = np.full(codes.shape, -1, np.int64)
    for level in range(MAX_DEPTH + 1):
        result[(codes >> np.uint64(3 * level)) == 1] = level
    if (result < 0).any():
        raise ValueError(f"{codes[result < 0].flat[0]} is not an octree key")
    return result


def depth(key: int) -> int:
    """Depth of one key; the root's is 0."""
    return int(depths(np.uint64(key)))


def children(key: int) -> Keys:
    """The eight children of a key (8,), in Morton order."""
    if depth(key) >= MAX_DEPTH:
        raise ValueError(f"key {key} is at the octree's deepest level, {MAX_DEPTH}")
    return np.uint64(int(key) << 3) + np.arange(8, dtype=np.uint64)


def parent(key: int) -> int:
    """The parent of a key. Raises ValueError for the root."""
    if int(key) <= ROOT:
        raise ValueError("the root of the octree has no parent")
    return int(key) >> 3


def ancestor(key: int, at_depth: int) -> int:
    """The key itself or its ancestor at `at_depth`."""
    levels = depth(key) - at_depth
    if at_depth < 0 or levels < 0:
        raise ValueError(f"key {key} has no ancestor at depth {at_depth}")
    return int(key) >> (3 * levels)


def encode(coordinates: ArrayLike, at_depth: ArrayLike) -> Keys:
    """Keys (n,) of integer cell coordinates (n, 3), each from 0 to 2**depth - 1, at one depth or at depths (n,)."""
    cells = np.asarray(coordinates, np.int64).reshape(-1, 3)
    deep = np.broadcast_to(np.asarray(at_depth, np.int64), cells.shape[:1])
    if (deep < 0).any() or (deep > MAX_DEPTH).any():
        raise ValueError(f"depths must be from 0 to {MAX_DEPTH}")
    if (cells < 0).any() or (cells >= (1 << deep)[:, None]).any():
        raise ValueError("cell coordinates must be from 0 to 2**depth - 1")
    spread = [_spread(cells[:, axis].astype(np.uint64)) << np.uint64(axis) for axis in range(3)]
    return (np.uint64(1) << (3 * deep).astype(np.uint64)) | spread[0] | spread[1] | spread[2]


def decode(keys: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Integer cell coordinates (n, 3) int64 and depths (n,) int64 of keys (n,)."""
    codes = np.asarray(keys, np.uint64).reshape(-1)
    deep = depths(codes)
    code = codes ^ (np.uint64(1) << (3 * deep).astype(np.uint64))
    return np.stack([_gather(code >> np.uint64(axis)) for axis in range(3)], axis=1).astype(np.int64), deep


def morton_starts(keys: ArrayLike) -> Keys:
    """First code at MAX_DEPTH (n,) that each cell covers; it covers 8**(MAX_DEPTH - depth) of them.

    Sorting a leaf set by it puts the leaves in Morton (depth-first) order.
    """
    codes = np.asarray(keys, np.uint64).reshape(-1)
    return codes << (3 * (MAX_DEPTH - depths(codes))).astype(np.uint64)


def morton_order(keys: ArrayLike) -> NDArray[np.int64]:
    """Indices (n,) that sort keys into Morton (depth-first) order; an ancestor comes before its descendants."""
    codes = np.asarray(keys, np.uint64).reshape(-1)
    return np.lexsort((codes, morton_starts(codes)))


class LeafSet:
    """Looks up which leaf of a set of mixed depths holds a place.

    Raises ValueError if one of the keys is another's ancestor or occurs twice.
    """

    def __init__(self, keys: ArrayLike) -> None:
        self.keys: Keys = np.asarray(keys, np.uint64).reshape(-1)
        self._order = morton_order(self.keys)
        starts = morton_starts(self.keys)[self._order]
        spans = np.uint64(1) << (3 * (MAX_DEPTH - depths(self.keys[self._order]))).astype(np.uint64)
        if (starts[1:] < starts[:-1] + spans[:-1]).any():
            raise ValueError("octree leaves overlap: one key is another's ancestor, or occurs twice")
        self._starts = starts
        self._ends = starts + spans

    def containing(self, keys: ArrayLike) -> NDArray[np.int64]:
        """Index (n,) of the leaf that is, or is an ancestor of, each of the keys (n,); -1 where there is none."""
        codes = np.asarray(keys, np.uint64).reshape(-1)
        if not len(self.keys) or not len(codes):
            return np.full(len(codes), -1, np.int64)
        starts = morton_starts(codes)
        spans = np.uint64(1) << (3 * (MAX_DEPTH - depths(codes))).astype(np.uint64)
        place = np.searchsorted(self._starts, starts, side="right") - 1
        at = np.maximum(place, 0)
        inside = (place >= 0) & (starts + spans <= self._ends[at])
        return np.where(inside, self._order[at], -1)


def neighbours(keys: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All pairs of leaves that share (part of) a face.

    keys: a leaf set (n,) of mixed depths, in any order, holes allowed.
    Returns pairs (k, 2) int64 of indices into keys, first < second, sorted; and the axis (k,) int64 (0, 1 or 2) at
    right angles to the shared face. Raises ValueError if leaves overlap.
    """
    leaves = LeafSet(keys)
    cells, deep = decode(leaves.keys)
    found: list[NDArray[np.int64]] = []
    for axis in range(3):
        for step in (-1, 1):
            beside = cells.copy()
            beside[:, axis] += step
            own = np.flatnonzero((beside[:, axis] >= 0) & (beside[:, axis] < (1 << deep)))
            other = leaves.containing(encode(beside[own], deep[own]))
            # Every shared face is the whole face of the deeper cell: look from there. Equal depths: look upward only.
            seen = other >= 0
            if step < 0:
                seen &= deep[np.maximum(other, 0)] < deep[own]
            own, other = own[seen], other[seen]
            found.append(np.stack([np.minimum(own, other), np.maximum(own, other), np.full(len(own), axis)], axis=1))
    table = np.concatenate(found)
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    return table[:, :2], table[:, 2]


@dataclass(frozen=True)
class Octree:
    """Where the octree of view cells lies: a cube from `lo` (x, y, z), `size` wide, in model units."""

    lo: tuple[float, float, float]
    size: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "lo", tuple(float(value) for value in self.lo))
        object.__setattr__(self, "size", float(self.size))
        if len(self.lo) != 3 or not np.isfinite(self.lo).all() or not np.isfinite(self.size) or self.size <= 0:
            raise ValueError(f"an octree needs a finite corner (3) and a positive size, not {self.lo} and {self.size}")

    @staticmethod
    def around(lo: ArrayLike, hi: ArrayLike) -> Octree:
        """The smallest cube that holds the box from lo to hi (3,), centred on it; never smaller than float64 allows."""
        low, high = np.asarray(lo, np.float64), np.asarray(hi, np.float64)
        largest = max(float(np.abs(low).max()), float(np.abs(high).max()), 1e-30)
        size = max(float((high - low).max()), largest * 1e-7) * (1 + 1e-12) + 4e-15 * largest
        corner = (low + high) / 2 - size / 2
        return Octree((float(corner[0]), float(corner[1]), float(corner[2])), size)

    def faces(self, coordinates: ArrayLike, at_depth: ArrayLike) -> NDArray[np.float64]:
        """Positions (n, 3) of the lower corners of integer cell coordinates (n, 3) at depths (n,) or one depth.

        A plane has the very same float64 coordinate at every depth: coordinate / 2**depth is exact.
        """
        fractions = np.ldexp(np.asarray(coordinates, np.float64), -np.asarray(at_depth, np.int64)[..., None])
        return np.asarray(self.lo) + self.size * fractions

    def boxes(self, keys: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Boxes of keys (n,): lo and hi (n, 3) float64 in model units. Neighbours share exactly equal coordinates."""
        cells, deep = decode(keys)
        return self.faces(cells, deep), self.faces(cells + 1, deep)

    def box(self, key: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The box of one key: lo and hi (3,) float64 in model units."""
        lo, hi = self.boxes(np.asarray([key], np.uint64))
        return lo[0], hi[0]

    def codes(self, points: ArrayLike) -> tuple[Keys, NDArray[np.bool_]]:
        """Keys (n,) at MAX_DEPTH of the finest cells around points (n, 3), and whether each point is in the octree.

        Cells are closed below and open above, the octree itself is closed. Agrees exactly with `boxes`.
        """
        p = np.asarray(points, np.float64).reshape(-1, 3)
        low, high = self.faces(np.zeros((1, 3)), 0), self.faces(np.ones((1, 3)), 0)
        inside: NDArray[np.bool_] = np.all((p >= low) & (p <= high), axis=1)
        cells = 1 << MAX_DEPTH
        where = np.where(inside[:, None], (p - low) / self.size * cells, 0)
        guess = np.clip(np.floor(where), 0, cells - 1).astype(np.int64)
        guess -= (self.faces(guess, MAX_DEPTH) > p) & (guess > 0)
        guess += (self.faces(guess + 1, MAX_DEPTH) <= p) & (guess < cells - 1)
        return encode(np.where(inside[:, None], guess, 0), MAX_DEPTH), inside

    def locate(self, points: ArrayLike, leaves: LeafSet) -> NDArray[np.int64]:
        """Index (n,) int64 of the leaf that holds each of the points (n, 3); -1 where there is none."""
        codes, inside = self.codes(points)
        return np.where(inside, leaves.containing(codes), -1)


def _spread(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Puts two zero bits between the low 21 bits of each value."""
    x: Any = values & np.uint64(0x1FFFFF)
    for shift, mask in (
        (32, 0x001F00000000FFFF),
        (16, 0x001F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return np.asarray(x, np.uint64)


def _gather(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The reverse of `_spread`: every third bit of each value."""
    x: Any = values & np.uint64(0x1249249249249249)
    for shift, mask in (
        (2, 0x10C30C30C30C30C3),
        (4, 0x100F00F00F00F00F),
        (8, 0x001F0000FF0000FF),
        (16, 0x001F00000000FFFF),
        (32, 0x00000000001FFFFF),
    ):
        x = (x | (x >> np.uint64(shift))) & np.uint64(mask)
    return np.asarray(x, np.uint64)
