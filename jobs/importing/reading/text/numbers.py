"""Numbers in text, many at once."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np


def integers_of(text: bytes) -> np.ndarray | None:
    """All whole numbers of a text as int64, None if anything else is in it."""
    return _parsed(text, np.int64)


def floats_of(text: bytes | str) -> np.ndarray:
    """All numbers of a short text as float64; words that are no numbers become NaN."""
    data = text.encode() if isinstance(text, str) else text
    values = _parsed(data, np.float64)
    return np.array([_number(word) for word in data.split()], np.float64) if values is None else values


def rows_of(lines: Sequence[bytes], columns: int) -> np.ndarray:
    """The first `columns` numbers of each line, float64 (n, columns); NaN where there are fewer or they are no
    numbers.
    """
    if not lines:
        return np.empty((0, columns))
    table = table_of(lines)
    if table is not None and table.shape[1] >= columns:
        return np.ascontiguousarray(table[:, :columns])
    rows = np.full((len(lines), columns), np.nan)
    for row, line in zip(rows, lines, strict=True):
        words = line.split(b"#")[0].split()[:columns]
        row[: len(words)] = [_number(word) for word in words]
    return rows


def table_of(lines: Sequence[bytes]) -> np.ndarray | None:
    """All numbers of lines that hold equally many, float64 (n, width); None if they do not or hold anything else."""
    width = len(lines[0].split())
    if any(len(line.split()) != width for line in lines):
        return None
    values = _parsed(b" ".join(lines), np.float64)
    return None if values is None or len(values) != width * len(lines) else values.reshape(len(lines), width)


def _parsed(text: bytes, dtype: type) -> np.ndarray | None:
    if not text.strip():
        return np.empty(0, dtype)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            return np.fromstring(text, dtype, sep=" ")
    except (DeprecationWarning, ValueError, OverflowError):
        return None


def _number(word: bytes) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")
