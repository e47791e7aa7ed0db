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
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.base.errors import NotComputedError, ParameterError
from storage.cells.deltas import Delta, difference
from storage.cells.octree import LeafSet, Octree, neighbours
from storage.check import Problem, problems
from storage.geometry_reader import Geometry
from storage.known_cells import KnownCells
from storage.model.tables import CELL, GROUP
from storage.shards.cache import ByteCache
from storage.shards.columns import unpack_table
from storage.shards.files import Files
from storage.shards.manifest import Manifest
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import Kind
from storage.versions import read_manifest
from storage.vlod_reader import VlodReader

#: Bytes of decoded cell shards' tables, sets and deltas, and of the shards' ends, that a store keeps in memory.
CELL_CACHE = 1 << 26

#: Bytes of what comes from far away that a cache on disk keeps, if nothing else is said.
CACHE_BYTES = 1 << 30


class Store(Geometry):
    """A store opened for reading: geometry, and the vLODs of its view cells. Made by `open_store`."""

    def __init__(self, files: Files, manifest: Manifest) -> None:
        section = manifest.cells
        cache: ByteCache[Any] = ByteCache(CELL_CACHE)
        shards = ShardFiles(files, cache)
        tables, *of_cells = shards.fetched([manifest.geometry.tables, *([section.table] if section else [])])
        super().__init__(files, manifest.geometry, tables)
        self.manifest = manifest
        self.octree: Octree | None = None
        #: CELL and GROUP arrays: storage.model.tables.
        self.cells, self.groups = np.zeros(0, CELL), np.zeros(0, GROUP)
        if section:
            self.octree = Octree(section.octree_lo, section.octree_size)
            self.cells = of_cells[0].decoded(0, Kind.TABLE, lambda data: unpack_table(data, CELL))
            self.groups = of_cells[0].decoded(1, Kind.TABLE, lambda data: unpack_table(data, GROUP))
        self._known = KnownCells(self.nodes, self.drawables, manifest.pixel_angle)
        self._vlods = VlodReader(shards, section.shards if section else (), self.cells, self.groups, self._known, cache)

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

        Reads the cell's group, not the whole shard. Raises NotComputedError.
        """
        self._computed(cell)
        return self._vlods.vlod(cell, int(self.cells[cell]["drawables"]))

    def delta(self, a: int, b: int) -> Delta:
        """What changes from cell a to cell b, which share a face: ids added and dropped, strictly increasing uint32.

        Raises NotComputedError if either was not computed, ParameterError if they share no face.
        """
        self._computed(a)
        self._computed(b)
        if b not in self.neighbours(a):
            raise ParameterError(f"cells {a} and {b} share no face")
        return difference(self.vlod(a).astype(np.uint32), self.vlod(b).astype(np.uint32))

    def cut(self, cell: int) -> NDArray[np.int64]:
        """The whole model at the cell's detail, visible or not: drawable ids (n,) int64, strictly increasing."""
        return self._known.cut(self.cells[cell])

    def bytes_by_kind(self) -> dict[int, int]:
        """How many bytes the frames of each kind (a `Kind`, or one that is not known) take on disk.

        Reads the index of every shard.
        """
        records = list({record.name: record for _, record in self.manifest.shards()}.values())
        sizes: dict[int, int] = {}
        for index in self._shard_files.of_each(records, lambda shard: shard.index):
            for kind, size in zip(index["kind"].tolist(), index["bytes"].tolist(), strict=True):
                sizes[kind] = sizes.get(kind, 0) + size
        return sizes

    def check(self) -> Iterator[Problem]:
        """Reads every byte of the store and yields what is wrong with it: nothing, for a sound store.

        Also what the tables say of a drawable's alpha against its mesh.
        """
        return problems(self._shard_files, self.manifest, self)

    def _computed(self, cell: int) -> None:
        if not 0 <= cell < len(self.cells):
            raise NotComputedError(f"there is no cell {cell}: the store has cells 0 to {len(self.cells) - 1}")
        if not self.cells[cell]["computed"]:
            raise NotComputedError(f"cell {cell} was not computed; run `vlod build` again to finish the store")


def open_store(
    url: str | os.PathLike[str],
    *,
    version: int | None = None,
    tell: Callable[[str], None] | None = None,
    cache_dir: Path | None = None,
    cache_bytes: int = CACHE_BYTES,
) -> Store:
    """Opens a store for reading: a path, or a URL that fsspec knows (file, http, https, memory, s3, ...).

    version: an older version of it; None for the current one; tell: waits longer for a server that does not answer, and
    hears of that: see `storage.shards.files.Files.patient`; cache_dir: a folder that keeps, for the next time, up to
    cache_bytes of what comes from far away: see `storage.shards.disk_cache`.
    Raises ParameterError if cache_dir cannot be used, StoreNotFoundError where there is no store, CorruptStoreError
    where it is damaged, StoreFormatError where its format is unknown, StoreUnreachableError where it cannot be read,
    MissingDependencyError where its protocol, or cache_dir, needs a package that is not installed.
    """
    kept = None
    if cache_dir is not None:
        from storage.shards.disk_cache import DiskCache

        kept = DiskCache(cache_dir, cache_bytes)
    files = Files(url, kept)
    with files.patient(tell) if tell is not None else nullcontext():
        return Store(files, read_manifest(files, version))
