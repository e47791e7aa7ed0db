"""Arrays as byte planes: column by column, first the lowest byte of every row, then the second, and so on.

Equal bytes lie side by side then, which is what a general compressor finds. Signed numbers are zigzagged first (0, -1,
1, -2 become 0, 1, 2, 3), so that small ones have zeros in their higher bytes.

Based on: Alted, Why Modern CPUs Are Starving and What Can Be Done about It, CiSE 12(2), 2010 (shuffle filters).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel


@allocating_kernel()
def zigzag_planes(values: NDArray[np.int32], width: int) -> NDArray[np.uint8]:
    """Planes (k * width * n,) uint8 of zigzagged values (n, k), `width` bytes each; larger values must not occur."""
    count, columns = values.shape
    out = np.empty(columns * width * count, np.uint8)
    for k in range(columns):
        for i in range(count):
            value = np.int64(values[i, k])
            zigzag = 2 * value if value >= 0 else -2 * value - 1
            for b in range(width):
                out[(k * width + b) * count + i] = (zigzag >> (8 * b)) & 255
    return out


@allocating_kernel()
def unzigzag_planes(planes: NDArray[np.uint8], columns: int, width: int) -> NDArray[np.int32]:
    """The values (n, columns) int32 that `zigzag_planes` was given."""
    count = len(planes) // (columns * width)
    out = np.empty((count, columns), np.int32)
    for k in range(columns):
        for i in range(count):
            zigzag = np.int64(0)
            for b in range(width):
                zigzag |= np.int64(planes[(k * width + b) * count + i]) << (8 * b)
            out[i, k] = (zigzag >> 1) ^ -(zigzag & 1)
    return out


@allocating_kernel()
def step_planes(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Planes (k * n,) uint8 of the differences of each row of values (n, k) from the row before, modulo 256."""
    count, columns = values.shape
    out = np.empty(columns * count, np.uint8)
    for k in range(columns):
        before = 0
        for i in range(count):
            value = int(values[i, k])
            out[k * count + i] = (value - before) & 255
            before = value
    return out


@allocating_kernel()
def unstep_planes(planes: NDArray[np.uint8], columns: int) -> NDArray[np.uint8]:
    """The values (n, columns) uint8 that `step_planes` was given."""
    count = len(planes) // columns
    out = np.empty((count, columns), np.uint8)
    for k in range(columns):
        value = 0
        for i in range(count):
            value = (value + int(planes[k * count + i])) & 255
            out[i, k] = value
    return out
