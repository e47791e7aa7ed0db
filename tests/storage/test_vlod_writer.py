from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from storage.base.errors import CorruptStoreError
from storage.cells.codecs import DEFAULT, codec_named
from storage.cells.octree import Octree
from storage.model.tables import CELL
from storage.shards.sections import CellCounts, CellShardRecord
from storage.vlod_writer import cells_section, write_cell_shard


def test_a_section_needs_its_shards(tmp_path: Path) -> None:
    missing = CellShardRecord("missing", 100, 1, DEFAULT)
    with pytest.raises(CorruptStoreError, match="shards/missing is missing") as caught:
        cells_section(tmp_path, Octree((0, 0, 0), 1), [missing])
    assert caught.value.file == "shards/missing"


def test_cells_are_as_many_as_their_shard_says(tmp_path: Path) -> None:
    shard = write_cell_shard(tmp_path, _cells(2), 2 * [np.zeros(0, np.uint32)], [], first=0)
    assert cells_section(tmp_path, Octree((0, 0, 0), 1), [shard]).counts == CellCounts(2, 2)
    with pytest.raises(CorruptStoreError, match=r"it has 2 cells, not 3") as caught:
        cells_section(tmp_path, Octree((0, 0, 0), 1), [replace(shard, cells=3)])
    assert caught.value.file == f"shards/{shard.name}"


def _cells(count: int) -> np.ndarray:
    cells = np.zeros(count, CELL)
    cells["key"] = np.arange(8, 8 + count)
    cells["computed"] = True
    return cells


def test_sets_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    cells, ids = _cells(1), np.array([1, 2], np.uint32)
    with pytest.raises(ValueError, match="1 cells but 2 sets"):
        write_cell_shard(tmp_path, cells, [ids, ids], [], first=0)
    with pytest.raises(ValueError, match="cell 5: its set must hold 0 increasing ids, and holds 2"):
        write_cell_shard(tmp_path, cells, [ids], [], first=5)
    cells["drawables"] = 2
    with pytest.raises(ValueError, match="increasing"):
        write_cell_shard(tmp_path, cells, [ids[::-1]], [], first=5)
    for a, b in ((4, 5), (6, 7), (5, 5), (6, 5)):
        with pytest.raises(ValueError, match=f"cells {a} and {b} does not belong"):
            write_cell_shard(tmp_path, cells, [ids], [(a, b, ids, ids)], first=5)


def test_overlapping_cells_are_refused(tmp_path: Path) -> None:
    empty = [np.zeros(0, np.uint32)]
    shards = [write_cell_shard(tmp_path, _cells(1), empty, [], first=first) for first in (0, 1)]
    with pytest.raises(ValueError, match="overlap"):
        cells_section(tmp_path, Octree((0, 0, 0), 1), shards)


def test_boundaries_may_come_in_any_order(tmp_path: Path) -> None:
    cells = _cells(8)
    sets = [np.arange(cell, cell + 5, dtype=np.uint32) for cell in range(8)]
    cells["drawables"] = 5
    faces = [(a, b, sets[a], sets[b]) for a in range(8) for b in (a + 1, a + 2, a + 4) if b < 8]
    assert write_cell_shard(tmp_path, cells, sets, faces, first=0) == write_cell_shard(
        tmp_path, cells, sets, faces[::-1], first=0
    )


def test_boundaries_take_few_bytes(tmp_path: Path) -> None:
    """4,000 ids a cell of which neighbours share all but 2 %: far below the 750 bytes a boundary of the vLOD paper."""
    random = np.random.default_rng(0)
    sets = [np.sort(random.choice(40_000, 4000, replace=False)).astype(np.uint32)]
    for _ in range(63):
        kept = random.choice(sets[-1], 3920, replace=False)
        fresh = random.choice(np.setdiff1d(np.arange(40_000), kept), 80, replace=False)
        sets.append(np.sort(np.concatenate([kept, fresh])).astype(np.uint32))
    cells = np.zeros(64, CELL)
    cells["key"], cells["drawables"], cells["computed"] = np.arange(64, 128), 4000, True
    faces = [(a, a + 1, sets[a], sets[a + 1]) for a in range(63)]
    size = write_cell_shard(tmp_path, cells, sets, faces, first=0).bytes
    whole = sum(len(codec_named(DEFAULT).encode([ids])) for ids in sets)
    assert size < whole / 6
    assert size < 63 * 300 + 4 * whole / 64 + 1000
