"""Packs on their way from the store to the GPU: decoded, made into vertices, uploaded, evicted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from player.loading.pack_cache import PackCache
from player.loading.prefetch import Loader
from player.renderer.arena import INDEX_BYTES, VERTEX, Arena
from player.renderer.facet_table import FacetTable, PackFacets
from storage.base.errors import CorruptStoreError, StoreError
from storage.meshes.facets import part_meshes
from storage.meshes.pack import Pack
from storage.store import Store


class PreparedPack(NamedTuple):
    """A pack as the arena and the table of facets take it."""

    vertices: np.ndarray  # VERTEX (n,)
    triangles: NDArray[np.uint32]  # (m, 3), counting vertices from the pack's first
    facets: PackFacets


def prepare(pack: Pack, rows: np.ndarray, one_sided: NDArray[np.bool_], step: float) -> PreparedPack:
    """Vertices in grid units, pack-wide indices in the order of the facets, and the facets, of a decoded pack.

    rows: its GEOMETRY rows in the order of their vertices; one_sided: of which only fronts count; step: model units per
    grid unit. Scales and step are powers of two, so meshes that lie in model space keep their whole-numbered grid
    coordinates exactly.
    """
    vertices = np.zeros(len(pack.positions), VERTEX)
    scale = np.repeat(rows["scale"] / step, rows["vertices"])
    vertices["position"] = pack.positions * scale[:, None]
    vertices["normal"] = pack.folded
    vertices["colour"] = pack.colours
    triangles = pack.triangles + np.repeat(rows["vertex_start"], rows["triangles"])[:, None]
    order, counts, facets, cones = part_meshes(
        pack.positions, pack.triangles, rows["vertices"].astype(np.int64), rows["triangles"].astype(np.int64), one_sided
    )
    return PreparedPack(vertices, triangles.astype(np.uint32)[order], PackFacets(counts, facets, cones))


def packs_of(store: Store) -> NDArray[np.int64]:
    """The pack (drawables,) that holds each drawable's mesh."""
    return store.geometry["pack"][store.drawables["geometry"]].astype(np.int64)


class Packs:
    """Keeps the packs on the GPU that are drawn, and those that may be drawn soon, within a budget."""

    def __init__(self, store: Store, arena: Arena, facets: FacetTable, *, budget: int, threads: int) -> None:
        """budget: bytes of vertices and indices on the GPU; threads: how many load at a time."""
        self._store = store
        self._arena = arena
        self._facets = facets
        of_mesh = store.geometry["pack"]
        self._meshes = np.lexsort((store.geometry["vertex_start"], of_mesh))  # pack by pack
        self._starts = np.searchsorted(of_mesh, np.arange(len(store.packs) + 1), sorter=self._meshes)
        self._sizes = store.packs["vertices"].astype(np.int64) * VERTEX.itemsize
        self._sizes += store.packs["triangles"].astype(np.int64) * 3 * INDEX_BYTES
        self.cache = PackCache(self._sizes, budget)
        self._loader: Loader[int, PreparedPack] = Loader(
            self._load,
            threads,
            fetch=None if store.files.near else store.fetch,  # threads wait for a folder no longer than for one request
        )
        self._base = np.zeros(0, np.int64)
        self._ahead = np.zeros(0, np.int64)
        self._ahead_changed = False

    def need(self, packs: NDArray[np.int64], *, wait: bool) -> None:
        """Locks `packs` (unique, most urgent first), uploads what has arrived, and asks for the rest.

        wait: returns only when all of them are on the GPU, but for what cannot be read. Afterwards `cache.resident`
        says what is there, and `failures` why the rest is not.
        """
        self.cache.lock(packs)
        arrived = self._loader.collect()
        missing = [int(p) for p in packs[~self.cache.resident[packs]] if int(p) not in arrived]
        if missing or self._ahead_changed:
            self._loader.wish([*missing, *(p for p in self._later() if p not in arrived)])
            self._ahead_changed = False
        if wait and missing:
            arrived |= self._loader.wait_for(missing)
        self._upload(arrived)

    def failures(self, packs: NDArray[np.int64]) -> list[StoreError]:
        """Why those of `packs` (n,) are not there that cannot be had for now; they are tried again."""
        there = self.cache.resident[packs]
        return [] if there.all() else list(self._loader.failures(packs[~there].tolist()).values())

    @property
    def damage(self) -> CorruptStoreError | None:
        """Some damage that was met, be it in what was only loaded ahead; None if there is none."""
        return self._loader.damage

    def prefetch(self, packs: NDArray[np.int64]) -> None:
        """Asks for `packs` (unique, most urgent first), as many as the budget has room for beside what is drawn."""
        fits = np.cumsum(self._sizes[packs]) <= self.cache.room()
        self._ahead = packs[fits]
        self.cache.touch(self._ahead)
        self._ahead_changed = True

    def keep(self, packs: NDArray[np.int64]) -> None:
        """Loads `packs` before all that is prefetched, and never evicts them."""
        self.cache.keep(packs)
        self._base = packs
        self._ahead_changed = True

    def await_base(self, seconds: float) -> None:
        """Waits until what is kept is on the GPU, but for what cannot be read, and not longer than `seconds`."""
        missing = self._base[~self.cache.resident[self._base]].tolist()
        if missing:
            self._loader.wish(missing)
            self._upload(self._loader.wait_for(missing, seconds))
            self._ahead_changed = True

    def bytes_of(self, packs: NDArray[np.int64]) -> int:
        """Bytes that these packs take on the GPU."""
        return int(self._sizes[packs].sum())

    def settle(self) -> None:
        """Waits until everything asked for is on the GPU, but for what cannot be read."""
        later = self._later()
        self._loader.wish(later)
        self._upload(self._loader.wait_for(later))
        self._ahead_changed = False

    @property
    def pending(self) -> int:
        """How many packs are still to come."""
        return self._loader.pending

    def close(self) -> None:
        """Stops the loading threads."""
        self._loader.close()

    def _later(self) -> list[int]:
        """Packs that are wanted but not drawn now, and not on the GPU yet."""
        return [
            *self._base[~self.cache.resident[self._base]].tolist(),
            *self._ahead[~self.cache.resident[self._ahead]].tolist(),
        ]

    def _load(self, number: int) -> PreparedPack:
        store, own = self._store, self._own(number)
        return prepare(store.pack(number), store.geometry[own], store.one_sided[own], store.grid.step)

    def _own(self, number: int) -> NDArray[np.int64]:
        """A pack's meshes, in the order of their vertices."""
        return self._meshes[self._starts[number] : self._starts[number + 1]]

    def _upload(self, arrived: dict[int, PreparedPack]) -> None:
        for number in sorted(arrived):  # not in the order of arrival, which no two runs share
            pack = arrived[number]
            self.cache.add(number)
            self._arena.add(number, pack.vertices, pack.triangles)
            self._facets.add(number, self._own(number), pack.facets)
        for number in self.cache.evict().tolist():
            self._arena.remove(number)
            self._facets.remove(number)
