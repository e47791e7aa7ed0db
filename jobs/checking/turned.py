"""Which triangles of a cell's vLOD are not drawn, because they lie in facets that show the cell only their backs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.geometry_reader import Geometry
from storage.meshes.facets import part_meshes
from storage.meshes.turned_away import Facets
from storage.shards.cache import ByteCache

#: Bytes of meshes' partings into facets that are kept for the next cell.
PARTED_CACHE = 1 << 25


class _Parted(NamedTuple):
    """A mesh, parted."""

    order: NDArray[np.int64]  # (m,) its triangles, those of a facet one after the other
    sizes: NDArray[np.int64]  # (f,) triangles of each facet
    cones: NDArray[np.float64]  # (f, CONE) storage.meshes.facets


class TurnedTriangles:
    """Finds what a store's cells do not draw. Parts each mesh once for many cells, as long as there is room."""

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        self._matrices = geometry.instances["matrix"].copy()
        self._parted: ByteCache[_Parted] = ByteCache(PARTED_CACHE)

    def of(self, drawables: NDArray[np.int64], lo: ArrayLike, hi: ArrayLike) -> NDArray[np.bool_]:
        """Which triangles (m,) of drawables (d,), sorted ids, one after the other, are turned away from a cell.

        In the order of `storage.geometry_reader.Geometry.surfaces`. lo, hi (3,): the cell, in model units.
        """
        rows = self._geometry.drawables[drawables]
        used, which = np.unique(rows["geometry"], return_inverse=True)
        parted = [self._mesh(number) for number in used.tolist()]
        if not parted:
            return np.zeros(0, np.bool_)
        count = np.array([len(mesh.sizes) for mesh in parted], np.int64)
        facets = Facets(
            drawables,
            (np.cumsum(count) - count)[which],
            count[which],
            rows["instance"].astype(np.int64),
            self._geometry.geometry["scale"][used][which].astype(np.float64),
            np.concatenate([mesh.sizes for mesh in parted]),
            np.concatenate([mesh.cones for mesh in parted]),
            self._matrices,
            self._geometry.grid.step,
        )
        found = facets.turned_away(drawables, lo, hi)
        by_facets = np.repeat(found.away, found.triangles)
        starts = np.cumsum(rows["triangles"], dtype=np.int64) - rows["triangles"]
        order = np.concatenate([parted[mesh].order for mesh in which.tolist()])
        away = np.empty(len(order), np.bool_)
        away[order + np.repeat(starts, rows["triangles"])] = by_facets
        return away

    def _mesh(self, number: int) -> _Parted:
        def load() -> tuple[_Parted, int]:
            mesh = self._geometry.local_mesh(number)
            order, _, sizes, cones = part_meshes(
                mesh.positions, mesh.triangles, np.array([len(mesh.positions)]), np.array([len(mesh.triangles)]),
                self._geometry.one_sided[number : number + 1],
            )  # fmt: skip
            parted = _Parted(order.astype(np.int32), sizes, cones)
            return parted, sum(array.nbytes for array in parted)

        return self._parted.get(number, load)
