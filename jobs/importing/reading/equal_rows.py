"""Rows of an array that are equal, bit by bit."""

from __future__ import annotations

import numpy as np


def first_equal(rows: np.ndarray) -> np.ndarray:
    """For each row of a C-contiguous (n, k) array of 8-byte items the number of the first row with the same bits."""
    words = rows.view(np.uint64)
    with np.errstate(over="ignore"):
        mixed = np.zeros(len(words), np.uint64)
        for column in range(words.shape[1]):
            mixed = (mixed ^ words[:, column]) * np.uint64(0x9E3779B97F4A7C15)
            mixed ^= mixed >> np.uint64(29)
    order = np.argsort(mixed, kind="stable")
    equal = np.ones(max(len(rows) - 1, 0), bool)
    for column in range(words.shape[1]):
        ordered = words[order, column]
        equal &= ordered[1:] == ordered[:-1]
    if np.any((mixed[order][1:] == mixed[order][:-1]) & ~equal):  # two different rows share a hash: sort in full
        order = np.lexsort(words.T[::-1])
        equal = (words[order[1:]] == words[order[:-1]]).all(axis=1)
    start = np.concatenate([[0], np.where(equal, 0, np.arange(1, len(rows)))])[: len(rows)]
    first = np.empty(len(rows), np.int64)
    first[order] = order[np.maximum.accumulate(start)]
    return first
