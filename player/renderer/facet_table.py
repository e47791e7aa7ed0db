"""The facets of the meshes on the GPU: runs of their triangles that are left out where a view cell sees only backs.

Based on: J. Chhugani et al.: vLOD, IEEE TVCG 11(1), 2005, section 5.1; see storage.meshes.facets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from player.renderer.free_list import FreeList
from storage.meshes.facets import CONE, find_turned_away


class CellBox(NamedTuple):
    """The view cell that holds the eye, in model units."""

    lo: NDArray[np.float64]  # (3,)
    hi: NDArray[np.float64]


class Runs(NamedTuple):
    """What to draw of some drawables."""

    drawable: NDArray[np.int64]  # (n,) positions among the drawables asked about, not decreasing
    first: NDArray[np.int64]  # (n,) first index of the run, counted from the mesh's first
    indices: NDArray[np.int64]  # (n,) three for each triangle


class PackFacets(NamedTuple):
    """The facets of a pack's meshes, one mesh after the other: storage.meshes.facets."""

    counts: NDArray[np.int64]  # (k,) facets of each mesh
    triangles: NDArray[np.int64]  # (f,) triangles of each facet
    cones: NDArray[np.float64]  # (f, CONE)


@dataclass(frozen=True, eq=False)
class FacetUsers:
    """Where drawables are that show facets; arrays as long as the store's tables."""

    geometry: NDArray[np.int64]  # (drawables,) index of the mesh
    instance: NDArray[np.int32]  # (drawables,) row of `matrices`, -1: in model space
    scale: NDArray[np.float64]  # (geometries,) local units per step of the positions
    matrices: NDArray[np.float64]  # (n, 3, 4) placements
    step: float  # model units per grid unit


class FacetTable:
    """Facets of the meshes on the GPU, in arrays that grow."""

    def __init__(self, meshes: int) -> None:
        """meshes: number of meshes in the store."""
        self.first = np.full(meshes, -1, np.int64)  # row of each mesh's first facet, -1 where the mesh is absent
        self.count = np.zeros(meshes, np.int64)  # rows of each mesh
        self.triangles = np.zeros(0, np.int64)  # (rows,) of each facet
        self.cones = np.zeros((0, CONE))  # (rows, CONE) storage.meshes.facets
        self._free = FreeList(0)
        self._packs: dict[int, tuple[int, int, NDArray[np.int64]]] = {}

    def add(self, pack: int, meshes: NDArray[np.int64], facets: PackFacets) -> None:
        """Takes a pack's facets; meshes (k,): which of the store's it holds."""
        size = len(facets.triangles)
        row = self._free.allocate(size) if size else 0
        while row is None:
            larger = max(1024, 2 * self._free.capacity)
            self._free.grow(larger)
            self.triangles = np.concatenate([self.triangles, np.zeros(larger - len(self.triangles), np.int64)])
            self.cones = np.concatenate([self.cones, np.zeros((larger - len(self.cones), CONE))])
            row = self._free.allocate(size)
        self.triangles[row : row + size], self.cones[row : row + size] = facets.triangles, facets.cones
        self.first[meshes] = row + np.cumsum(facets.counts) - facets.counts
        self.count[meshes] = facets.counts
        self._packs[pack] = row, size, meshes

    def remove(self, pack: int) -> None:
        """Frees the rows of a pack."""
        row, size, meshes = self._packs.pop(pack)
        self._free.release(row, size)
        self.first[meshes] = -1

    def runs_of(self, ids: NDArray[np.int64], users: FacetUsers, cell: CellBox) -> Runs:
        """What of drawables `ids` (d,), whose meshes must be there, the cell may see the front of.

        Facets that lie side by side are one run. A drawable may be left out as a whole.
        """
        mesh = users.geometry[ids]
        first, count = self.first[mesh], self.count[mesh]
        away = find_turned_away(
            first, count, users.instance[ids].astype(np.int64), users.scale[mesh], self.cones, users.matrices,
            users.step, cell.lo, cell.hi,
        )  # fmt: skip
        starts = np.cumsum(count) - count
        owner = np.repeat(np.arange(len(ids)), count)
        triangles = self.triangles[(first - starts)[owner] + np.arange(len(away))]
        ahead = np.cumsum(triangles) - triangles
        ahead -= ahead[starts][owner] if len(ids) else ahead
        shown = np.flatnonzero(~away & (triangles > 0))
        begins = np.flatnonzero((np.diff(shown, prepend=-2) != 1) | (np.diff(owner[shown], prepend=-1) != 0))
        indices = np.add.reduceat(triangles[shown], begins) if len(begins) else begins
        return Runs(owner[shown[begins]], 3 * ahead[shown[begins]], 3 * indices)
