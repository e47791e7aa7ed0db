"""What to draw of a node whose chosen level has not arrived yet: never a stall, hardly ever a hole."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from player.shown_model import ShownModel

Ids = NDArray[np.int64]


class StandIns(NamedTuple):
    """What can be drawn now."""

    drawables: Ids  # sorted ids
    replaced: int  # nodes drawn at another level than chosen, or by a node above them
    absent: int  # nodes of which nothing has arrived


def stand_ins(ids: Ids, model: ShownModel, ready: Callable[[Ids], NDArray[np.bool_]]) -> StandIns:
    """For sorted drawable `ids`: themselves where they are ready, else what is ready and nearest to them in detail.

    That is the next coarser level of their node, else the finest one of the nearest node above it, else the next finer
    level of their own, else nothing. A node above also covers neighbours that are drawn themselves: for the moment that
    it takes, both are seen.
    ready: says for drawable ids (n,) which can be drawn now (n,).
    """
    there = ready(ids)
    if there.all():
        return StandIns(ids, 0, 0)
    missing = ids[~there]
    node = model.nodes_of(missing)
    found = np.full(len(missing), -1, np.int64)

    def look(nodes: Ids, first: Ids, last: Ids, step: int) -> None:
        """Takes the first drawable that is ready from `first` to `last` of `nodes`, -1 for none."""
        candidate = first.copy()
        while True:
            fits = (found < 0) & (nodes >= 0) & (candidate * step <= last * step)
            if not fits.any():
                return
            which = np.flatnonzero(fits)
            good = which[ready(candidate[which])]
            found[good] = candidate[good]
            candidate += step

    look(node, missing + 1, model.first_drawable[node] + model.levels[node] - 1, 1)
    above = model.parent[node]
    while ((above >= 0) & (found < 0)).any():
        first = model.first_drawable[above]
        look(above, first, first + model.levels[above] - 1, 1)
        above = np.where(above >= 0, model.parent[above], -1)
    look(node, missing - 1, model.first_drawable[node], -1)
    usable = found[found >= 0]
    return StandIns(np.union1d(ids[there], usable), len(usable), len(missing) - len(usable))
