"""How few runs an order of the drawables leaves in what changes between cells, and how long it takes to find.

    python tests/benchmarks/measure_order.py stores STORE ... [--seconds 60] [--json FILE]
    python tests/benchmarks/measure_order.py scaling [--columns 50000 100000] [--workers 1 2] [--json FILE]

stores: for each store the runs of the lists of what comes and goes across each face of its cells (and of the cells'
whole sets), under several orders, as a part of those of a random order; and the Held-Karp bound, which no order can
fall below, after at most so many seconds. scaling: columns like those of a large model, 7/8 as many rows, about
1,300 ones in each, in random order. Each size is a process of its own; its workers are threads, since kernels hold no
lock.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import resource
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from jobs.ordering.columns import Columns, columns_of_changes
from jobs.ordering.distances import runs
from jobs.ordering.insertion import inserted
from jobs.ordering.signatures import mixed
from jobs.ordering.tour import TourOptions, tour
from storage import open_store
from storage.base.kernels import allocating_kernel
from storage.cells import octree
from tests.benchmarks.held_karp import held_karp

METHODS = {
    "paper: nearest of a sample": TourOptions(neighbours="sampled", improve=False),
    "paper + 2-opt, Or-opt": TourOptions(neighbours="sampled"),
    "MinHash, greedy": TourOptions(improve=False),
    "MinHash, greedy + 2-opt, Or-opt": TourOptions(),
}

#: Bits a coordinate of the Hilbert curve.
BITS = 16


def hilbert(points: np.ndarray) -> np.ndarray:
    """Points (n, 3) along Hilbert's curve: (n,) int64 places.

    Based on: J. Skilling, Programming the Hilbert Curve, AIP Conference Proceedings 707, 2004.
    """
    lo, size = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-9)
    x = np.minimum((points - lo) / size * (1 << BITS), (1 << BITS) - 1).astype(np.int64).T.copy()
    for bit in range(BITS - 1, 0, -1):
        below = (1 << bit) - 1
        for axis in range(3):
            turned = (x[axis] >> bit) & 1 == 1
            swapped = np.where(turned, 0, (x[0] ^ x[axis]) & below)
            x[0] ^= np.where(turned, below, swapped)
            x[axis] ^= swapped
    for axis in (1, 2):
        x[axis] ^= x[axis - 1]
    flips = np.zeros(len(points), np.int64)
    for bit in range(BITS - 1, 0, -1):
        flips ^= np.where((x[2] >> bit) & 1 == 1, (1 << bit) - 1, 0)
    x ^= flips
    key = np.zeros(len(points), np.int64)
    for bit in range(BITS - 1, -1, -1):
        for axis in range(3):
            key = (key << 1) | ((x[axis] >> bit) & 1)
    return np.argsort(key, kind="stable")


def columns_of_cells(sets: Sequence[np.ndarray], count: int) -> Columns:
    """Columns whose rows are the cells' whole sets: what comes from a cell that sees nothing."""
    nothing = len(sets)
    pairs = np.array([(nothing, cell) for cell in range(nothing)], np.int64).reshape(-1, 2)
    return columns_of_changes([*sets, np.zeros(0, np.int64)], pairs, count)


def measure_store(path: Path, seconds: float) -> dict[str, Any]:
    """All orders of one store's drawables, for its changes and its cells."""
    store = open_store(path)
    computed = store.cells["computed"]
    count = len(store.drawables)
    sets = [store.vlod(cell) if computed[cell] else np.zeros(0, np.int64) for cell in range(len(computed))]
    pairs, _ = octree.neighbours(store.cells["key"])
    pairs = pairs[computed[pairs].all(axis=1)]
    centres = (store.drawables["lo"] + store.drawables["hi"]) / 2
    result: dict[str, Any] = {"cells": int(computed.sum()), "faces": len(pairs), "drawables": count}
    for what, columns in (
        ("changes", columns_of_changes(sets, pairs, count)),
        ("cells", columns_of_cells(sets, count)),
    ):
        chance = [runs(columns, np.random.default_rng(seed).permutation(count)) for seed in range(5)]
        random = float(np.mean(chance))
        seen = columns.sizes > 0
        orders = {
            "Hilbert": hilbert(centres),
            "node order": np.arange(count),
            "node order, what changes first": np.argsort(~seen, kind="stable"),
        }
        took = {}
        for name, options in METHODS.items():
            tour(columns, options)  # kernels are compiled, files are in memory
            began = time.perf_counter()
            orders[name] = tour(columns, options)
            took[name] = time.perf_counter() - began
        former = np.random.default_rng(0).random(count) < 0.9
        kept = orders["MinHash, greedy + 2-opt, Or-opt"]
        orders["a tenth inserted into that of the others"] = inserted(columns, kept[former[kept]])
        found = {name: runs(columns, order) for name, order in orders.items()}
        bound = held_karp(columns, min(found.values()), seconds)
        rows = {name: {"runs": n, "fewer": 1 - n / random, "seconds": took.get(name)} for name, n in found.items()}
        result[what] = {
            "random": random,
            "columns": int(seen.sum()),
            "orders": rows,
            "bound": {**vars(bound), "fewer": 1 - bound.runs / random},
            "above_bound": found["MinHash, greedy + 2-opt, Or-opt"] / bound.runs - 1,
        }
        size = f"{int(seen.sum()):,} columns, {len(columns.rows):,} ones"
        print(f"\n{path.stem}, {what}: {size}; random: {random:,.0f} runs")
        for name, row in rows.items():
            seconds_told = "" if row["seconds"] is None else f" | {row['seconds']:.3f} s"
            print(f"{name} | {row['runs']:,} | {100 * row['fewer']:.1f} % fewer{seconds_told}")
        state = "converged" if bound.converged else "not converged"
        print(
            f"Held-Karp, {state} after {bound.steps} steps, {bound.seconds:.0f} s | {bound.runs:,} | "
            f"{100 * (1 - bound.runs / random):.1f} % fewer; "
            f"the best tour is {100 * result[what]['above_bound']:.1f} % above",
            flush=True,
        )
    return result


@allocating_kernel()
def _boxes(numbers: np.ndarray, side: int, at: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Nine tenths of the cells of a box of about 1,440 in a grid, a column; with no rows, only where they begin."""
    top = 0
    for column in range(len(numbers)):
        at[column] = top
        draw = numbers[column]
        a = min(side, 6 + np.int64(draw % np.uint64(13)))
        b = min(side, 6 + np.int64((draw >> np.uint64(8)) % np.uint64(13)))
        c = min(side, 1440 // (a * b))
        x = np.int64((draw >> np.uint64(16)) & np.uint64(0xFFFF)) * (side - a + 1) >> 16
        y = np.int64((draw >> np.uint64(32)) & np.uint64(0xFFFF)) * (side - b + 1) >> 16
        z = np.int64(draw >> np.uint64(48)) * (side - c + 1) >> 16
        noise = draw | np.uint64(1)
        for i in range(x, x + a):
            for j in range(y, y + b):
                for k in range(z, z + c):
                    noise ^= noise << np.uint64(13)
                    noise ^= noise >> np.uint64(7)
                    noise ^= noise << np.uint64(17)
                    if noise % np.uint64(10) != 0:
                        if len(rows) > 0:
                            rows[top] = (i * side + j) * side + k
                        top += 1
    at[len(numbers)] = top
    return at


def synthetic(count: int) -> Columns:
    """Columns (count,) with about 1,300 of 7/8 `count` rows each."""
    numbers = mixed(np.arange(count, dtype=np.uint64))
    side = round((7 / 8 * count) ** (1 / 3))
    at = _boxes(numbers, side, np.zeros(count + 1, np.int64), np.zeros(0, np.int32))
    rows = np.empty(at[-1], np.int32)
    _boxes(numbers, side, at, rows)
    return Columns(np.append(at, at[-1]), rows, side**3)


def measure_synthetic(count: int, workers: Sequence[int]) -> dict[str, Any]:
    """One size: seconds for each number of workers, which must agree."""
    tour(synthetic(2000))
    began = time.perf_counter()
    columns = synthetic(count)
    result: dict[str, Any] = {"columns": count, "ones": len(columns.rows), "made": time.perf_counter() - began}
    found = []
    for number in workers:
        with ThreadPoolExecutor(number) as pool:
            began = time.perf_counter()
            found.append(tour(columns, blockwise=pool.map))
            result[f"seconds, {number} workers"] = time.perf_counter() - began
    result["agree"] = all(np.array_equal(order, found[0]) for order in found)
    result["runs"], result["random"] = runs(columns, found[0]), runs(columns, np.arange(count))
    result["peak_gib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return result


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, dest="command")
    stores = commands.add_parser("stores")
    stores.add_argument("stores", nargs="+", type=Path, metavar="STORE")
    stores.add_argument("--seconds", type=float, default=60.0)
    stores.add_argument("--json", type=Path)
    scaling = commands.add_parser("scaling")
    scaling.add_argument("--columns", nargs="+", type=int, default=[50_000, 100_000, 200_000, 400_000])
    scaling.add_argument("--workers", nargs="+", type=int, default=[1, 2])
    scaling.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    results: dict[str, Any] = {}
    if arguments.command == "stores":
        for path in arguments.stores:
            results[path.stem] = measure_store(path, arguments.seconds)
    else:
        spawn = multiprocessing.get_context("spawn")
        for count in arguments.columns:
            with spawn.Pool(1) as pool:
                results[str(count)] = row = pool.apply(measure_synthetic, (count, arguments.workers))
            print(json.dumps(row), flush=True)
        measured = list(results.values())
        name = f"seconds, {arguments.workers[0]} workers"
        for one, other in itertools.pairwise(measured):
            exponent = np.log(other[name] / one[name]) / np.log(other["columns"] / one["columns"])
            print(f"{one['columns']:,} to {other['columns']:,} columns: exponent {exponent:.2f}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
