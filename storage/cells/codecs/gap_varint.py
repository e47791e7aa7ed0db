"""Gaps between ids as variable-length integers, compressed with zstd.

A block is the lists' lengths, then all lists' ids; each list's first id stands for itself, each further one for its
gap to the one before, less one. Numbers are LEB128: seven bits a byte, low ones first.
Based on: Witten, Moffat, Bell, Managing Gigabytes, 2nd edition, 1999, section 3.3 (gaps of inverted lists).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import zstandard
from numpy.typing import NDArray

from storage.base.errors import CorruptStoreError
from storage.cells.codecs.changes import Changes
from storage.cells.codecs.varint import decode_varints, encode_varints

#: zstd level: blocks are written once and are a few kilobytes long.
LEVEL = 19

#: No block holds more ids and lists than this; a larger number in a block's head means damage.
LARGEST_BLOCK = 1 << 30


class GapVarint:
    """Gap coding, LEB128, zstd."""

    def encode_lists(self, lists: Sequence[NDArray[np.uint32]]) -> bytes:
        """Bytes of lists of strictly increasing uint32 ids: counts of lists and numbers (u4 each), then the numbers."""
        lengths = np.array([len(ids) for ids in lists], np.uint32)
        ids = np.concatenate([np.asarray(ids, np.uint32) for ids in lists]) if len(lists) else np.zeros(0, np.uint32)
        gaps = ids.copy()
        gaps[1:] = ids[1:] - ids[:-1] - 1
        starts = (np.cumsum(lengths, dtype=np.int64) - lengths)[lengths > 0]
        gaps[starts] = ids[starts]
        numbers = np.concatenate([lengths, gaps])
        head = np.array([len(lengths), len(numbers)], "<u4").tobytes()
        return head + zstandard.ZstdCompressor(LEVEL).compress(encode_varints(numbers).tobytes())

    def decode_lists(self, data: bytes) -> list[NDArray[np.uint32]]:
        """The lists again. Raises CorruptStoreError if the bytes make no sense."""
        try:
            count, total = (int(value) for value in np.frombuffer(data[:8], "<u4"))
            if count > total or total > LARGEST_BLOCK:
                raise ValueError(f"impossible counts {count} and {total}")
            content = zstandard.ZstdDecompressor().decompress(data[8:])
            numbers = decode_varints(np.frombuffer(content, np.uint8), total)
        except (ValueError, zstandard.ZstdError) as error:
            raise CorruptStoreError(f"a block of ids cannot be decoded: {error}") from error
        lengths, gaps = numbers[:count].astype(np.int64), numbers[count:]
        if int(lengths.sum()) != len(gaps):
            raise CorruptStoreError(f"a block of ids holds {len(gaps)} numbers, not {int(lengths.sum())}")
        ends = np.cumsum(lengths)
        steps = gaps.astype(np.int64) + 1
        sums = np.cumsum(steps)
        before = np.concatenate([np.zeros(1, np.int64), sums])[ends - lengths]
        ids = (sums - np.repeat(before, lengths) - 1).astype(np.uint32)
        return np.split(ids, ends[:-1]) if count else []


CODEC = Changes(GapVarint())
