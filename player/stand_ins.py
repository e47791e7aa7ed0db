"""Which level to draw of a node whose chosen level has not arrived yet: never a stall, hardly ever a hole."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from player.scene import Scene

Ids = NDArray[np.int64]


class StandIns(NamedTuple):
    """What can be drawn now."""

    drawables: Ids  # sorted ids
    replaced: int  # nodes drawn at another level than chosen
    absent: int  # nodes of which nothing has arrived


def stand_ins(ids: Ids, scene: Scene, ready: Callable[[Ids], NDArray[np.bool_]]) -> StandIns:
    """For sorted drawable `ids`: themselves where they are ready, else the next coarser level of their node that is,
    else the next finer one, else nothing.

    ready: says for drawable ids (n,) which can be drawn now (n,).
    """
    there = ready(ids)
    if there.all():
        return StandIns(ids, 0, 0)
    missing = ids[~there]
    node = scene.node_of[missing]
    first, last = scene.first_drawable[node], scene.first_drawable[node] + scene.levels[node] - 1
    found = np.full(len(missing), -1, np.int64)
    most = int(scene.levels[node].max())
    for offset in [*range(1, most), *range(-1, -most, -1)]:
        candidate = missing + offset
        fits = (found < 0) & (candidate >= first) & (candidate <= last)
        fits[fits] = ready(candidate[fits])
        found[fits] = candidate[fits]
    usable = found[found >= 0]
    return StandIns(np.union1d(ids[there], usable), len(usable), len(missing) - len(usable))
