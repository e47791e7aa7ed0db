"""Checking a store: every byte of it against its checksums, and what is said to be see-through against its alpha."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from storage.base.errors import CURE, StoreError
from storage.geometry_reader import Geometry
from storage.shards.manifest import FILE, Manifest, from_bytes
from storage.shards.shard_files import ShardFiles
from storage.shards.shards import ShardRecord, shard_path

#: The alpha of what cannot be seen through.
OPAQUE = 255


class Problem(NamedTuple):
    """Something found wrong."""

    file: str  # path inside the store
    what: str  # one line

    def __str__(self) -> str:
        return self.what


def problems(shards: ShardFiles, manifest: Manifest, geometry: Geometry) -> Iterator[Problem]:
    """Reads every byte of a store and yields what is wrong with it: nothing, for a sound store.

    manifest, geometry: as they were when the store was opened.
    """
    place = f"{shards.files.url}/{FILE}"
    try:
        read = from_bytes(shards.files.read(FILE), place)
        if read.version == manifest.version and read != manifest:
            yield Problem(FILE, f"{place} is not what it was when the store was opened")
    except StoreError as error:
        yield Problem(FILE, str(error))
    for record in {record.name: record for _, record in manifest.shards()}.values():
        found = list(problems_of_shard(shards, record))
        yield from found or problems_of_alpha(geometry, manifest, record)


def problems_of_shard(shards: ShardFiles, record: ShardRecord) -> Iterator[Problem]:
    """Reads every byte of one shard and yields what is wrong with it. Holds one shard in memory."""
    path = shard_path(record.name)
    try:
        size = shards.files.size(path)
        if size is not None and size != record.bytes:
            yield Problem(path, f"{shards.files.url}/{path} has {size} bytes, not {record.bytes}; {CURE}")
            return
        for what in shards.reader(record).problems():
            yield Problem(path, what)
    except StoreError as error:
        yield Problem(path, str(error))


def problems_of_alpha(geometry: Geometry, manifest: Manifest, record: ShardRecord) -> Iterator[Problem]:
    """Reads the meshes of one shard and yields the drawables that are not what their `see_through` says.

    A drawable can be seen through where the alpha of all its vertices is below 255; of all others all have 255. Nothing
    is yielded for a shard that holds no meshes. Holds one pack in memory, and what the geometry keeps.
    """
    names = [shard.name for shard in manifest.geometry.shards]
    if record.name not in names:
        return
    path = shard_path(manifest.geometry.tables.name)
    packs = np.flatnonzero(geometry.packs["shard"] == names.index(record.name))
    if not len(packs):
        return
    try:
        low, high = _alphas(geometry, packs)
    except StoreError as error:
        yield Problem(shard_path(record.name), str(error))
        return
    rows = geometry.drawables
    of = rows["geometry"]
    clear = rows["see_through"]
    wrong = np.flatnonzero((low[of] <= high[of]) & np.where(clear, high[of] == OPAQUE, low[of] < OPAQUE))
    if len(wrong):
        first = int(wrong[0])
        least, most = int(low[of[first]]), int(high[of[first]])
        can = "can" if clear[first] else "cannot"
        others = f" (and {len(wrong) - 1:,} more like it)" if len(wrong) > 1 else ""
        yield Problem(
            path,
            f"{geometry.files.url}/{path}: drawable {first}{others} is said to be one that {can} be seen through, but "
            f"the alpha of its vertices is {least} to {most}; {CURE}",
        )


def _alphas(geometry: Geometry, packs: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The least and the greatest alpha (geometries,) of the meshes in some packs; 255 and 0 of all others."""
    rows = geometry.geometry
    low, high = np.full(len(rows), OPAQUE, np.uint8), np.zeros(len(rows), np.uint8)
    filled = np.flatnonzero(np.isin(rows["pack"], packs) & (rows["vertices"] > 0))
    filled = filled[np.lexsort((rows["vertex_start"][filled], rows["pack"][filled]))]
    of_pack = np.split(filled, np.searchsorted(rows["pack"][filled], packs[1:]))
    for number, own in zip(packs.tolist(), of_pack, strict=True):
        if not len(own):
            continue
        alpha = geometry.pack(number).colours[:, 3]
        low[own] = np.minimum.reduceat(alpha, rows["vertex_start"][own])
        high[own] = np.maximum.reduceat(alpha, rows["vertex_start"][own])
    return low, high
