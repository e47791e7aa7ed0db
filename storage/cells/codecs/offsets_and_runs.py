"""The vLOD paper's own code: offsets and runs of ids as numbers in binary, two-bit delimiters between them.

A number is written without leading zeros, 11 in it becomes 110, one that then ends in 01 ends in 011 instead (and 1
itself becomes 11), and 11 stands between numbers: the first 1 of the next one makes it 111.

Ones in a row can be read in two ways until the first bit that is not 1: 11111 is an end in 1, a delimiter and a new
number, or an end in 0, a delimiter and ones of numbers that are 1. The paper's decoder guesses the first, and takes
its guess back where 11110 would begin a number. This one counts the ones and decides at their end, which comes to the
same: with k numbers that are 1 in the row and a next one that begins with s = 1 or 2 ones, the row is 2 + 4 k + s long
after an end in 0, and 4 + 4 k + s after an end in 1, so its length modulo 4 tells.

Based on: Chhugani et al., vLOD: High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005,
section 6 and appendix A.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import CorruptStoreError
from storage.base.kernels import allocating_kernel

#: Largest number that can be coded.
LARGEST = (1 << 40) - 1

#: No list holds more ids: a few damaged bits could say so many that no memory holds them.
LONGEST = 1 << 22


def offsets_and_runs(ids: NDArray[np.integer]) -> NDArray[np.int64]:
    """Strictly increasing ids (n,) as numbers (2 r,) int64, all positive: to each run how far from the end of the last
    one it begins, of the first run its id plus 1, and how long it is.
    """
    numbers = np.asarray(ids, np.int64)
    if not len(numbers):
        return np.zeros(0, np.int64)
    begins = np.flatnonzero(np.diff(numbers, prepend=-2) != 1)
    lengths = np.diff(begins, append=len(numbers))
    starts = numbers[begins]
    offsets = np.diff(starts, prepend=0)
    offsets[1:] -= lengths[:-1]
    offsets[0] += 1
    return np.stack([offsets, lengths], axis=1).ravel()


def ids_of(numbers: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """The reverse of `offsets_and_runs`: ids below `most`. Raises CorruptStoreError for numbers that give none."""
    if len(numbers) % 2:
        raise CorruptStoreError("a list of runs ends before the length of the last one")
    offsets, lengths = numbers[::2], numbers[1::2]
    if not len(offsets):
        return np.zeros(0, np.int64)
    if int(numbers.max()) > most or len(numbers) > 2 * most or int(numbers.sum()) > most + 1:
        raise CorruptStoreError("a list of runs leads beyond the last id")
    if int(lengths.sum()) > LONGEST:
        raise CorruptStoreError(f"a list of runs holds more than {LONGEST} ids")
    starts = np.cumsum(offsets) + np.cumsum(lengths) - lengths - 1
    within = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return np.repeat(starts, lengths) + within


def encode_numbers(numbers: NDArray[np.int64]) -> bytes:
    """Positive numbers (n,) up to LARGEST as bytes: how many bits there are, u4, then the bits, highest first."""
    values = np.asarray(numbers, np.int64)
    if len(values) and (values.min() < 1 or values.max() > LARGEST):
        raise ValueError(f"the delimiter code holds numbers from 1 to {LARGEST}")
    bits = _bits(values)
    return len(bits).to_bytes(4, "little") + np.packbits(bits).tobytes()


def decode_numbers(data: bytes) -> NDArray[np.int64]:
    """The numbers again. Raises CorruptStoreError if the bytes make no sense."""
    count = int.from_bytes(data[:4], "little")
    if len(data) != 4 + (count + 7) // 8:
        raise CorruptStoreError(f"{count} bits do not lie in {len(data)} bytes")
    numbers, sound = _numbers(np.unpackbits(np.frombuffer(data, np.uint8, offset=4), count=count))
    if not sound:
        raise CorruptStoreError("bits are no numbers with delimiters")
    return numbers


@allocating_kernel()
def _bits(values: NDArray[np.int64]) -> NDArray[np.uint8]:
    """The code of numbers (n,) as bits (k,) uint8."""
    out = np.empty(64 * len(values), np.uint8)
    at = 0
    for i in range(len(values)):
        if i:
            out[at] = out[at + 1] = 1
            at += 2
        width = 0
        while values[i] >> width:
            width += 1
        before = 0  # the last bit, 0 before the first and after an inserted 0
        for k in range(width - 1, -1, -1):
            bit = (values[i] >> k) & 1
            out[at] = bit
            at += 1
            if bit and before:
                out[at] = 0
                at += 1
                before = 0
            else:
                before = bit
        if before:
            out[at] = 1
            at += 1
    return out[:at].copy()


@allocating_kernel()
def _numbers(bits: NDArray[np.uint8]) -> tuple[NDArray[np.int64], bool]:
    """The numbers that bits (k,) are the code of, and whether they are the code of any.

    At each zero, and at the end, the row of ones before it is told apart by its length: see the top of this file.
    """
    out = np.empty(len(bits) // 2 + 1, np.int64)
    count, ones = 0, 0
    number = np.int64(0)  # 0: none has begun
    for at in range(len(bits) + 1):
        last = at == len(bits)
        if not last and bits[at]:
            ones += 1
            continue
        if number == 0 and ones == 0:
            return out[:count], last and len(bits) == 0
        begun = number > 0
        # As if a number that ends in 0 stood before the first one, and a delimiter after it.
        row = ones if begun else ones + 2
        ones = 0
        kind = row % 4
        if last:
            # k numbers that are 1, each after a delimiter: 4 k ones after an end in 0, 2 more after one in 1
            if kind % 2 or (kind == 2 and not begun):
                return out[:count], False
            if begun:
                out[count] = number * 2 + 1 if kind == 2 else number
                count += 1
            for _ in range(row // 4):
                out[count] = 1
                count += 1
            return out[:count], True
        if row <= 2 and begun:
            if row == 0:
                number *= 2
            elif row == 1:
                number = number * 4 + 2
            else:
                number = number * 4 + 3  # and the zero is no part of it
        else:
            ends_in_one = 0 < kind < 3
            if ends_in_one and not begun:
                return out[:count], False
            if begun:
                out[count] = number * 2 + 1 if ends_in_one else number
                count += 1
            begins = 1 if kind % 2 else 2
            for _ in range((row - (4 if ends_in_one else 2) - begins) // 4):
                out[count] = 1
                count += 1
            number = np.int64(2 if begins == 1 else 3)
        if number > LARGEST:
            return out[:count], False
    return out[:count], False
