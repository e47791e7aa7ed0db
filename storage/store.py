"""Opening a store and reading from it: the public reading surface.

    from storage import open_store
    s = open_store(url)
    s.drawables, s.cells     structured arrays: storage.model.tables
    s.cell_at(points)        which cell holds each point
    s.vlod(cell)             what can be seen from the cell
    s.cut(cell)              the whole model at the cell's detail, visible or not
    s.mesh(drawable)         its triangles in model space

A store is safe to use from several threads. Everything that is given out is read-only.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.base.errors import CorruptStoreError, NotComputedError, ParameterError, StoreError, StoreNotFoundError
from storage.cells.codecs import codec_named
from storage.cells.deltas import Delta, Ids, odd_ones
from storage.cells.octree import LeafSet, Octree, neighbours
from storage.meshes.facets import CONE, find_turned_away, part_meshes
from storage.meshes.pack import Pack, unpack, unpack_source_faces
from storage.meshes.placement import IDENTITY, normal_matrix, placed, transform_points
from storage.model.cut import choose_cut
from storage.model.tables import (
    BOUNDARY,
    CELL,
    CELL_LINK,
    DRAWABLE,
    GEOMETRY,
    INSTANCE,
    NO_PART,
    NODE,
    PACK,
    PART,
    Grid,
)
from storage.shards.cache import ByteCache
from storage.shards.columns import unpack_names, unpack_table
from storage.shards.files import Files
from storage.shards.manifest import FILE, Manifest, from_bytes, version_path
from storage.shards.shards import Kind, ShardReader, ShardRecord, shard_path

#: Bytes of decoded packs that a store keeps in memory.
GEOMETRY_CACHE = 1 << 28

#: Drawables that `Geometry.surfaces` places at once.
SURFACES_AT_ONCE = 4096

#: Bytes of decoded cell shards' tables, sets and deltas that a store keeps in memory.
CELL_CACHE = 1 << 26


class LocalMesh(NamedTuple):
    """A mesh as stored, in its own coordinates: local position = integer * scale. Instances share it."""

    positions: NDArray[np.int32]  # (n, 3)
    triangles: NDArray[np.uint32]  # (m, 3)
    normals: NDArray[np.float32]  # (n, 3), unit
    colours: NDArray[np.uint8]  # (n, 4)
    scale: float  # local units per integer step, a power of two


class Mesh(NamedTuple):
    """A drawable's triangles in model space."""

    positions: NDArray[np.float32]  # (n, 3), model units; each an exact integer multiple of the grid's step
    triangles: NDArray[np.uint32]  # (m, 3), counter-clockwise as seen from the side the normals point to
    normals: NDArray[np.float32]  # (n, 3), unit
    colours: NDArray[np.uint8]  # (n, 4), red, green, blue, opacity


class Surfaces(NamedTuple):
    """The triangles of several drawables in grid coordinates, one drawable after the other."""

    points: NDArray[np.int32]  # (n, 3), multiples of grid.step
    triangles: NDArray[np.int64]  # (m, 3) into points, wound as in `Mesh`
    vertex_counts: NDArray[np.int64]  # (d,) points of each drawable
    triangle_counts: NDArray[np.int64]  # (d,) triangles of each drawable


@dataclass(frozen=True, eq=False)
class Facets:
    """The facets of some drawables: runs of their triangles, each with a cone behind all of it."""

    drawables: NDArray[np.int64]  # (d,) sorted ids
    first: NDArray[np.int64]  # (d,) row of each one's first facet; instances share rows
    count: NDArray[np.int64]  # (d,)
    instance: NDArray[np.int64]  # (d,) row of `matrices`, -1: in model space
    scale: NDArray[np.float64]  # (d,) local units per step of the positions
    triangles: NDArray[np.int64]  # (f,) triangles of each facet
    cones: NDArray[np.float64]  # (f, CONE) storage.meshes.facets
    matrices: NDArray[np.float64]  # (n, 3, 4) placements of instances
    step: float  # model units per grid unit

    def turned_away(self, drawables: NDArray[np.int64], lo: ArrayLike, hi: ArrayLike) -> TurnedAway:
        """Which facets of drawables (k,), all of this set, show only backs to a cell lo ... hi (3,) in model units."""
        places = np.searchsorted(self.drawables, drawables)
        first, count = self.first[places], self.count[places]
        away = find_turned_away(
            first, count, self.instance[places], self.scale[places], self.cones, self.matrices, self.step,
            np.array(lo, np.float64), np.array(hi, np.float64),
        )  # fmt: skip
        starts = np.cumsum(count) - count
        rows = np.repeat(first - starts, count) + np.arange(len(away))
        return TurnedAway(away, self.triangles[rows], starts)


class TurnedAway(NamedTuple):
    """Which facets of some drawables show a cell only their backs: the player leaves them out."""

    away: NDArray[np.bool_]  # (f,) facets, one drawable after the other, in the order of their triangles
    triangles: NDArray[np.int64]  # (f,) triangles of each
    starts: NDArray[np.int64]  # (k,) each drawable's first facet

    @property
    def triangle_counts(self) -> NDArray[np.int64]:
        """(k,) triangles of each drawable that are left out."""
        left_out = np.where(self.away, self.triangles, 0)
        return np.add.reduceat(left_out, self.starts) if len(self.starts) else left_out


class Problem(NamedTuple):
    """Something found wrong by `Store.check`."""

    file: str  # path inside the store
    what: str  # one line

    def __str__(self) -> str:
        return self.what


class _CellShard(NamedTuple):
    """The tables of one cell shard."""

    links: np.ndarray  # CELL_LINK
    boundaries: np.ndarray  # BOUNDARY, sorted by first, second
    keys: NDArray[np.int64]  # (k, 2), first and second of each boundary, cells of the store


class Geometry:
    """The geometry of a store: its tables and meshes. `Store` adds cells.

    Every method raises CorruptStoreError, which names the shard, where bytes are missing or changed, and
    StoreUnreachableError where they cannot be read.
    """

    def __init__(self, files: Files, section: Mapping[str, Any]) -> None:
        self.files = files
        self.grid = Grid(float(section["grid_step"]))
        tables = self._reader(ShardRecord(*section["tables"]))
        dtypes = (PART, INSTANCE, GEOMETRY, PACK, NODE, DRAWABLE)
        loaded = [unpack_table(tables.frame(frame, Kind.TABLE), dtype) for frame, dtype in enumerate(dtypes)]
        #: PART, INSTANCE, GEOMETRY, PACK, NODE and DRAWABLE arrays: storage.model.tables.
        self.parts, self.instances, self.geometry, self.packs, self.nodes, self.drawables = loaded
        #: The name of each part.
        self.part_names = unpack_names(tables.frame(len(dtypes), Kind.NAMES))
        self._geometry_shards = [self._reader(ShardRecord(*entry)) for entry in section["shards"]]
        self._packs: ByteCache[Pack] = ByteCache(GEOMETRY_CACHE)

    @cached_property
    def one_sided(self) -> NDArray[np.bool_]:
        """(geometries,) of which meshes only fronts count, wherever they are placed."""
        only = np.ones(len(self.geometry), np.bool_)
        only[self.drawables["geometry"][~self.drawables["one_sided"]]] = False
        return only

    @property
    def bytes_fetched(self) -> int:
        """Bytes read from the store's files so far."""
        return self.files.bytes_fetched

    def pack(self, number: int) -> Pack:
        """A decoded pack, in the local coordinates of its meshes; row `number` of `packs` says where it lies."""

        def load() -> tuple[Pack, int]:
            row = self.packs[number]
            decoded = unpack(self._geometry_shards[int(row["shard"])].frame(int(row["frame"]), Kind.GEOMETRY))
            if len(decoded.positions) != row["vertices"] or len(decoded.triangles) != row["triangles"]:
                raise CorruptStoreError(f"pack {number} is not of the size that the tables say; rebuild the store")
            return decoded, decoded.bytes

        return self._packs.get(int(number), load)

    def local_mesh(self, geometry: int) -> LocalMesh:
        """The mesh of row `geometry` of the GEOMETRY table, in its local coordinates."""
        row = self.geometry[geometry]
        decoded = self.pack(int(row["pack"]))
        vertices = slice(int(row["vertex_start"]), int(row["vertex_start"]) + int(row["vertices"]))
        triangles = slice(int(row["triangle_start"]), int(row["triangle_start"]) + int(row["triangles"]))
        return LocalMesh(
            decoded.positions[vertices],
            decoded.triangles[triangles],
            decoded.normals[vertices],
            decoded.colours[vertices],
            float(row["scale"]),
        )

    def mesh(self, drawable: int) -> Mesh:
        """A drawable's triangles in model space.

        Positions are exact integer multiples of grid.step; of instances they are snapped to it. The normals of
        instances are turned by the inverse transpose of their matrix, and the winding of mirrored ones is reversed.
        """
        row = self.drawables[drawable]
        local = self.local_mesh(int(row["geometry"]))
        triangles, normals = local.triangles, local.normals
        if row["instance"] < 0:
            positions = (local.positions * np.float64(local.scale)).astype(np.float32)
        else:
            matrix = self.instances[int(row["instance"])]["matrix"]
            on_grid = placed(local.positions, local.scale, matrix, self.grid.step)
            positions = (on_grid * np.float64(self.grid.step)).astype(np.float32)
            linear, mirrored = normal_matrix(matrix)
            normals = _unit(transform_points(np.column_stack([linear, np.zeros(3)]), normals))
            if mirrored:
                triangles = np.ascontiguousarray(triangles[:, [0, 2, 1]])
                triangles.flags.writeable = False
        positions.flags.writeable = False
        return Mesh(positions, triangles, normals, local.colours)

    def surfaces(self, drawables: NDArray[np.integer]) -> Surfaces:
        """Positions and triangles of drawables (d,), the very same as `mesh` gives: for those who need many at once."""
        ids = np.asarray(drawables, np.int64)
        vertices = self.geometry["vertices"][self.drawables["geometry"][ids]].astype(np.int64)
        triangles = self.drawables["triangles"][ids].astype(np.int64)
        points = np.empty((int(vertices.sum()), 3), np.int32)
        corners = np.empty((int(triangles.sum()), 3), np.int64)
        point_starts = np.concatenate([[0], np.cumsum(vertices)])
        corner_starts = np.concatenate([[0], np.cumsum(triangles)])
        for begin in range(0, len(ids), SURFACES_AT_ONCE):
            end = min(begin + SURFACES_AT_ONCE, len(ids))
            self._place(
                ids[begin:end],
                points[point_starts[begin] : point_starts[end]],
                corners[corner_starts[begin] : corner_starts[end]],
            )
        corners += np.repeat(point_starts[:-1], triangles)[:, None]
        return Surfaces(points, corners, vertices, triangles)

    def _place(self, ids: NDArray[np.int64], points: NDArray[np.int32], corners: NDArray[np.int64]) -> None:
        """Fill `points` and `corners`, which begin anew for each drawable, of the drawables `ids`."""
        rows = self.drawables[ids]
        instances = rows["instance"]
        local = [self.local_mesh(int(number)) for number in rows["geometry"]]
        np.concatenate([mesh.triangles for mesh in local], out=corners)
        first = 0
        for mesh, number in zip(local, instances.tolist(), strict=True):
            matrix = self.instances["matrix"][number] if number >= 0 else IDENTITY
            last = first + len(mesh.positions)
            points[first:last] = placed(mesh.positions, mesh.scale, matrix, self.grid.step)
            first = last
        used, which = np.unique(instances, return_inverse=True)
        mirrored = np.array([n >= 0 and normal_matrix(self.instances["matrix"][n])[1] for n in used])
        turned = np.repeat(mirrored[which], rows["triangles"])
        corners[turned] = corners[turned][:, [0, 2, 1]]

    def facets(self, drawables: NDArray[np.integer]) -> Facets:
        """The facets of drawables (d,), sorted ids, whose meshes are read."""
        ids = np.asarray(drawables, np.int64)
        used, which = np.unique(self.drawables["geometry"][ids], return_inverse=True)
        count = np.zeros(len(used), np.int64)
        triangles, cones = [np.zeros(0, np.int64)], [np.zeros((0, CONE))]
        for at, number in enumerate(used.tolist()):
            _, sizes, behind = self._parted(number)
            count[at] = len(sizes)
            triangles.append(sizes)
            cones.append(behind)
        return Facets(
            ids,
            (np.cumsum(count) - count)[which],
            count[which],
            self.drawables["instance"][ids].astype(np.int64),
            self.geometry["scale"][used][which].astype(np.float64),
            np.concatenate(triangles),
            np.concatenate(cones),
            self.instances["matrix"].copy(),
            self.grid.step,
        )

    def turned_away(self, drawable: int, lo: ArrayLike, hi: ArrayLike) -> NDArray[np.bool_]:
        """Which triangles (m,) of a drawable, in the order of `mesh`, lie in facets that show a cell only their backs.

        lo, hi (3,): the cell, in model units.
        """
        found = self.facets(np.array([drawable])).turned_away(np.array([drawable]), lo, hi)
        order, sizes, _ = self._parted(int(self.drawables["geometry"][drawable]))
        away = np.empty(len(order), np.bool_)
        away[order] = np.repeat(found.away, sizes)
        return away

    def _parted(self, geometry: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """The order of a mesh's triangles by facets, the triangles of each facet, and the cones."""
        mesh = self.local_mesh(geometry)
        order, _, sizes, cones = part_meshes(
            mesh.positions, mesh.triangles, np.array([len(mesh.positions)]), np.array([len(mesh.triangles)]),
            self.one_sided[geometry : geometry + 1],
        )  # fmt: skip
        return order, sizes, cones

    def source_faces(self, drawable: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """For the finest level of a leaf: of each of its triangles the part (m,) and the face of that part (m,).

        Raises ParameterError for what is coarser.
        """
        row = self.drawables[drawable]
        node = self.nodes[int(row["node"])]
        geometry = self.geometry[int(row["geometry"])]
        pack_row = self.packs[int(geometry["pack"])]
        if row["level"] != 0 or node["end"] != row["node"] + 1 or pack_row["source_frame"] < 0:
            raise ParameterError(
                f"drawable {drawable} is simplified: only the finest levels of leaves have source faces"
            )
        shard = self._geometry_shards[int(pack_row["shard"])]
        pairs = unpack_source_faces(shard.frame(int(pack_row["source_frame"]), Kind.SOURCE_FACES))
        start = int(geometry["triangle_start"])
        parts, faces = pairs[start : start + int(geometry["triangles"])].T
        return (parts if node["part"] == NO_PART else np.full_like(parts, node["part"])), faces

    def names_of(self, node: int) -> list[str]:
        """The names of the parts that a node stands for, in the order of their first triangles; few of an inner one."""
        leaf = node
        while self.nodes["end"][leaf] != leaf + 1:
            leaf += 1
        parts, _ = self.source_faces(int(self.nodes["first_drawable"][leaf]))
        return [self.part_names[part] for part in dict.fromkeys(parts.tolist())]

    def _reader(self, record: ShardRecord) -> ShardReader:
        path = shard_path(record.name)

        def read(start: int, end: int) -> bytes:
            try:
                return self.files.read(path, start, end)
            except StoreNotFoundError as error:
                raise CorruptStoreError(
                    f"{self.files.url}/{path} is missing; copy it again or run the build again"
                ) from error

        return ShardReader(record, read)


class Store(Geometry):
    """A store opened for reading: geometry, and the vLODs of its view cells. Made by `open_store`."""

    def __init__(self, files: Files, manifest: Manifest) -> None:
        super().__init__(files, manifest.geometry)
        self.manifest = manifest
        section = manifest.cells
        self.octree: Octree | None = None
        self.cells = np.zeros(0, CELL)
        self._shard_starts = np.zeros(1, np.int64)
        if section:
            low = section["octree_lo"]
            self.octree = Octree((low[0], low[1], low[2]), section["octree_size"])
            table = self._reader(ShardRecord(*section["table"]))
            self.cells = unpack_table(table.frame(0, Kind.TABLE), CELL)
            self._codec = codec_named(section["codec"])
            self._cell_shards = [self._reader(ShardRecord(name, size)) for name, size, _ in section["shards"]]
            self._shard_starts = np.cumsum([0, *(count for _, _, count in section["shards"])])
        self._cell_cache: ByteCache[Any] = ByteCache(CELL_CACHE)

    @cached_property
    def _leaves(self) -> LeafSet:
        return LeafSet(self.cells["key"])

    @cached_property
    def _neighbours(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Offsets (n + 1,) and neighbours of all computed cells, in one list."""
        pairs, _ = neighbours(self.cells["key"])
        pairs = pairs[self.cells["computed"][pairs].all(axis=1)]
        both = np.concatenate([pairs, pairs[:, ::-1]])
        both = both[np.lexsort((both[:, 1], both[:, 0]))]
        return np.searchsorted(both[:, 0], np.arange(len(self.cells) + 1)), both[:, 1]

    def cell_at(self, points: ArrayLike) -> NDArray[np.int64]:
        """The cell (n,) int64 that holds each of the points (n, 3) in model units; -1 where nothing was computed.

        Cells are closed below and open above; the octree as a whole is closed.
        """
        if self.octree is None or not len(self.cells):
            return np.full(len(np.asarray(points).reshape(-1, 3)), -1, np.int64)
        found = self.octree.locate(points, self._leaves)
        return np.where((found >= 0) & self.cells["computed"][found], found, -1)

    def neighbours(self, cell: int) -> NDArray[np.int64]:
        """The computed cells (n,) int64 that share a face with `cell`, increasing."""
        starts, others = self._neighbours
        self._computed(cell)
        return others[starts[cell] : starts[cell + 1]]

    def vlod(self, cell: int) -> NDArray[np.int64]:
        """What can be seen from the cell: drawable ids (n,) int64, strictly increasing.

        Reads the cell's key set and the deltas on the way to it, not the whole shard. Raises NotComputedError.
        """
        self._computed(cell)

        def load() -> tuple[NDArray[np.int64], int]:
            number = int(np.searchsorted(self._shard_starts, cell, side="right")) - 1
            links = self._cell_shard(number).links
            at = cell - int(self._shard_starts[number])
            lists: list[Ids] = []
            while (parent := int(links[at]["parent"])) >= 0:
                lists.extend(self._change(number, int(links[at]["frame"]), int(links[at]["slot"])))
                at = parent
            lists.extend(self._block(number, int(links[at]["frame"]), Kind.KEY_SET))
            ids = odd_ones(lists).astype(np.int64)
            if len(ids) != self.cells[cell]["drawables"]:
                name = shard_path(self._cell_shards[number].record.name)
                raise CorruptStoreError(f"{name} is damaged: cell {cell} has {len(ids)} drawables; rebuild the store")
            ids.flags.writeable = False
            return ids, ids.nbytes

        return self._cell_cache.get(("vlod", int(cell)), load)

    def delta(self, a: int, b: int) -> Delta:
        """What changes from cell a to cell b, which share a face: ids added and dropped, strictly increasing uint32.

        Raises NotComputedError if either was not computed, ParameterError if they share no face.
        """
        self._computed(a)
        self._computed(b)
        if a > b:
            return self.delta(b, a).reversed()
        number = int(np.searchsorted(self._shard_starts, a, side="right")) - 1
        shard = self._cell_shard(number)
        run = slice(*np.searchsorted(shard.keys[:, 0], [a, a + 1]).tolist())
        at = run.start + int(np.searchsorted(shard.keys[run, 1], b))
        if at >= run.stop or shard.keys[at, 1] != b:
            raise ParameterError(f"cells {a} and {b} share no face")
        row = shard.boundaries[at]
        return self._change(number, int(row["frame"]), int(row["slot"]))

    def cut(self, cell: int) -> NDArray[np.int64]:
        """The whole model at the cell's detail, visible or not: drawable ids (n,) int64, strictly increasing."""
        row = self.cells[cell]
        angle, error = self.manifest.pixel_angle, float(row["pixel_error"])
        return choose_cut(self.nodes, self.drawables, row["lo"], row["hi"], angle, error)

    @property
    def boundary_count(self) -> int:
        """How many faces between computed cells there are."""
        return len(self._neighbours[1]) // 2

    def bytes_by_kind(self) -> dict[Kind, int]:
        """How many bytes the frames of each kind take on disk. Reads the index of every shard."""
        sizes: dict[Kind, int] = {}
        for _, record in self.manifest.shards():
            index = self._reader(record).index
            for kind in np.unique(index["kind"]).tolist():
                size = int(index["bytes"][index["kind"] == kind].sum())
                sizes[Kind(kind)] = sizes.get(Kind(kind), 0) + size
        return sizes

    def check(self) -> Iterator[Problem]:
        """Reads every byte of the store and yields what is wrong with it: nothing, for a sound store."""
        try:
            read = from_bytes(self.files.read(FILE), FILE)
            if read.version == self.manifest.version and read != self.manifest:
                yield Problem(FILE, f"{FILE} is not what it was when the store was opened")
        except StoreError as error:
            yield Problem(FILE, str(error))
        for _, record in self.manifest.shards():
            path = shard_path(record.name)
            try:
                size = self.files.size(path)
                if size is not None and size != record.bytes:
                    yield Problem(
                        path, f"{path} has {size} bytes, not {record.bytes}; copy it again or run the build again"
                    )
                    continue
                for what in self._reader(record).problems():
                    yield Problem(path, what)
            except StoreError as error:
                yield Problem(path, str(error))

    def _computed(self, cell: int) -> None:
        if not 0 <= cell < len(self.cells):
            raise NotComputedError(f"there is no cell {cell}: the store has cells 0 to {len(self.cells) - 1}")
        if not self.cells[cell]["computed"]:
            raise NotComputedError(f"cell {cell} was not computed; run `vlod build` again to finish the store")

    def _cell_shard(self, number: int) -> _CellShard:
        def load() -> tuple[_CellShard, int]:
            reader = self._cell_shards[number]
            links = unpack_table(reader.frame(1, Kind.TABLE), CELL_LINK)
            table = unpack_table(reader.frame(2, Kind.TABLE), BOUNDARY)
            keys = np.stack([table["first"] + self._shard_starts[number], table["second"]], axis=1).astype(np.int64)
            return _CellShard(links, table, keys), links.nbytes + table.nbytes + keys.nbytes

        return self._cell_cache.get(("shard", number), load)

    def _block(self, number: int, frame: int, kind: Kind) -> list[Ids]:
        """A decoded frame of key sets or deltas."""

        def load() -> tuple[list[Ids], int]:
            lists = self._codec.decode(self._cell_shards[number].frame(frame, kind))
            return lists, sum(ids.nbytes for ids in lists)

        return self._cell_cache.get((number, frame), load)

    def _change(self, number: int, frame: int, slot: int) -> Delta:
        lists = self._block(number, frame, Kind.DELTAS)
        return Delta(lists[2 * slot], lists[2 * slot + 1])


def open_store(url: str | os.PathLike[str], *, version: int | None = None) -> Store:
    """Opens a store for reading: a path, or a URL that fsspec knows (file, http, https, memory, s3, ...).

    version: an older version of it; None for the current one.
    Raises StoreNotFoundError where there is no store, CorruptStoreError where it is damaged, StoreFormatError where its
    format is unknown, StoreUnreachableError where it cannot be read, MissingDependencyError where its protocol needs a
    package that is not installed.
    """
    files = Files(url)
    path = FILE if version is None else version_path(version)
    try:
        data = files.read(path)
    except StoreNotFoundError as error:
        cause = "not a vLOD store, or its build has not finished; run `vlod build MODEL STORE`"
        if version is not None:
            cause = f"the store has no version {version}"
        raise StoreNotFoundError(f"{files.url}: no {path}: {cause}") from error
    return Store(files, from_bytes(data, f"{files.url}/{path}"))


def open_geometry(root: str | os.PathLike[str], geometry_manifest: Mapping[str, Any]) -> Geometry:
    """Opens the geometry of a store whose build is still running.

    geometry_manifest: what `storage.writer.geometry_section` gave. The result has all that `Store` has but cells.
    """
    return Geometry(Files(Path(root)), geometry_manifest)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float32]:
    """Vectors (n, 3) scaled to unit length; +z where there is no direction. Read-only."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    lengths = np.sqrt((x * x + y * y) + z * z)
    result = np.where(lengths[:, None] > 0, vectors / np.where(lengths > 0, lengths, 1)[:, None], [0.0, 0.0, 1.0])
    unit = result.astype(np.float32)
    unit.flags.writeable = False
    return unit
