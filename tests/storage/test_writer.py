import errno
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from storage.base.errors import CorruptStoreError, StoreNotFoundError
from storage.cells.codecs import DEFAULT, codec_named
from storage.cells.octree import Octree
from storage.meshes.pack import MeshArrays
from storage.model.tables import CELL, DRAWABLE, GEOMETRY, INSTANCE, NODE, PACK, PART
from storage.shards.sections import CellCounts, CellShardRecord, GeometryCounts
from storage.shards.shards import ShardRecord
from storage.store import open_store
from storage.writer import (
    PACK_BYTES,
    cells_section,
    geometry_section,
    join_geometry,
    write_cell_shard,
    write_geometry_shard,
    write_tables_shard,
)
from tests.storage.tiny_store import make_store, room_parts


def _mesh(seed: int, triangles: int = 50, scale: float = 1.0) -> MeshArrays:
    random = np.random.default_rng(seed)
    vertices = triangles
    normals = random.normal(size=(vertices, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return MeshArrays(
        random.integers(-1000, 1000, (vertices, 3), dtype=np.int32),
        random.integers(0, vertices, (triangles, 3), dtype=np.uint32),
        normals.astype(np.float32),
        random.integers(0, 256, (vertices, 4), dtype=np.uint8),
        random.integers(0, 1000, (triangles, 2), dtype=np.uint32),
        scale,
    )


def _content(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}


def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        make_store(tmp_path / name, room_parts())
    assert _content(tmp_path / "a") == _content(tmp_path / "b")


def test_building_again_changes_nothing(tmp_path: Path) -> None:
    make_store(tmp_path, room_parts())
    before = _content(tmp_path)
    make_store(tmp_path, room_parts())
    assert _content(tmp_path) == before


def test_rows_of_geometry_are_in_the_order_given(tmp_path: Path) -> None:
    pieces = [
        [_mesh(10 * piece + level, 40 >> level, 2.0**-piece) for level in range(piece % 3 + 1)] for piece in range(7)
    ]
    record = write_geometry_shard(tmp_path, [(0, piece) for piece in pieces])
    flat = [mesh for piece in pieces for mesh in piece]
    assert record.geometry["triangles"].tolist() == [len(mesh.triangles) for mesh in flat]
    assert record.geometry["scale"].tolist() == [mesh.scale for mesh in flat]
    assert len(record.packs) == 3  # one a level: all are small
    assert [int(record.packs[pack]["triangles"]) for pack in range(3)] == [
        sum(len(piece[level].triangles) for piece in pieces if level < len(piece)) for level in range(3)
    ]


def test_plain_tuples_are_meshes_too(tmp_path: Path) -> None:
    given = [(0, [tuple(_mesh(1))])]
    assert write_geometry_shard(tmp_path, given).name == write_geometry_shard(tmp_path, [(0, [_mesh(1)])]).name


def test_nodes_of_different_heights_share_no_packs(tmp_path: Path) -> None:
    record = write_geometry_shard(tmp_path, [(height, [_mesh(height)]) for height in (0, 0, 1, 2, 2)])
    assert sorted(record.packs["triangles"].tolist()) == [50, 100, 100]
    assert record.geometry["pack"].tolist() == [0, 0, 1, 2, 2]


def test_packs_are_closed_when_they_are_large_enough(tmp_path: Path) -> None:
    record = write_geometry_shard(tmp_path, [(0, [_mesh(seed, 500)]) for seed in range(40)])
    sizes = 20 * record.packs["vertices"].astype(int) + 12 * record.packs["triangles"].astype(int)
    assert len(sizes) > 2
    assert (sizes[:-1] >= PACK_BYTES).all()
    assert sizes.max() < PACK_BYTES + 500 * 32
    assert record.packs["source_frame"].min() >= 0


def test_levels_without_source_faces_keep_none(tmp_path: Path) -> None:
    record = write_geometry_shard(tmp_path, [(0, [_mesh(1), _mesh(2)._replace(source_faces=None)])])
    assert (record.packs["source_frame"] >= 0).tolist() == [True, False]


def test_shards_are_joined(tmp_path: Path) -> None:
    records = [write_geometry_shard(tmp_path, [(0, [_mesh(seed), _mesh(seed + 50)])]) for seed in range(3)]
    geometry, packs, shards = join_geometry(records)
    assert shards == [ShardRecord(record.name, record.bytes) for record in records]
    assert packs["shard"].tolist() == [0, 0, 1, 1, 2, 2]
    assert geometry["pack"].tolist() == list(range(6))
    empty_geometry, empty_packs, none = join_geometry([])
    assert (len(empty_geometry), len(empty_packs), none) == (0, 0, [])


def _tables() -> dict[str, Any]:
    nodes, drawables, geometry = np.zeros(1, NODE), np.zeros(2, DRAWABLE), np.zeros(2, GEOMETRY)
    nodes["levels"], nodes["end"] = 2, 1
    drawables["level"] = [0, 1]
    drawables["instance"] = -1
    drawables["geometry"] = [0, 1]
    return {
        "parts": np.zeros(1, PART),
        "part_names": ["part"],
        "instances": np.zeros(0, INSTANCE),
        "geometry": geometry,
        "packs": np.zeros(1, PACK),
        "nodes": nodes,
        "drawables": drawables,
    }


@pytest.mark.parametrize(
    ("table", "field", "value", "message"),
    [
        ("geometry", "pack", 1, "geometry.pack points at row 1 of 1"),
        ("nodes", "part", 4, "node.part points at row 4 of 1"),
        ("drawables", "node", 1, "drawable.node points at row 1 of 1"),
        ("drawables", "geometry", 2, "drawable.geometry points at row 2 of 2"),
        ("drawables", "instance", 0, "drawable.instance points at row 0 of 0"),
        ("drawables", "triangles", 3, "number of triangles"),
        ("drawables", "level", 0, "finest level first"),
        ("nodes", "levels", 1, "side by side"),
        ("nodes", "first_drawable", 1, "side by side"),
        ("nodes", "end", 0, "preorder"),
        ("nodes", "end", 2, "preorder"),
    ],
)
def test_tables_that_do_not_fit_are_refused(tmp_path: Path, table: str, field: str, value: int, message: str) -> None:
    tables = _tables()
    write_tables_shard(tmp_path, **tables)
    tables[table][field] = value
    with pytest.raises(ValueError, match=message):
        write_tables_shard(tmp_path, **tables)


def test_every_part_has_a_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="1 parts but 2 names"):
        write_tables_shard(tmp_path, **{**_tables(), "part_names": ["a", "b"]})


def test_sections_need_their_shards(tmp_path: Path) -> None:
    missing = CellShardRecord("missing", 100, 1, DEFAULT)
    with pytest.raises(CorruptStoreError, match="shards/missing is missing") as caught:
        cells_section(tmp_path, Octree((0, 0, 0), 1), [missing])
    assert caught.value.file == "shards/missing"


def test_what_tables_count(tmp_path: Path) -> None:
    tables = _tables()
    tables["geometry"]["triangles"] = tables["drawables"]["triangles"] = [7, 3]
    section = geometry_section(0.5, write_tables_shard(tmp_path, **tables), [ShardRecord("packs", 9)])
    assert section.shards == (ShardRecord("packs", 9),)
    assert section.counts == GeometryCounts(
        parts=1,
        instances=0,
        geometries=2,
        packs=1,
        nodes=1,
        drawables=2,
        leaves=1,
        levels=2,
        stored_triangles=10,
        finest_triangles=7,
    )


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


def test_leftovers_of_a_killed_build_are_no_store(tmp_path: Path) -> None:
    """All that a build writes before its last step, and temporary files: still no store."""
    store = make_store(tmp_path, room_parts()[:2], depth=1)
    content = (tmp_path / "manifest.json").read_bytes()
    (tmp_path / "manifest.json").unlink()
    for folder in (tmp_path, tmp_path / "shards", tmp_path / "versions"):
        (folder / ".tmp-0123456789abcdef").write_bytes(content[:100])
    with pytest.raises(StoreNotFoundError, match="its build has not finished"):
        open_store(tmp_path)
    (tmp_path / "manifest.json").write_bytes(content)
    assert not list(store.check())
    assert not list(open_store(tmp_path).check())


def test_a_full_disk_leaves_no_shard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_geometry_shard(tmp_path, [(0, [_mesh(1)])])
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


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
