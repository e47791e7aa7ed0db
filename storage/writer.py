"""Writing a store: geometry shards, tables, cell shards, and at last the manifest.

The order of a build:

    write_geometry_shard   one per task; gives rows of GEOMETRY and PACK that count from the shard's start
    join_geometry          joins those rows of all shards
    write_tables_shard     the joined tables
    geometry_section       names all that in the manifest; `storage.store.open_geometry` reads it while the build runs
    write_cell_shard       one per subtree of the octree of view cells
    cells_section          joins the cells of all shards and names them in the manifest
    commit                 makes it a store, or the store's next version

Whatever is written before `commit` is invisible to readers. Each shard is whole or absent. The same input gives the
same bytes and the same names, whoever writes them in whatever order.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from storage.cells.codecs import DEFAULT, codec_named
from storage.cells.deltas import Ids, difference
from storage.cells.octree import LeafSet, Octree
from storage.cells.spanning_forest import spanning_forest
from storage.meshes.pack import MeshArrays, ordered, pack, pack_source_faces
from storage.model.tables import BOUNDARY, CELL, CELL_LINK, DRAWABLE, GEOMETRY, INSTANCE, NO_PART, NODE, PACK, PART
from storage.shards.columns import pack_names, pack_table, unpack_table
from storage.shards.manifest import Manifest, commit
from storage.shards.shards import Kind, ShardReader, ShardRecord, ShardWriter, shard_path, write_shard

__all__ = [
    "GeometryShardRecord",
    "Manifest",
    "MeshArrays",
    "cells_section",
    "commit",
    "geometry_section",
    "join_geometry",
    "write_cell_shard",
    "write_geometry_shard",
    "write_tables_shard",
]

#: A pack is closed when its meshes' arrays reach this many bytes uncompressed.
PACK_BYTES = 1 << 17

#: A block of deltas is closed when it holds this many ids.
BLOCK_IDS = 1 << 12


class GeometryShardRecord(NamedTuple):
    """A finished geometry shard and its rows of the tables, counted from the shard's own start."""

    name: str
    bytes: int
    geometry: np.ndarray  # GEOMETRY, one row a mesh in the order given; `pack` counts from the shard's first pack
    packs: np.ndarray  # PACK; `shard` is 0


def write_geometry_shard(root: Path, pieces: Iterable[tuple[int, Sequence[MeshArrays]]]) -> GeometryShardRecord:
    """Writes the meshes of nodes into one shard of the store at `root`.

    pieces: for each node its height (0: a leaf) and its levels, finest first, as `MeshArrays` (or tuples of fields).
    Holds a few packs in memory, never the shard. Level i of a node shares packs with level i of the nodes of the same
    height before and after it, so that what is drawn together is fetched together: pass nodes in spatial order.
    The order of a mesh's triangles and vertices is changed (see storage.meshes.mesh_order), its source faces move
    along, and vertices that no triangle uses are dropped. Raises ValueError for arrays that do not fit together.
    """
    rows: list[tuple[int, int, int, int, int, float]] = []
    packs: list[tuple[int, int, int, int, int]] = []
    open_packs: dict[tuple[int, int], list[tuple[int, MeshArrays]]] = {}
    open_bytes: dict[tuple[int, int], int] = {}

    with ShardWriter(root) as shard:

        def close(kind: tuple[int, int]) -> None:
            members = open_packs.pop(kind)
            open_bytes.pop(kind)
            meshes = [mesh for _, mesh in members]
            frame = shard.add(Kind.GEOMETRY, pack(meshes))
            source_frame = -1
            if any(mesh.source_faces is not None for mesh in meshes):
                source_frame = shard.add(Kind.SOURCE_FACES, pack_source_faces(meshes))
            vertex_start = triangle_start = 0
            for row, mesh in members:
                vertices, triangles = len(mesh.positions), len(mesh.triangles)
                rows[row] = (len(packs), vertex_start, vertices, triangle_start, triangles, mesh.scale)
                vertex_start += vertices
                triangle_start += triangles
            packs.append((0, frame, source_frame, vertex_start, triangle_start))

        for height, levels in pieces:
            for level, given in enumerate(levels):
                kind = (height, level)
                mesh = ordered(MeshArrays(*given))
                open_packs.setdefault(kind, []).append((len(rows), mesh))
                rows.append((0, 0, 0, 0, 0, 0.0))
                size = open_bytes.get(kind, 0) + 20 * len(mesh.positions) + 12 * len(mesh.triangles)
                open_bytes[kind] = size
                if size >= PACK_BYTES:
                    close(kind)
        for kind in sorted(open_packs):
            close(kind)
    return GeometryShardRecord(*shard.record, np.array(rows, GEOMETRY), np.array(packs, PACK))


def join_geometry(records: Iterable[GeometryShardRecord]) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The GEOMETRY and PACK tables of shards in the order given, and the shards' names in the order of PACK's `shard`.

    Row i of a record's geometry becomes row i plus the number of rows of all records before it.
    """
    geometry, packs = [np.zeros(0, GEOMETRY)], [np.zeros(0, PACK)]
    names: list[str] = []
    pack_start = 0
    for record in records:
        shifted, placed = record.geometry.copy(), record.packs.copy()
        shifted["pack"] += pack_start
        placed["shard"] = len(names)
        pack_start += len(placed)
        geometry.append(shifted)
        packs.append(placed)
        names.append(record.name)
    return np.concatenate(geometry), np.concatenate(packs), names


def write_tables_shard(
    root: Path,
    parts: np.ndarray,
    part_names: Sequence[str],
    instances: np.ndarray,
    geometry: np.ndarray,
    packs: np.ndarray,
    nodes: np.ndarray,
    drawables: np.ndarray,
) -> str:
    """Writes the tables (PART, INSTANCE, GEOMETRY, PACK, NODE, DRAWABLE) into one shard; returns its name.

    Raises ValueError where an index of one table points outside another.
    """
    _check_tables(parts, part_names, instances, geometry, packs, nodes, drawables)
    tables = ((parts, PART), (instances, INSTANCE), (geometry, GEOMETRY), (packs, PACK), (nodes, NODE))
    frames = [(Kind.TABLE, pack_table(np.asarray(table, dtype))) for table, dtype in tables]
    frames.append((Kind.TABLE, pack_table(np.asarray(drawables, DRAWABLE))))
    frames.append((Kind.NAMES, pack_names(part_names)))
    return write_shard(root, frames).name


def geometry_section(root: Path, grid_step: float, tables: str, shards: Sequence[str]) -> dict[str, Any]:
    """What the manifest says about geometry; also what `storage.store.open_geometry` takes. JSON holds it.

    grid_step: model units per grid unit; tables: name of the tables shard; shards: names of the geometry shards in the
    order of PACK's `shard`. Raises FileNotFoundError if one of them is not there.
    """
    reader = _reader(root, tables)
    names = ("parts", "instances", "geometries", "packs", "nodes", "drawables")
    dtypes = (PART, INSTANCE, GEOMETRY, PACK, NODE, DRAWABLE)
    counts = {}
    for frame, (name, dtype) in enumerate(zip(names, dtypes, strict=True)):
        table = unpack_table(reader.frame(frame, Kind.TABLE), dtype)
        counts[name] = len(table)
        if name == "geometries":
            counts["stored_triangles"] = int(table["triangles"].sum(dtype=np.int64))
        if name == "nodes":
            leaf = table["end"] == np.arange(len(table)) + 1
            counts["leaves"] = int(leaf.sum())
            finest = table["first_drawable"][leaf]
        if name == "drawables":
            counts["levels"] = int(table["level"].max()) + 1 if len(table) else 0
            counts["finest_triangles"] = int(table["triangles"][finest].sum(dtype=np.int64))
    return {
        "grid_step": float(grid_step),
        "tables": list(reader.record),
        "shards": [list(_reader(root, name).record) for name in shards],
        "counts": counts,
    }


def write_cell_shard(
    root: Path,
    cells: np.ndarray,
    sets: Sequence[Ids],
    boundaries: Sequence[tuple[int, int, Ids, Ids]],
    *,
    first: int,
) -> str:
    """Writes the vLODs of a run of cells into one shard; returns its name.

    cells: CELL (n,), the store's cells number `first` to `first + n - 1`; sets: their vLODs, strictly increasing ids
    each, empty where nothing was computed; boundaries: (a, b, vLOD of a, vLOD of b) for all computed cells a < b of
    the store that share a face, where a lies in this shard; in any order. A cell's vLOD is its key set or a chain of
    at most LONGEST_CHAIN deltas from one. Raises ValueError for what does not fit together.
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
    codec = codec_named(DEFAULT)
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
        payloads.append((Kind.KEY_SET, codec.encode([np.asarray(sets[cell], np.uint32)])))

    block: list[Ids] = []
    held = 0
    for number, (a, b, set_a, set_b) in enumerate(faces):
        delta = difference(np.asarray(set_a, np.uint32), np.asarray(set_b, np.uint32))
        table[number] = (a - first, b, lead + len(payloads), len(block) // 2)
        block.extend(delta)
        held += len(delta.added) + len(delta.dropped)
        if held >= BLOCK_IDS or number == len(faces) - 1:
            payloads.append((Kind.DELTAS, codec.encode(block)))
            block, held = [], 0
        below, above = a - first, b - first
        if above < len(rows):
            child = below if parents[below] == above else above if parents[above] == below else -1
            if child >= 0:
                links[child]["frame"], links[child]["slot"] = table[number]["frame"], table[number]["slot"]
    head = [(Kind.TABLE, pack_table(rows)), (Kind.TABLE, pack_table(links)), (Kind.TABLE, pack_table(table))]
    return write_shard(root, [*head, *payloads]).name


def cells_section(root: Path, octree: Octree, shards: Sequence[str]) -> dict[str, Any]:
    """Writes the table of all cells and returns what the manifest says about cells. JSON holds it.

    octree: where the keys of the cells lie; shards: names of the cell shards in the order of their cells' numbers.
    Raises ValueError if cells overlap, FileNotFoundError if a shard is not there.
    """
    readers = [_reader(root, name) for name in shards]
    tables = [unpack_table(reader.frame(0, Kind.TABLE), CELL) for reader in readers]
    cells = np.concatenate([np.zeros(0, CELL), *tables])
    LeafSet(cells["key"])
    table = write_shard(root, [(Kind.TABLE, pack_table(cells))])
    return {
        "octree_lo": list(octree.lo),
        "octree_size": octree.size,
        "codec": DEFAULT,
        "table": list(table),
        "shards": [[*reader.record, len(rows)] for reader, rows in zip(readers, tables, strict=True)],
        "counts": {"cells": len(cells), "computed_cells": int(cells["computed"].sum())},
    }


def _reader(root: Path, name: str) -> ShardReader:
    """Reads a shard that was just written."""
    path = root / shard_path(name)

    def read(start: int, end: int) -> bytes:
        with path.open("rb") as file:
            file.seek(start)
            return file.read(end - start)

    return ShardReader(ShardRecord(name, path.stat().st_size), read)


def _check_tables(
    parts: np.ndarray,
    part_names: Sequence[str],
    instances: np.ndarray,
    geometry: np.ndarray,
    packs: np.ndarray,
    nodes: np.ndarray,
    drawables: np.ndarray,
) -> None:
    """Raises ValueError where an index of one table points outside another, or nodes and drawables disagree."""
    if len(part_names) != len(parts):
        raise ValueError(f"{len(parts)} parts but {len(part_names)} names")
    references: tuple[tuple[str, NDArray, int], ...] = (
        ("geometry.pack", geometry["pack"], len(packs)),
        ("node.part", nodes["part"][nodes["part"] != NO_PART], len(parts)),
        ("drawable.node", drawables["node"], len(nodes)),
        ("drawable.geometry", drawables["geometry"], len(geometry)),
        ("drawable.instance", drawables["instance"], len(instances)),
    )
    for name, indices, limit in references:
        if len(indices) and int(indices.max()) >= limit:
            raise ValueError(f"{name} points at row {int(indices.max())} of {limit}")
    end = nodes["end"].astype(np.int64)
    if not _is_preorder(end):
        raise ValueError("nodes must be in preorder, each node's `end` right behind all below it")
    levels = nodes["levels"].astype(np.int64)
    starts = np.cumsum(levels) - levels
    if (levels < 1).any() or not np.array_equal(starts, nodes["first_drawable"]) or levels.sum() != len(drawables):
        raise ValueError("nodes must have one level or more, their drawables side by side in the nodes' order")
    if not np.array_equal(drawables["node"], np.repeat(np.arange(len(nodes)), levels)) or not np.array_equal(
        drawables["level"], np.arange(len(drawables)) - np.repeat(starts, levels)
    ):
        raise ValueError("drawables must be in the order of their nodes, finest level first")
    if not np.array_equal(drawables["triangles"], geometry["triangles"][drawables["geometry"]]):
        raise ValueError("a drawable's number of triangles is not its geometry's")


def _is_preorder(end: NDArray[np.int64]) -> bool:
    """Whether each of the runs i + 1 ... end[i] - 1 lies inside every run that it begins in."""
    open_ends: list[int] = []
    for node, last in enumerate(end.tolist()):
        while open_ends and open_ends[-1] <= node:
            open_ends.pop()
        if last <= node or last > (open_ends[-1] if open_ends else len(end)):
            return False
        open_ends.append(last)
    return True
