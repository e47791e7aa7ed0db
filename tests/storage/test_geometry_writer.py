import errno
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from storage.base.errors import StoreNotFoundError
from storage.geometry_writer import (
    PACK_BYTES,
    geometry_section,
    join_geometry,
    write_geometry_shard,
    write_tables_shard,
)
from storage.meshes.pack import MeshArrays
from storage.model.tables import DRAWABLE, GEOMETRY, INSTANCE, NODE, PACK, PART
from storage.shards.sections import GeometryCounts
from storage.shards.shards import ShardRecord
from storage.store import open_store
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
        random.integers(0, 255, (vertices, 4), dtype=np.uint8),
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


@pytest.mark.parametrize("forest", [False, True])
def test_a_tree_is_all_opaque_or_all_to_be_seen_through(tmp_path: Path, forest: bool) -> None:
    tables = _tables()
    nodes, drawables = np.zeros(2, NODE), np.zeros(3, DRAWABLE)
    nodes["end"], nodes["first_drawable"], nodes["levels"] = [1 if forest else 2, 2], [0, 2], [2, 1]
    drawables["node"], drawables["level"], drawables["instance"] = [0, 0, 1], [0, 1, 0], -1
    tables["nodes"], tables["drawables"] = nodes, drawables
    for alike in ([0, 0, 0], [1, 1, 1], *([[0, 0, 1], [1, 1, 0]] if forest else [])):
        drawables["see_through"] = alike
        write_tables_shard(tmp_path, **tables)
    for mixed in ([0, 1, 0], [1, 0, 0], *([] if forest else [[0, 0, 1]])):
        drawables["see_through"] = mixed
        with pytest.raises(ValueError, match="of a tree"):
            write_tables_shard(tmp_path, **tables)
    drawables["see_through"], drawables["one_sided"] = True, [0, 1, 0]
    with pytest.raises(ValueError, match="one-sided"):
        write_tables_shard(tmp_path, **tables)


def test_a_mesh_is_all_opaque_or_all_to_be_seen_through(tmp_path: Path) -> None:
    clear = _mesh(1)
    opaque = clear._replace(colours=clear.colours | np.array([0, 0, 0, 255], np.uint8))
    empty = clear._replace(
        **{name: getattr(clear, name)[:0] for name in ("positions", "triangles", "normals", "colours")}
    )
    write_geometry_shard(tmp_path, [(0, [clear]), (0, [opaque]), (0, [empty._replace(source_faces=None)])])
    mixed = opaque._replace(colours=opaque.colours.copy())
    mixed.colours[mixed.triangles[0, 0], 3] = 254
    with pytest.raises(ValueError, match="at all of its vertices"):
        write_geometry_shard(tmp_path, [(0, [clear]), (0, [mixed])])


def test_every_part_has_a_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="1 parts but 2 names"):
        write_tables_shard(tmp_path, **{**_tables(), "part_names": ["a", "b"]})


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
