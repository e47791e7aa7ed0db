"""How the time of a shard's spanning forest grows with its cells, beside the same forest made by plain sweeps.

    python tests/benchmarks/measure_forest.py [--cells 4000 30000 100000] [--plain 15000] [--json OUT.json]

The cells are a cubic block and a flat layer of the octree's, as many as asked for or the next number that fills them.
Plain sweeps (`tests.storage.cells.naive_forest`) are timed up to --plain cells, and must give the same forest.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from storage.cells.octree import encode, neighbours
from storage.cells.spanning_forest import LONGEST_CHAIN, spanning_forest
from tests.storage.cells.naive_forest import naive_forest

DEPTH = 12


def cells_of(shape: str, count: int) -> np.ndarray:
    """Keys (n,) of at least `count` cells."""
    edge = int(np.ceil(count ** (1 / 3 if shape == "block" else 1 / 2) - 1e-9))
    grid = np.indices((edge, edge, edge if shape == "block" else 1)).reshape(3, -1).T
    return np.sort(encode(grid, DEPTH))


def timed(make: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """A forest and the seconds that it took."""
    began = time.perf_counter()
    forest = make()
    return forest, time.perf_counter() - began


def measure(shape: str, count: int, plain: int) -> dict[str, object]:
    """The times of both for one set of cells; those of plain sweeps are None above `plain` cells."""
    keys = cells_of(shape, count)
    pairs, _ = neighbours(keys)
    forest, seconds = timed(lambda: spanning_forest(len(keys), pairs))
    plain_seconds = None
    if len(keys) <= plain:
        other, plain_seconds = timed(lambda: naive_forest(len(keys), pairs, LONGEST_CHAIN))
        assert np.array_equal(forest, other), f"{shape} of {len(keys)} cells: the forests differ"
    trees = int((forest < 0).sum())
    return {"shape": shape, "cells": len(keys), "trees": trees, "seconds": seconds, "plain_seconds": plain_seconds}


def main() -> None:
    """Prints a table, and writes it as JSON where asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, nargs="+", default=[4000, 30_000, 100_000])
    parser.add_argument("--plain", type=int, default=15_000)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    spanning_forest(2, np.array([[0, 1]]))  # compiled before anything is timed
    rows = [measure(shape, count, arguments.plain) for shape in ("block", "layer") for count in arguments.cells]
    for row in rows:
        plain = "" if row["plain_seconds"] is None else f", plain sweeps {row['plain_seconds']:.3f} s"
        print(f"{row['shape']} of {row['cells']:,} cells: {row['trees']:,} trees, {row['seconds']:.4f} s{plain}")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
