"""Bytes and time of the sets of whole stores in the new code and in the lists that stores hold, side by side.

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

Each store is coded with a prior that was trained on the others. --prior writes the one of all of them.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from storage import Store, open_store
from storage.cells.codecs.context_mixing import CONTEXTS, END, FINAL, NEAREST, SIZES, WEIGHTS, decisions, nearest_before
from storage.cells.codecs.contexts import EVEN, Coder, Model
from storage.cells.codecs.delimiter import CODEC as DELIMITER
from storage.cells.codecs.gap_varint import CODEC as GAPS
from storage.cells.codecs.group import Group, Tree
from storage.cells.deltas import difference
from storage.cells.octree import MAX_DEPTH, decode, morton_order
from storage.shards.shards import Kind

STORES = ("hospital", "city", "offices", "plant")

#: A group is closed before its cells cost more than this, in decisions; measured: 95 ns each, and 35 ns for each node
#: of a cut that must be chosen first.
MOST = 50_000
PER_CUT_NODE = 0.375

#: What a group takes beside its bytes, and a shard: an entry of the index; magic numbers and the index's checksum.
PER_GROUP = 28
PER_SHARD = 40

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
    """The sets of a store, in groups of Morton order."""

    def __init__(self, store: Store) -> None:
        tree = Tree(store.nodes, store.drawables)
        rows = store.cells
        order = morton_order(rows["key"])
        order = order[rows["computed"][order]]
        corner, depth = decode(rows["key"])
        centres = (2 * corner + 1) << (MAX_DEPTH - depth)[:, None]
        self.count = len(order)
        self.groups: list[Group] = []
        self.sets: list[list[np.ndarray]] = []
        self.members: list[list[int]] = []
        members: list[int] = []
        held = 0
        cuts, sets = {}, {}
        for cell in [*order.tolist(), -1]:
            more = 0
            if cell >= 0:
                cuts[cell], sets[cell] = store.cut(cell), store.vlod(cell)
                more = decisions(tree.end, tree.node_of[cuts[cell]], np.isin(cuts[cell], sets[cell]))
                more += int(PER_CUT_NODE * len(cuts[cell]))
            if members and (cell < 0 or held + more > MOST):
                boxes = np.stack([rows["lo"][members], rows["hi"][members]], axis=1)
                self.groups.append(Group(tree, centres[members], boxes, tuple(cuts[m] for m in members)))
                self.sets.append([sets[m] for m in members])
                self.members.append(members)
                members, held = [], 0
            members.append(cell)
            held += more


def trained(stores: list[Sets]) -> Model:
    """What is learnt of some stores, one after the other."""
    model = untrained()
    for store in stores:
        for group, sets in zip(store.groups, store.sets, strict=True):
            seen = np.concatenate(list(map(np.isin, group.cuts, sets)))
            data = np.zeros(4 * len(sets) * len(group.tree.end) + 8, np.uint8)
            _, _, model = Coder(model).run(group, seen, data, decoding=False)
    return replace(model, known=np.minimum(model.known, TRUST))


def changes(group: Group, sets: list[np.ndarray]) -> list[np.ndarray]:
    """The first cell's set, then what each further cell adds to and drops from the nearest cell before it."""
    nearest = np.empty((len(sets), NEAREST), np.int64)
    nearest_before(group.centres, nearest)
    lists = [sets[0].astype(np.uint32)]
    for own, before in zip(sets[1:], nearest[1:, 0].tolist(), strict=True):
        lists.extend(difference(sets[before].astype(np.uint32), own.astype(np.uint32)))
    return lists


def lists_bytes(store: Store) -> int:
    """What the store's own frames of sets and changes take."""
    kinds = store.bytes_by_kind()
    return kinds[Kind.KEY_SET] + kinds[Kind.DELTAS]


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
        gaps = paper = 0
        size, encoding, decoding, choosing = 0, 0.0, [], []
        for number, (group, given_sets) in enumerate(zip(own.groups, own.sets, strict=True)):
            began = time.thread_time()
            data = coder.encode(given_sets, group)
            encoding += time.thread_time() - began
            began = time.thread_time()
            back = coder.decode(data, group)
            decoding.append(time.thread_time() - began)
            began = time.thread_time()
            for cell in own.members[number]:
                stores[name].cut(cell)
            choosing.append(time.thread_time() - began)
            assert all(np.array_equal(a, b) for a, b in zip(back, given_sets, strict=True)), name
            size += len(data)
            lists = changes(group, given_sets)
            gaps += len(GAPS.encode(lists))
            paper += len(DELIMITER.encode(lists))
        today = lists_bytes(stores[name])
        section = stores[name].manifest.cells
        assert section is not None
        all_today = section.table.bytes + sum(shard.bytes for shard in section.shards)
        projected = section.table.bytes + size + PER_GROUP * len(own.groups) + PER_SHARD * len(section.shards)
        print(json.dumps({
            "store": name, "cells": own.count, "groups": len(own.groups), "lists": today, "contexts": size,
            "gap-varint-zstd, each cell once": gaps, "delimiter, each cell once": paper,
            "times_smaller": round(today / size, 2), "bytes_a_cell": round(size / own.count, 2),
            "all_cell_bytes": all_today, "all_cell_bytes_projected": projected,
            "encode_ms_a_group": round(1e3 * encoding / len(own.groups), 2),
            "decode_ms_a_group_p95": round(1e3 * float(np.quantile(decoding, 0.95)), 2),
            "cuts_ms_a_group_p95": round(1e3 * float(np.quantile(choosing, 0.95)), 2),
        }), flush=True)  # fmt: skip
    if given.prior:
        given.prior.write_bytes(trained(list(sets.values())).to_bytes())


if __name__ == "__main__":
    main()
