"""Reading the geometry of a store: its tables, meshes and facets, and what they were in the model.

Needs no more of a manifest than its section on geometry, so that a build reads what it wrote before there are cells.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.base.errors import ParameterError, StoreError
from storage.meshes.facets import CONE, part_meshes
from storage.meshes.mesh import LocalMesh, Mesh, Surfaces, in_model_space
from storage.meshes.pack import MeshArrays, Pack, unpack, unpack_source_faces
from storage.meshes.placement import IDENTITY, normal_matrix, placed
from storage.meshes.turned_away import Facets
from storage.model.tables import DRAWABLE, GEOMETRY, INSTANCE, NO_PART, NODE, PACK, PART, Grid
from storage.shards.cache import ByteCache
from storage.shards.columns import unpack_names, unpack_table
from storage.shards.files import Files
from storage.shards.sections import GeometrySection
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import Kind, ShardReader

#: Bytes of decoded packs, and of the ends of their shards, that a store keeps in memory.
GEOMETRY_CACHE = 1 << 28

#: Drawables that `Geometry.surfaces` places at once.
SURFACES_AT_ONCE = 4096


class Geometry:
    """The geometry of a store: its tables and meshes. `Store` adds cells.

    Every method raises CorruptStoreError, which names the shard, where bytes are missing or changed, and
    StoreUnreachableError where they cannot be read.
    """

    def __init__(self, files: Files, section: GeometrySection, tables: ShardReader) -> None:
        """tables: the reader of `section.tables`, all of which is read."""
        self.files = files
        self.grid = Grid(section.grid_step)
        self._cache: ByteCache[Any] = ByteCache(GEOMETRY_CACHE)
        self._shard_files = ShardFiles(files, self._cache)
        self._shards = section.shards
        dtypes = (PART, INSTANCE, GEOMETRY, PACK, NODE, DRAWABLE)
        loaded = [_table(tables, frame, dtype) for frame, dtype in enumerate(dtypes)]
        #: PART, INSTANCE, GEOMETRY, PACK, NODE and DRAWABLE arrays: storage.model.tables.
        self.parts, self.instances, self.geometry, self.packs, self.nodes, self.drawables = loaded
        #: The name of each part.
        self.part_names = tables.decoded(len(dtypes), Kind.NAMES, unpack_names)

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
        return self._pack(number, None)

    def fetch(self, packs: Sequence[int]) -> None:
        """Reads and decodes `packs` in as few requests as may be, so that `pack` finds them in memory.

        Raises nothing of what cannot be had: `pack` does.
        """
        rows = self.packs[np.asarray(packs, np.int64)]
        places = zip(rows["shard"].tolist(), rows["frame"].tolist(), strict=True)
        found = self._shard_files.frames([(self._shards[shard], frame, Kind.GEOMETRY) for shard, frame in places])
        for number, data in zip(packs, found, strict=True):
            if data is not None:
                with suppress(StoreError):
                    self._pack(number, data)

    def _pack(self, number: int, data: bytes | None) -> Pack:
        """A decoded pack; data: its frame, None where it is to be read."""

        def load() -> tuple[Pack, int]:
            row = self.packs[number]
            shard = self._shard_files.reader(self._shards[int(row["shard"])])
            decoded = shard.decoded(int(row["frame"]), Kind.GEOMETRY, unpack, data)
            if len(decoded.positions) != row["vertices"] or len(decoded.triangles) != row["triangles"]:
                raise shard.corrupt(f"pack {number} is not of the size that the tables say")
            return decoded, decoded.bytes

        pack: Pack = self._cache.get(("pack", int(number)), load)
        return pack

    def local_mesh(self, geometry: int) -> LocalMesh:
        """The mesh of row `geometry` of the GEOMETRY table, in its local coordinates."""
        row = self.geometry[geometry]
        decoded = self.pack(int(row["pack"]))
        vertices = slice(int(row["vertex_start"]), int(row["vertex_start"]) + int(row["vertices"]))
        triangles = slice(int(row["triangle_start"]), int(row["triangle_start"]) + int(row["triangles"]))
        return LocalMesh(
            decoded.positions[vertices],
            decoded.triangles[triangles],
            decoded.folded[vertices],
            decoded.colours[vertices],
            float(row["scale"]),
        )

    def packed_mesh(self, geometry: int) -> MeshArrays:
        """The mesh of row `geometry` of the GEOMETRY table as it was packed, source faces and all."""
        row = self.geometry[geometry]
        faces = self._faces(row) if self.packs["source_frame"][int(row["pack"])] >= 0 else None
        local = self.local_mesh(geometry)
        return MeshArrays(local.positions, local.triangles, local.normals, local.colours, faces, local.scale)

    def mesh(self, drawable: int) -> Mesh:
        """A drawable's triangles in model space.

        Positions are exact integer multiples of grid.step; of instances they are snapped to it. The normals of
        instances are turned by the inverse transpose of their matrix, and the winding of mirrored ones is reversed.
        """
        row = self.drawables[drawable]
        matrix = None if row["instance"] < 0 else self.instances[int(row["instance"])]["matrix"]
        return in_model_space(self.local_mesh(int(row["geometry"])), matrix, self.grid.step)

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
        coarser = self.packs["source_frame"][int(geometry["pack"])] < 0
        if row["level"] != 0 or node["end"] != row["node"] + 1 or coarser:
            raise ParameterError(
                f"drawable {drawable} is simplified: only the finest levels of leaves have source faces"
            )
        parts, faces = self._faces(geometry).T
        return (parts if node["part"] == NO_PART else np.full_like(parts, node["part"])), faces

    def _faces(self, row: np.void) -> NDArray[np.uint32]:
        """Part and face (m, 2) of each triangle of a row of the GEOMETRY table, whose pack holds them."""

        def load() -> tuple[NDArray[np.uint32], int]:
            pack_row = self.packs[number]
            shard = self._shard_files.reader(self._shards[int(pack_row["shard"])])
            decoded = shard.decoded(int(pack_row["source_frame"]), Kind.SOURCE_FACES, unpack_source_faces)
            return decoded, decoded.nbytes

        number = int(row["pack"])
        pairs: NDArray[np.uint32] = self._cache.get(("source faces", number), load)
        start = int(row["triangle_start"])
        return pairs[start : start + int(row["triangles"])]

    def names_of(self, node: int) -> list[str]:
        """The names of the parts that a node stands for, in the order of their first triangles; few of an inner one."""
        leaf = node
        while self.nodes["end"][leaf] != leaf + 1:
            leaf += 1
        parts, _ = self.source_faces(int(self.nodes["first_drawable"][leaf]))
        return [self.part_names[part] for part in dict.fromkeys(parts.tolist())]


def open_geometry(root: str | os.PathLike[str], section: GeometrySection) -> Geometry:
    """Opens the geometry of a store whose build is still running.

    section: what `storage.geometry_writer.geometry_section` gave. The result has all that `Store` has but cells.
    """
    files = Files(Path(root))
    (tables,) = ShardFiles(files, ByteCache(0)).fetched([section.tables])
    return Geometry(files, section, tables)


def _table(shard: ShardReader, frame: int, dtype: np.dtype) -> np.ndarray:
    return shard.decoded(frame, Kind.TABLE, lambda data: unpack_table(data, dtype))
