"""Bytes and time of what is seen from cells, in every codec over the very same sets, and as changes of every face.

    python -m tests.benchmarks.measure_codecs FOLDER [--prior OUT]

FOLDER holds hospital.store, city.store, offices.store and plant.store, made beforehand; the hospital lies in the folder
that VLOD_MODELS names:

    vlod demo-scene city city.glb --triangles 300000
    vlod demo-scene offices offices.glb --triangles 300000
    vlod demo-scene plant plant.glb --triangles 1100000 --seed 1
    vlod build MODEL NAME.store --quality draft --executor serial --memory 6GiB, and of
        mid_hospital/hospital_three_floors.glb
                  --region -8 6.9 -20 8 8.2 0 --cell-size 0.85 --triangles-per-cell 500
        city      --region 30 1.2 -70 60 2 -45 --cell-size 1.3
        offices   --region -18 1.2 -12 10 2 8 --cell-size 1.3
        plant     --region -2 1.2 -29 30 2.2 -9 --cell-size 1.3 --triangles-per-cell 40000

`contexts` is measured with a prior that was trained on the other stores; --prior writes the one of all of them. `faces`
is how stores kept cells before: what comes and goes across every face between two cells, in blocks of 4,096 ids, gaps
compressed with zstd (and a few whole sets, not counted here). `masks` has a bit for each drawable and each such list.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from storage import Store, open_store
from storage.cells.codecs.context_mixing import CONTEXTS, END, FINAL, SIZES, WEIGHTS
from storage.cells.codecs.contexts import EVEN, Coder, Model
from storage.cells.codecs.delimiter import CODEC as DELIMITER
from storage.cells.codecs.gap_varint import CODEC as GAPS
from storage.known_cells import KnownCells

STORES = ("hospital", "city", "offices", "plant")

#: Ids of a block of changes.
BLOCK = 1 << 12

#: A prior trusts an entry no more than if it had been met so often.
TRUST = 12


def untrained() -> Model:
    """A model that knows nothing."""
    x = (np.arange(4096) + 0.5) / 4096
    stretch = np.rint(np.log(x / (1 - x)) * 256).astype(np.int32)
    y = np.arange(-END, END + 1) / 256
    squash = np.clip(np.rint(65536 / (1 + np.exp(-y))), 8, 65528).astype(np.int32)
    weights = np.full((WEIGHTS, CONTEXTS + 1), int(65536 * 0.35), np.int32)
    weights[:, CONTEXTS] = 0
    row = np.clip(65536 / (1 + np.exp(-(np.arange(FINAL[1]) - 16) * END / 16 / 256)), 16, 65520).astype(np.int32)
    entries = sum(SIZES)
    return Model(
        np.full(entries, EVEN, np.int32),
        np.zeros(entries, np.uint8),
        weights,
        np.tile(row, (FINAL[0], 1)),
        stretch,
        squash,
    )


class Sets:
    """The sets of a store, in its groups."""

    def __init__(self, store: Store) -> None:
        known = KnownCells(store.nodes, store.drawables, store.manifest.pixel_angle)
        starts = np.cumsum([0, *store.groups["cells"].tolist()])
        self.rows = [store.cells[a:b] for a, b in itertools.pairwise(starts.tolist())]
        self.groups = [known.group(rows) for rows in self.rows]
        self.sets = [
            [store.vlod(cell) for cell in range(a, b) if store.cells["computed"][cell]]
            for a, b in itertools.pairwise(starts.tolist())
        ]
        self.count = sum(map(len, self.sets))
        self.known = known


def trained(stores: list[Sets]) -> Model:
    """What is learnt of some stores, one after the other."""
    model = untrained()
    for store in stores:
        for group, sets in zip(store.groups, store.sets, strict=True):
            seen = np.concatenate(list(map(np.isin, group.cuts, sets)))
            data = np.zeros(4 * len(sets) * len(group.part.end) + 8, np.uint8)
            _, _, model = Coder(model).run(group, seen, data, decoding=False)
    return replace(model, known=np.minimum(model.known, TRUST))


def faces_bytes(store: Store) -> tuple[int, int]:
    """What changes across every face take in blocks, and as masks."""
    size, faces, block, held = 0, 0, [], 0
    for cell in np.flatnonzero(store.cells["computed"]).tolist():
        for other in store.neighbours(cell).tolist():
            if other > cell:
                change = store.delta(cell, other)
                block.extend(change)
                held += len(change.added) + len(change.dropped)
                faces += 1
                if held >= BLOCK:
                    size += len(GAPS.lists.encode_lists(block))
                    block, held = [], 0
    return size + (len(GAPS.lists.encode_lists(block)) if block else 0), faces * 2 * ((len(store.drawables) + 7) // 8)


def main() -> None:
    """Prints a line of JSON for each store."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--prior", type=Path)
    given = parser.parse_args()
    stores = {name: open_store(given.folder / f"{name}.store") for name in STORES}
    sets = {name: Sets(store) for name, store in stores.items()}
    for name, own in sets.items():
        coder = Coder(trained([other for key, other in sets.items() if key != name]))
        gaps = paper = size = 0
        encoding, decoding, choosing = 0.0, [], []
        for rows, group, given_sets in zip(own.rows, own.groups, own.sets, strict=True):
            began = time.thread_time()
            data = coder.encode(given_sets, group)
            encoding += time.thread_time() - began
            began = time.thread_time()
            fresh = own.known.group(rows)
            choosing.append(time.thread_time() - began)
            began = time.thread_time()
            back = coder.decode(data, fresh)
            decoding.append(time.thread_time() - began)
            assert all(np.array_equal(a, b) for a, b in zip(back, given_sets, strict=True)), name
            size += len(data)
            gaps += len(GAPS.encode(given_sets, group))
            paper += len(DELIMITER.encode(given_sets, group))
        faces, masks = faces_bytes(stores[name])
        section = stores[name].manifest.cells
        assert section is not None
        print(json.dumps({
            "store": name, "cells": own.count, "groups": len(own.groups), "faces": faces, "masks": masks,
            "gap-varint-zstd": gaps, "delimiter": paper, "contexts": size, "bytes_a_cell": round(size / own.count, 2),
            "times_smaller_than_faces": round(faces / size, 2), "times_smaller_than_masks": round(masks / size, 1),
            "all_cell_bytes": section.table.bytes + sum(shard.bytes for shard in section.shards),
            "encode_ms_a_group": round(1e3 * encoding / len(own.groups), 2),
            "cold_ms_a_group_p95": round(1e3 * float(np.quantile(np.add(decoding, choosing), 0.95)), 2),
        }), flush=True)  # fmt: skip
    if given.prior:
        given.prior.write_bytes(trained(list(sets.values())).to_bytes())


if __name__ == "__main__":
    main()
