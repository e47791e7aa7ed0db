"""The oracle for one cell of a store: all of the cell's cut, read and held in portions.

Embree and its triangles take a few hundred bytes a triangle. So a cut is parted into portions; as many as fit are held,
the rest is read again whenever rays are cast. Small cuts are held whole.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jobs.checking.oracle import Oracle, distance_to
from jobs.checking.workers import Place

#: Triangles of a portion; more where one drawable has more.
PORTION = 1 << 17
#: Triangles of the portions that are held.
HELD = 1 << 19
#: Triangles that are placed at once.
AT_ONCE = 1 << 16


class CutOracle:
    """The triangles of a cell's cut, as `jobs.checking.oracle.Triangles`.

    What is drawn of a drawable d is one thing, 2 d; what is not drawn, being turned away, another: 2 d + 1.
    """

    def __init__(self, place: Place, cell: int) -> None:
        self._store, self._turned = place.store, place.turned
        row = self._store.cells[cell]
        self._cell = row["lo"], row["hi"]
        self._cut, self._vlod = self._store.cut(cell), self._store.vlod(cell)
        counts = self._store.drawables["triangles"][self._cut].astype(np.int64)
        before = np.cumsum(counts) - counts
        firsts = np.flatnonzero(np.diff(before // PORTION, prepend=-1))
        self._parts = np.split(self._cut, firsts[1:]) if len(firsts) else []
        #: Number of each portion's first triangle, and the number of all triangles.
        self._bounds = np.append(before[firsts], counts.sum())
        drawn = np.stack([counts, np.zeros_like(counts)], axis=1)
        for ids, first in zip(self._parts, firsts.tolist(), strict=True):
            away = self._away(ids)
            owner = np.repeat(np.arange(len(ids)), counts[first : first + len(ids)])
            drawn[first : first + len(ids), 1] = np.bincount(owner[away], minlength=len(ids))
        drawn[:, 0] -= drawn[:, 1]
        some = drawn.ravel() > 0
        self.things: NDArray[np.int64] = np.stack([2 * self._cut, 2 * self._cut + 1], axis=1).ravel()[some]
        self.starts: NDArray[np.int64] = np.concatenate([[0], np.cumsum(drawn.ravel()[some])])
        self.see_through: NDArray[np.bool_] = self._store.drawables["see_through"][self.things // 2]
        self._held: dict[int, Oracle] = {}

    @property
    def reported(self) -> NDArray[np.int64]:
        """(k,) the things that the cell draws, sorted."""
        return 2 * self._vlod

    def corners(self, numbers: NDArray[np.int64]) -> NDArray[np.float32]:
        """See `Triangles`."""
        corners = np.empty((len(numbers), 3, 3), np.float32)
        portions = np.searchsorted(self._bounds, numbers, side="right") - 1
        thing = np.searchsorted(self.starts, numbers, side="right") - 1
        for portion in np.unique(portions).tolist():
            wanted = np.flatnonzero(portions == portion)
            if (held := self._held.get(portion)) is not None:
                corners[wanted] = held.corners(numbers[wanted] - self._bounds[portion])
                continue
            names = self.things[thing[wanted]]
            triangles, owner = self._placed(np.unique(names // 2))
            within = numbers[wanted] - self.starts[thing[wanted]]
            corners[wanted] = triangles[np.searchsorted(owner, names) + within]
        return corners

    def cast(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """See `Triangles`."""
        found, distance = np.full(len(origins), -1, np.int64), np.full(len(origins), np.inf)
        for portion in range(len(self._parts)):
            hit, along = self._oracle(portion).cast(origins, directions)
            nearer = along < distance
            found[nearer] = hit[nearer] + self._bounds[portion]
            distance[nearer] = along[nearer]
        return found, distance

    def passed(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], until: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """See `Triangles`."""
        rays, triangles = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for portion, ids in enumerate(self._parts):
            if self._store.drawables["see_through"][ids].any():
                through, panes = self._oracle(portion).passed(origins, directions, until)
                rays.append(through)
                triangles.append(panes + self._bounds[portion])
        return np.concatenate(rays), np.concatenate(triangles)

    def confirmed(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], numbers: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """See `Triangles`."""
        rays = list(zip(origins, directions, strict=True))
        corners = self.corners(numbers)
        distances = np.array([distance_to(own, *ray) for own, ray in zip(corners, rays, strict=True)], np.float64)
        owners = self.things[np.searchsorted(self.starts, numbers, side="right") - 1].tolist()
        for portion in range(len(self._parts)):
            oracle = self._oracle(portion)
            for ray in np.flatnonzero(~np.isnan(distances)).tolist():
                if oracle.blocks(*rays[ray], float(distances[ray]), owners[ray]):
                    distances[ray] = np.nan
        return distances

    def _oracle(self, portion: int) -> Oracle:
        if portion in self._held:
            return self._held[portion]
        triangles, owner = self._placed(self._parts[portion])
        one_sided, see_through = (self._store.drawables[name][owner // 2] for name in ("one_sided", "see_through"))
        oracle = Oracle(triangles, owner, one_sided, see_through, self._cell)
        if self._bounds[portion + 1] <= HELD:
            self._held[portion] = oracle
        return oracle

    def _placed(self, ids: NDArray[np.int64]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """The triangles (m, 3, 3) of drawables of the cut, in model units, and the thing of each (m,), sorted."""
        surfaces = self._store.surfaces(ids)
        triangles = np.empty((len(surfaces.triangles), 3, 3), np.float32)
        for first in range(0, len(triangles), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            triangles[some] = surfaces.points[surfaces.triangles[some]] * self._store.grid.step
        thing = np.repeat(2 * ids, surfaces.triangle_counts) + self._away(ids)
        order = np.argsort(thing, kind="stable")
        return triangles[order], thing[order]

    def _away(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which triangles (m,) of drawables of the cut, one after the other, the cell does not draw of its vLOD."""
        seen = np.isin(ids, self._vlod, assume_unique=True)
        away = np.zeros(int(self._store.drawables["triangles"][ids].sum(dtype=np.int64)), np.bool_)
        away[np.repeat(seen, self._store.drawables["triangles"][ids])] = self._turned.of(ids[seen], *self._cell)
        return away
