"""Arrays as files."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np


def save_array(path: Path, array: np.ndarray) -> None:
    """Like numpy.save, which says of a full disk only that fewer items were written: here the error is the system's."""
    buffer = io.BytesIO()
    np.save(buffer, array)
    path.write_bytes(buffer.getbuffer())


def mapped_array(path: Path) -> np.ndarray:
    """An array that was saved, read from the file only where it is looked at. Read-only.

    A plain view: each index into a numpy.memmap would make another one, many times as slow.
    """
    return np.load(path, mmap_mode="r").view(np.ndarray)
