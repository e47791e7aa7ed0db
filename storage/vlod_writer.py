"""Writing view cells: what can be seen from each, and the table of all cells.

The order of a build, after `storage.geometry_writer`:

    write_cell_shard   one per subtree of the octree of view cells
    cells_section      the table of the cells of all shards; names all in the manifest

Whatever is written is invisible to readers before `storage.shards.manifest.commit`. The same input gives the same bytes
and the same names, whoever writes them in whatever order.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from storage.cells.codecs import DEFAULT, codec_named
from storage.cells.decisions import decisions
from storage.cells.group import Ids
from storage.cells.octree import LeafSet, Octree
from storage.known_cells import KnownCells
from storage.model.tables import CELL, GROUP
from storage.shards.columns import pack_table
from storage.shards.sections import CellCounts, CellShardRecord, CellsSection
from storage.shards.shards import Kind, write_shard

#: A group is closed before its cells cost more than this, in decisions, so that any cell is read within 5 ms; measured:
#: 95 ns each, and 35 ns for each node of a cut that must be chosen first.
GROUP_DECISIONS = 50_000
PER_CUT_NODE = 0.375


class WrittenCells(NamedTuple):
    """A finished shard of cells, and what the table of all cells says of it."""

    record: CellShardRecord
    cells: np.ndarray  # CELL (n,)
    groups: np.ndarray  # GROUP, a row a frame


def write_cell_shard(
    root: Path, cells: np.ndarray, sets: Sequence[Ids], known: KnownCells, *, codec: str = DEFAULT
) -> WrittenCells:
    """Writes the vLODs of a run of cells into one shard.

    cells: CELL (n,), in Morton order; sets: their vLODs, strictly increasing ids each, out of the cell's cut, empty
    where nothing was computed; known: of the same hierarchy as readers will have; codec: the name of the codec that
    groups are written in. Raises ValueError for what does not fit together.
    """
    rows = np.asarray(cells, CELL)
    if len(rows) != len(sets):
        raise ValueError(f"{len(rows)} cells but {len(sets)} sets")
    own = [np.asarray(ids, np.int64) for ids in sets]
    for cell, ids in zip(rows, own, strict=True):
        if len(ids) != cell["drawables"] or (np.diff(ids) <= 0).any():
            raise ValueError(
                f"cell {cell['key']}: its set must hold {cell['drawables']} increasing ids, and holds {len(ids)}"
            )
    encoder = codec_named(codec)
    groups, payloads = [], []
    for first, end in _groups(rows, own, known):
        computed = [ids for ids, row in zip(own[first:end], rows[first:end], strict=True) if row["computed"]]
        payloads.append((Kind.CELLS, encoder.encode(computed, known.group(rows[first:end]))))
        groups.append(end - first)
    record = write_shard(root, payloads)
    return WrittenCells(
        CellShardRecord(record.name, record.bytes, len(rows), codec), rows, np.array([(n,) for n in groups], GROUP)
    )


def _groups(rows: np.ndarray, sets: Sequence[Ids], known: KnownCells) -> Iterator[tuple[int, int]]:
    """Where groups begin and end."""
    first, held = 0, 0
    for number, row in enumerate(rows):
        cost = 0
        if row["computed"]:
            cut = known.cut(row)
            seen = np.isin(cut, sets[number], assume_unique=True)
            cost = int(decisions(known.tree.end, known.tree.node_of[cut], seen)) + int(PER_CUT_NODE * len(cut))
        if number > first and held + cost > GROUP_DECISIONS:
            yield first, number
            first, held = number, 0
        held += cost
    if len(rows):
        yield first, len(rows)


def cells_section(root: Path, octree: Octree, shards: Sequence[WrittenCells]) -> CellsSection:
    """Writes the table of all cells and returns what the manifest says about cells.

    octree: where the keys of the cells lie; shards: the cell shards in the order of their cells' numbers.
    Raises ValueError if cells overlap.
    """
    cells = np.concatenate([np.zeros(0, CELL), *(shard.cells for shard in shards)])
    groups = np.concatenate([np.zeros(0, GROUP), *(shard.groups for shard in shards)])
    LeafSet(cells["key"])
    table = write_shard(root, [(Kind.TABLE, pack_table(cells)), (Kind.TABLE, pack_table(groups))])
    counts = CellCounts(len(cells), int(cells["computed"].sum()))
    return CellsSection(octree.lo, octree.size, table, tuple(shard.record for shard in shards), counts)
