"""Which facets of drawables show a view cell only their backs: the player leaves them out, and cells count them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.meshes.facets import find_turned_away


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
    """Which facets of some drawables show a cell only their backs."""

    away: NDArray[np.bool_]  # (f,) facets, one drawable after the other, in the order of their triangles
    triangles: NDArray[np.int64]  # (f,) triangles of each
    starts: NDArray[np.int64]  # (k,) each drawable's first facet

    @property
    def triangle_counts(self) -> NDArray[np.int64]:
        """(k,) triangles of each drawable that are left out."""
        left_out = np.where(self.away, self.triangles, 0)
        return np.add.reduceat(left_out, self.starts) if len(self.starts) else left_out
