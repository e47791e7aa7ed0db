"""Writing the geometry of a store: packs of meshes, and the tables of parts, nodes and drawables.

The order of a build:

    write_geometry_shard   one per task; gives rows of GEOMETRY and PACK that count from the shard's start
    write_packs            the same of meshes that were in packs before, in other packs
    join_geometry          joins those rows of all shards
    write_tables_shard     the joined tables
    geometry_section       names all that in the manifest; `open_geometry` reads it while the build runs

then come view cells (`storage.vlod_writer`), and at last `storage.shards.manifest.commit` makes it a store, or the
store's next version. Whatever is written before is invisible to readers. Each shard is whole or absent. The same input
gives the same bytes and the same names, whoever writes them in whatever order.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.meshes.pack import MeshArrays, ordered, pack, pack_source_faces
from storage.model.tables import DRAWABLE, GEOMETRY, INSTANCE, NO_PART, NODE, PACK, PART
from storage.model.tree import leaves, roots
from storage.shards.columns import pack_names, pack_table
from storage.shards.sections import GeometryCounts, GeometrySection
from storage.shards.shards import Kind, ShardRecord, ShardWriter, write_shard

#: A pack is closed when its meshes' arrays reach this many bytes uncompressed.
PACK_BYTES = 1 << 17


class GeometryShardRecord(NamedTuple):
    """A finished geometry shard and its rows of the tables, counted from the shard's own start."""

    name: str
    bytes: int
    geometry: np.ndarray  # GEOMETRY, one row a mesh in the order given; `pack` counts from the shard's first pack
    packs: np.ndarray  # PACK; `shard` is 0


class TablesShardRecord(NamedTuple):
    """The finished shard of the tables, and what they count."""

    shard: ShardRecord
    counts: GeometryCounts


def write_geometry_shard(root: Path, pieces: Iterable[tuple[int, Sequence[MeshArrays]]]) -> GeometryShardRecord:
    """Writes the meshes of nodes into one shard of the store at `root`.

    pieces: for each node its height (0: a leaf) and its levels, finest first, as `MeshArrays` (or tuples of fields).
    Holds a few packs in memory, never the shard. Level i of a node shares packs with level i of the nodes of the same
    height before and after it, so that what is read together lies together: pass nodes in spatial order.
    The order of a mesh's triangles and vertices is changed (see storage.meshes.mesh_order), its source faces move
    along, and vertices that no triangle uses are dropped. Raises ValueError for arrays that do not fit together, and
    for a mesh of which some vertices are opaque and others not.
    """
    open_packs: dict[tuple[int, int], list[tuple[int, MeshArrays]]] = {}
    open_bytes: dict[tuple[int, int], int] = {}
    with ShardWriter(root) as shard:
        packs = _Packs(shard)
        number = 0
        for height, levels in pieces:
            for level, given in enumerate(levels):
                kind = (height, level)
                mesh = ordered(MeshArrays(*given))
                open_packs.setdefault(kind, []).append((number, mesh))
                number += 1
                size = open_bytes.get(kind, 0) + int(mesh_bytes(len(mesh.positions), len(mesh.triangles)))
                open_bytes[kind] = size
                if size >= PACK_BYTES:
                    packs.write(open_packs.pop(kind))
                    open_bytes.pop(kind)
        for kind in sorted(open_packs):
            packs.write(open_packs.pop(kind))
        packs.finish()
    return packs.record()


def write_packs(root: Path, packs: Iterable[Sequence[MeshArrays]]) -> GeometryShardRecord:
    """Writes packs into one shard of the store at `root`: the meshes of each, as `local_mesh` gives them.

    The rows of GEOMETRY are in the order of the meshes. Raises ValueError for meshes that never were in a pack.
    """
    with ShardWriter(root) as shard:
        written = _Packs(shard)
        number = 0
        for meshes in packs:
            written.write(list(enumerate(meshes, number)))
            number += len(meshes)
        written.finish()
    return written.record()


def mesh_bytes(vertices: ArrayLike, triangles: ArrayLike) -> np.ndarray:
    """Bytes of meshes' arrays (n,) int64, from how many vertices and triangles they have: what fills a pack."""
    return 20 * np.asarray(vertices, np.int64) + 12 * np.asarray(triangles, np.int64)


class _Packs:
    """The packs of a shard that is being written, and its rows of the tables.

    Packs lie side by side, so that neighbours are read at once; behind them all lie the source faces, which few read.
    """

    def __init__(self, shard: ShardWriter) -> None:
        self._shard = shard
        self._source_faces: list[tuple[int, bytes]] = []  # of packs, by number
        self._rows: dict[int, tuple[int, int, int, int, int, float]] = {}  # by the mesh's number in the shard
        self._packs: list[tuple[int, int, int, int, int]] = []

    def write(self, members: Sequence[tuple[int, MeshArrays]]) -> None:
        """Writes a pack of meshes, each with its number in the shard."""
        meshes = [mesh for _, mesh in members]
        _check_alpha(meshes)
        frame = self._shard.add(Kind.GEOMETRY, pack(meshes))
        if any(mesh.source_faces is not None for mesh in meshes):
            self._source_faces.append((len(self._packs), pack_source_faces(meshes)))
        vertex_start = triangle_start = 0
        for number, mesh in members:
            vertices, triangles = len(mesh.positions), len(mesh.triangles)
            self._rows[number] = (
                len(self._packs), vertex_start, vertices, triangle_start, triangles, mesh.scale,
            )  # fmt: skip
            vertex_start += vertices
            triangle_start += triangles
        self._packs.append((0, frame, -1, vertex_start, triangle_start))

    def finish(self) -> None:
        """Writes the source faces of all packs."""
        for number, faces in self._source_faces:
            shard, frame, _, vertices, triangles = self._packs[number]
            self._packs[number] = (shard, frame, self._shard.add(Kind.SOURCE_FACES, faces), vertices, triangles)

    def record(self) -> GeometryShardRecord:
        """What the shard holds, once it is whole."""
        shard = self._shard
        rows = [self._rows[number] for number in range(len(self._rows))]
        return GeometryShardRecord(
            shard.record.name, shard.record.bytes, np.array(rows, GEOMETRY), np.array(self._packs, PACK)
        )


def join_geometry(records: Iterable[GeometryShardRecord]) -> tuple[np.ndarray, np.ndarray, list[ShardRecord]]:
    """The GEOMETRY and PACK tables of shards in the order given, and the shards in the order of PACK's `shard`.

    Row i of a record's geometry becomes row i plus the number of rows of all records before it.
    """
    geometry, packs = [np.zeros(0, GEOMETRY)], [np.zeros(0, PACK)]
    shards: list[ShardRecord] = []
    pack_start = 0
    for record in records:
        shifted, placed = record.geometry.copy(), record.packs.copy()
        shifted["pack"] += pack_start
        placed["shard"] = len(shards)
        pack_start += len(placed)
        geometry.append(shifted)
        packs.append(placed)
        shards.append(ShardRecord(record.name, record.bytes))
    return np.concatenate(geometry), np.concatenate(packs), shards


def write_tables_shard(
    root: Path,
    parts: np.ndarray,
    part_names: Sequence[str],
    instances: np.ndarray,
    geometry: np.ndarray,
    packs: np.ndarray,
    nodes: np.ndarray,
    drawables: np.ndarray,
) -> TablesShardRecord:
    """Writes the tables (PART, INSTANCE, GEOMETRY, PACK, NODE, DRAWABLE) into one shard.

    Raises ValueError where an index of one table points outside another, and where a tree is neither all opaque nor all
    to be seen through.
    """
    _check_tables(parts, part_names, instances, geometry, packs, nodes, drawables)
    tables = ((parts, PART), (instances, INSTANCE), (geometry, GEOMETRY), (packs, PACK), (nodes, NODE))
    frames = [(Kind.TABLE, pack_table(np.asarray(table, dtype))) for table, dtype in tables]
    frames.append((Kind.TABLE, pack_table(np.asarray(drawables, DRAWABLE))))
    frames.append((Kind.NAMES, pack_names(part_names)))
    finest = nodes["first_drawable"][leaves(nodes)]
    counts = GeometryCounts(
        parts=len(parts),
        instances=len(instances),
        geometries=len(geometry),
        packs=len(packs),
        nodes=len(nodes),
        drawables=len(drawables),
        leaves=len(finest),
        levels=int(drawables["level"].max()) + 1 if len(drawables) else 0,
        stored_triangles=int(geometry["triangles"].sum(dtype=np.int64)),
        finest_triangles=int(drawables["triangles"][finest].sum(dtype=np.int64)),
    )
    return TablesShardRecord(write_shard(root, frames), counts)


def geometry_section(grid_step: float, tables: TablesShardRecord, shards: Iterable[ShardRecord]) -> GeometrySection:
    """What the manifest says about geometry; also what `storage.geometry_reader.open_geometry` takes.

    grid_step: model units per grid unit; shards: the geometry shards in the order of PACK's `shard`.
    """
    return GeometrySection(float(grid_step), tables.shard, tuple(shards), tables.counts)


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
    see_through = drawables["see_through"]
    top = roots(nodes)
    below = np.repeat(see_through[starts[top]], end[top] - top)
    if not np.array_equal(see_through, np.repeat(below, levels)):
        raise ValueError("all drawables of a tree must be see-through, or none")
    if (see_through & drawables["one_sided"]).any():
        raise ValueError("a drawable that can be seen through is not one-sided")
    if not np.array_equal(drawables["triangles"], geometry["triangles"][drawables["geometry"]]):
        raise ValueError("a drawable's number of triangles is not its geometry's")


def _check_alpha(meshes: Sequence[MeshArrays]) -> None:
    """Raises ValueError for a mesh of which some vertices are opaque and others not."""
    alphas = [mesh.colours[:, 3] for mesh in meshes if len(mesh.colours)]
    opaque = np.concatenate([np.zeros(0, np.uint8), *alphas]) == 255
    starts = np.cumsum([0, *(len(alpha) for alpha in alphas)])[:-1]
    if (np.logical_or.reduceat(opaque, starts) != np.logical_and.reduceat(opaque, starts)).any():
        raise ValueError("a mesh must be opaque at all of its vertices or at none")


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
