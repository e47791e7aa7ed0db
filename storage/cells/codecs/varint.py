"""LEB128: numbers as sequences of seven-bit groups, low ones first, the high bit of a byte says that more follow.

Based on: the DWARF Debugging Information Format, version 4, 2010, section 7.6.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.kernels import allocating_kernel


@allocating_kernel()
def encode_varints(numbers: NDArray[np.uint32]) -> NDArray[np.uint8]:
    """Bytes (k,) uint8 of numbers (n,) uint32: one to five bytes each."""
    out = np.empty(5 * len(numbers), np.uint8)
    at = 0
    for i in range(len(numbers)):
        value = np.int64(numbers[i])
        while value >= 128:
            out[at] = (value & 127) | 128
            value >>= 7
            at += 1
        out[at] = value
        at += 1
    return out[:at].copy()


@allocating_kernel()
def decode_varints(data: NDArray[np.uint8], count: int) -> NDArray[np.uint32]:
    """The `count` numbers (count,) uint32 that the bytes hold, all of them. Raises ValueError if they do not."""
    out = np.empty(count, np.uint32)
    at = 0
    for i in range(count):
        value = np.int64(0)
        shift = 0
        while True:
            if at >= len(data) or shift > 28:
                raise ValueError("a number is cut short or too long")
            byte = np.int64(data[at])
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
        if value > 0xFFFFFFFF:
            raise ValueError("a number is too large")
        out[i] = value
    if at != len(data):
        raise ValueError("bytes are left over")
    return out
