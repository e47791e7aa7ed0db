"""MinHash signatures: for each column the least of its rows' random numbers, under several draws of these.

Two columns agree in one of them as often as the part of their rows that they share. Sorted by a few of them, columns
that share much stand close to each other: the bands of locality-sensitive hashing, with the order in place of buckets.

Based on: A. Z. Broder, On the Resemblance and Containment of Documents, SEQUENCES 1997; A. Andoni, P. Indyk,
Near-Optimal Hashing Algorithms for Approximate Nearest Neighbor in High Dimensions, FOCS 2006; M. Bawa, T. Condie,
P. Ganesan, LSH Forest, WWW 2005 (the sorted order).
"""

from __future__ import annotations

import numpy as np

from jobs.ordering.columns import Columns
from storage.base.kernels import allocating_kernel

#: Numbers in a signature: so many orders are searched.
DRAWS = 16

#: Numbers by which one order is sorted, 16 bits of each.
BAND = 4


def mixed(numbers: np.ndarray) -> np.ndarray:
    """Numbers (n,) uint64 to others that look random: the same on every machine.

    Based on: G. L. Steele, D. Lea, C. H. Flood, Fast Splittable Pseudorandom Number Generators, OOPSLA 2014.
    """
    with np.errstate(over="ignore"):
        x = (numbers + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(x ^ (x >> np.uint64(31)), np.uint64)


def draws(height: int) -> np.ndarray:
    """A random number for each row and each draw: (height, DRAWS) uint32."""
    return (mixed(np.arange(height * DRAWS, dtype=np.uint64)) >> np.uint64(32)).astype(np.uint32).reshape(height, DRAWS)


def signatures(columns: Columns, numbers: np.ndarray, block: np.ndarray) -> np.ndarray:
    """The signatures of a block of columns (m,), in its order: (m, DRAWS) uint32; numbers: what `draws` gave."""
    return _least(columns.offsets, columns.rows, numbers, block)


def alike_orders(found: np.ndarray) -> np.ndarray:
    """The places 0 to m - 1 of signatures (m, DRAWS), sorted by each draw and those after it: (DRAWS, m) int32."""
    low = found.astype(np.uint64) & np.uint64(0xFFFF)
    orders = np.empty((DRAWS, len(found)), np.int32)
    for draw in range(DRAWS):
        key = np.zeros(len(found), np.uint64)
        for after in range(BAND):
            key = (key << np.uint64(16)) | low[:, (draw + after) % DRAWS]
        orders[draw] = np.argsort(key, kind="stable")
    return orders


@allocating_kernel()
def _least(offsets: np.ndarray, rows: np.ndarray, numbers: np.ndarray, block: np.ndarray) -> np.ndarray:
    least = np.full((len(block), numbers.shape[1]), np.uint32(0xFFFFFFFF), np.uint32)
    for place in range(len(block)):
        for at in range(offsets[block[place]], offsets[block[place] + 1]):
            row = rows[at]
            for draw in range(numbers.shape[1]):
                least[place, draw] = min(least[place, draw], numbers[row, draw])
    return least
