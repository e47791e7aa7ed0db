"""What the order of meshes in packs is worth: how often something is read on a walk, and how much of it is drawn.

    python tests/benchmarks/measure_packs.py STORE ... [--walks 10] [--steps 400] [--json FILE]

Each store must have its work directory still. On walks from cell to neighbouring cell, each towards one goal after
another, the packs that a cell's vLOD needs and that were not read before are read; neighbours in a shard at once. Told
are reads and packs for each crossing, the first cell left out, and the bytes of the packs read over the bytes of the
meshes drawn, uncompressed; for packs as the build's tasks wrote them, in space order; as they stand in the store, along
the tour; and for packs of the same size in three random orders.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from jobs.ordering.packing import pack_starts
from jobs.ordering.signatures import mixed
from jobs.running.workplace import Workplace
from jobs.stages import tables
from jobs.stages.support.written_geometry import geometry_section_of, open_drafted
from storage import open_store
from storage.cells.octree import neighbours
from storage.geometry_writer import mesh_bytes
from storage.store import Store


def walks(store: Store, count: int, steps: int, seed: int = 1) -> list[list[int]]:
    """Sequences of computed cells, of which each shares a face with the next."""
    random = np.random.default_rng(seed)
    computed = store.cells["computed"]
    pairs, _ = neighbours(store.cells["key"])
    beside: dict[int, list[int]] = {}
    for a, b in pairs[computed[pairs].all(axis=1)].tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    centre = (store.cells["lo"] + store.cells["hi"]) / 2
    places = sorted(beside)
    found = []
    for _ in range(count):
        walk = [int(random.choice(places))]
        goal = int(random.choice(places))
        while len(walk) < steps:
            here = walk[-1]
            if here == goal:
                goal = int(random.choice(places))
            ways = beside[here]
            left = np.linalg.norm(centre[ways] - centre[goal], axis=1)
            astray = 0.5 * random.random(len(ways)) * np.linalg.norm(centre[ways] - centre[here], axis=1)
            walk.append(ways[int(np.argmin(left + astray))])
        found.append(walk)
    return found


def measure(
    store: Store, on: list[list[int]], pack: np.ndarray, place: np.ndarray, sizes: np.ndarray
) -> dict[str, float]:
    """Reads on walks.

    pack: (meshes,) each mesh's pack; place: (packs,) where a pack lies: neighbours are 1 apart; sizes: (meshes,) bytes.
    """
    mesh = store.drawables["geometry"].astype(np.int64)
    pack_sizes = np.bincount(pack, sizes, len(place))
    reads = packs = crossings = 0
    fetched = drawn_bytes = 0.0
    for walk in on:
        there = np.zeros(len(place), np.bool_)
        drawn = np.zeros(len(pack), np.bool_)
        for step, cell in enumerate(walk):
            meshes = mesh[store.vlod(cell)]
            drawn[meshes] = True
            needed = np.unique(pack[meshes])
            new = needed[~there[needed]]
            there[new] = True
            if step:
                crossings += 1
                packs += len(new)
                reads += int(np.count_nonzero(np.diff(np.sort(place[new])) != 1)) + 1 if len(new) else 0
        fetched += pack_sizes[there].sum()
        drawn_bytes += sizes[drawn].sum()
    return {"reads": reads / crossings, "packs": packs / crossings, "fetched_over_drawn": fetched / drawn_bytes}


def measure_store(path: Path, count: int, steps: int) -> dict[str, Any]:
    """All orders of one store's meshes."""
    store = open_store(path)
    place = Workplace(path / "work", path)
    keys = [folder.name for folder in (place.work / tables.STAGE.name).iterdir()]
    drafted = open_drafted(place, tables.STAGE.name, keys[0])
    section = geometry_section_of(place, tables.STAGE.name, keys[0])
    sizes = mesh_bytes(store.geometry["vertices"], store.geometry["triangles"])
    on = walks(store, count, steps)
    result: dict[str, Any] = {"meshes": len(sizes)}
    for name, geometry, shards in (
        ("space", drafted, section.shards),
        ("tour", store, store.manifest.geometry.shards),
    ):
        rows = geometry.packs
        where = rows["frame"].astype(np.int64) + (rows["shard"].astype(np.int64) << 32)
        result[name] = measure(store, on, geometry.geometry["pack"].astype(np.int64), where, sizes)
        result[name] |= {"all_packs": len(rows), "bytes": sum(shard.bytes for shard in shards)}
    for seed in range(3):
        sequence = np.random.default_rng(seed).permutation(len(sizes))
        starts = pack_starts(sizes[sequence], mixed(sequence.astype(np.uint64)))
        pack = np.empty(len(sizes), np.int64)
        pack[sequence] = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        result[f"random {seed}"] = measure(store, on, pack, np.arange(len(starts) - 1), sizes)
    return result


def main() -> None:
    """Measure and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stores", nargs="+", type=Path, metavar="STORE")
    parser.add_argument("--walks", type=int, default=10)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    results = {}
    for path in arguments.stores:
        results[path.stem] = found = measure_store(path, arguments.walks, arguments.steps)
        print(f"\n{path.stem}: {found['meshes']:,} meshes")
        for name, row in found.items():
            if isinstance(row, dict):
                size = f" | {row['all_packs']:,} packs, {row['bytes']:,} bytes" if "bytes" in row else ""
                print(
                    f"{name} | {row['reads']:.3f} reads, {row['packs']:.3f} packs a crossing | "
                    f"fetched over drawn {row['fetched_over_drawn']:.2f}{size}",
                    flush=True,
                )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
