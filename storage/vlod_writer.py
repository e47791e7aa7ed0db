"""Writing view cells: what can be seen from each, the changes between neighbours, and the table of all cells.

The order of a build, after `storage.geometry_writer`:

    write_cell_shard   one per subtree of the octree of view cells
    cells_section      joins the cells of all shards and names them in the manifest

Whatever is written is invisible to readers before `storage.shards.manifest.commit`. The same input gives the same bytes
and the same names, whoever writes them in whatever order.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from storage.cells.codecs import DEFAULT, codec_named
from storage.cells.deltas import Ids, difference
from storage.cells.octree import LeafSet, Octree
from storage.cells.spanning_forest import spanning_forest
from storage.model.tables import BOUNDARY, CELL, CELL_LINK
from storage.shards.cache import ByteCache
from storage.shards.columns import pack_table, unpack_table
from storage.shards.files import Files
from storage.shards.sections import CellCounts, CellShardRecord, CellsSection
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import Kind, write_shard

#: Bytes that `cells_section` keeps of shards' ends while it reads them.
ENDS = 1 << 20


def write_cell_shard(
    root: Path,
    cells: np.ndarray,
    sets: Sequence[Ids],
    boundaries: Sequence[tuple[int, int, Ids, Ids]],
    *,
    first: int,
    codec: str = DEFAULT,
) -> CellShardRecord:
    """Writes the vLODs of a run of cells into one shard.

    cells: CELL (n,), the store's cells number `first` to `first + n - 1`; sets: their vLODs, strictly increasing ids
    each, empty where nothing was computed; boundaries: (a, b, vLOD of a, vLOD of b) for all computed cells a < b of
    the store that share a face, where a lies in this shard; in any order; codec: the name of the codec that sets and
    changes are written in. A cell's vLOD is its key set or a chain of at most LONGEST_CHAIN deltas from one. Raises
    ValueError for what does not fit together.
    """
    rows = np.asarray(cells, CELL)
    if len(rows) != len(sets):
        raise ValueError(f"{len(rows)} cells but {len(sets)} sets")
    for number, (cell, ids) in enumerate(zip(rows, sets, strict=True)):
        if len(ids) != cell["drawables"] or (np.diff(np.asarray(ids, np.int64)) <= 0).any():
            raise ValueError(
                f"cell {first + number}: its set must hold {cell['drawables']} increasing ids, and holds {len(ids)}"
            )
    for a, b, _, _ in boundaries:
        if not first <= a < min(b, first + len(rows)):
            raise ValueError(f"the boundary of cells {a} and {b} does not belong into this shard")
    encoder = codec_named(codec)
    faces = sorted(boundaries, key=lambda face: (face[0], face[1]))
    links = np.zeros(len(rows), CELL_LINK)
    table = np.zeros(len(faces), BOUNDARY)
    computed = rows["computed"]
    inside = [(a - first, b - first) for a, b, _, _ in faces if b < first + len(rows)]
    inside = [(a, b) for a, b in inside if computed[a] and computed[b]]
    parents = spanning_forest(len(rows), np.array(inside, np.int64).reshape(-1, 2))
    links["parent"] = parents

    payloads: list[tuple[Kind, bytes]] = []
    lead = 3  # frames before these: the cells, the links, the boundaries
    for cell in np.flatnonzero((parents < 0) & computed).tolist():
        links[cell]["frame"] = lead + len(payloads)
        payloads.append((Kind.KEY_SET, encoder.encode([np.asarray(sets[cell], np.uint32)])))

    block: list[Ids] = []
    held = 0
    for number, (a, b, set_a, set_b) in enumerate(faces):
        delta = difference(np.asarray(set_a, np.uint32), np.asarray(set_b, np.uint32))
        table[number] = (a - first, b, lead + len(payloads), len(block) // 2)
        block.extend(delta)
        held += len(delta.added) + len(delta.dropped)
        if held >= encoder.block_ids or number == len(faces) - 1:
            payloads.append((Kind.DELTAS, encoder.encode(block)))
            block, held = [], 0
        below, above = a - first, b - first
        if above < len(rows):
            child = below if parents[below] == above else above if parents[above] == below else -1
            if child >= 0:
                links[child]["frame"], links[child]["slot"] = table[number]["frame"], table[number]["slot"]
    head = [(Kind.TABLE, pack_table(rows)), (Kind.TABLE, pack_table(links)), (Kind.TABLE, pack_table(table))]
    record = write_shard(root, [*head, *payloads])
    return CellShardRecord(record.name, record.bytes, len(rows), codec)


def cells_section(root: Path, octree: Octree, shards: Sequence[CellShardRecord]) -> CellsSection:
    """Writes the table of all cells and returns what the manifest says about cells.

    octree: where the keys of the cells lie; shards: the cell shards in the order of their cells' numbers.
    Raises ValueError if cells overlap, CorruptStoreError if a shard is missing or not as it was written.
    """
    files = ShardFiles(Files(root), ByteCache(ENDS))
    tables = files.of_each(shards, lambda shard: shard.decoded(0, Kind.TABLE, lambda data: unpack_table(data, CELL)))
    for shard, rows in zip(shards, tables, strict=True):
        if len(rows) != shard.cells:
            raise files.reader(shard).corrupt(f"it has {len(rows)} cells, not {shard.cells}")
    cells = np.concatenate([np.zeros(0, CELL), *tables])
    LeafSet(cells["key"])
    table = write_shard(root, [(Kind.TABLE, pack_table(cells))])
    counts = CellCounts(len(cells), int(cells["computed"].sum()))
    return CellsSection(octree.lo, octree.size, table, tuple(shards), counts)
