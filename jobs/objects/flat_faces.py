"""Faces that lose their area on the grid: what is left out, and what is drawn one step wide.

A face whose snapped corners lie on one line is nothing to draw. Mostly its long side is a side of another face, or made
up of such sides: then nothing is lost with it. What nothing covers in that way, a wire thinner than a step or a thing
smaller than one, would vanish, however long it is and however far from all else. It is widened: a corner moves one step
beside the long side, so that no point of the face is farther than a step from where it was.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.objects.weld import degenerate_triangles
from storage.base.kernels import allocating_kernel


class Drawn(NamedTuple):
    """Triangles on the grid, and which of them are drawn."""

    points: np.ndarray  # (n, 3) int32: those that were given, and then what others were widened to
    triangles: np.ndarray  # (m, 3) int32: all that were given
    kept: np.ndarray  # (k,) int64, increasing: those that have an area now; all others lie on sides of these
    widened: np.ndarray  # (w,) int64, increasing: those of them that had none


def with_area(points: np.ndarray, triangles: np.ndarray) -> Drawn:
    """Which of triangles (m, 3) int32 over welded points (n, 3) int32 within ±2^24 are drawn, and where."""
    flat = degenerate_triangles(points, triangles)
    rows = np.flatnonzero(flat)
    if len(rows) == 0:
        return Drawn(points, triangles, np.arange(len(triangles)), rows)
    corners = triangles[rows]
    order = np.lexsort(points[corners].transpose(2, 0, 1)[::-1], axis=-1)  # along the line
    low, middle, high = np.take_along_axis(corners, order, axis=1).T
    keys, sides = np.unique([_side(low, high), _side(low, middle), _side(middle, high)], return_inverse=True)
    sides = sides.reshape(3, -1).T
    solid = triangles[~flat]
    of_solid = np.concatenate([_side(solid[:, e], solid[:, (e + 1) % 3]) for e in range(3)])
    covered = _cover(sides, np.isin(keys, of_solid) | (keys >> 32 == keys & 0xFFFFFFFF))
    point = low == high
    covered[point] = np.isin(low[point], np.concatenate([solid.reshape(-1), corners[~point].reshape(-1)]))
    alone = np.flatnonzero(~covered)
    alone = np.sort(alone[np.unique(sides[alone, 0], return_index=True)[1]])  # one of those with the same long side
    beside = _beside(points[low[alone]], points[high[alone]])
    added = np.ones((len(alone), 2), np.bool_)
    added[:, 1] = point[alone]
    wider = triangles.copy()
    number = len(points) + np.cumsum(added).reshape(-1, 2) - 1
    for slot in range(2):
        those = np.flatnonzero(added[:, slot])
        wider[rows[alone[those]], order[alone[those], 1 + slot]] = number[those, slot]
    flat[rows[alone]] = False
    return Drawn(np.concatenate([points, beside[added]]), wider, np.flatnonzero(~flat), rows[alone])


def _side(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """A number (k,) int64 for each pair of vertices (k,), whichever comes first."""
    return (np.minimum(a, b).astype(np.int64) << 32) | np.maximum(a, b)


@allocating_kernel()
def _cover(sides: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Which flat triangles lie on sides that are covered: (f,) bool.

    sides (f, 3) int64: the long side of each, and the two that it is made up of; covered (s,) bool: which sides are,
    to begin with. A triangle is if its long side is, or both of the others; then all three are.
    """
    uses = np.zeros(len(covered) + 1, np.int64)
    for t in range(len(sides)):
        for e in range(3):
            uses[sides[t, e] + 1] += 1
    for s in range(len(covered)):
        uses[s + 1] += uses[s]
    user = np.empty(3 * len(sides), np.int64)
    place = uses.copy()
    for t in range(len(sides)):
        for e in range(3):
            user[place[sides[t, e]]] = t
            place[sides[t, e]] += 1
    covered = covered.copy()
    found = np.zeros(len(sides), np.bool_)
    todo = np.empty(len(sides) + len(user), np.int64)
    todo[: len(sides)] = np.arange(len(sides))
    count = len(sides)
    while count > 0:
        count -= 1
        t = todo[count]
        if found[t] or not (covered[sides[t, 0]] or (covered[sides[t, 1]] and covered[sides[t, 2]])):
            continue
        found[t] = True
        for e in range(3):
            side = sides[t, e]
            if not covered[side]:
                covered[side] = True
                for i in range(uses[side], uses[side + 1]):
                    todo[count] = user[i]
                    count += 1
    return found


def _beside(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Two points each (k, 2, 3) int32 one step beside `low` (k, 3), the first of them off the way to `high` (k, 3)."""
    across = np.abs(high.astype(np.int64) - low).argmin(axis=1)
    beside = np.repeat(low[:, None], 2, axis=1)
    for slot in range(2):
        axis = (across + slot) % 3
        at = np.take_along_axis(low, axis[:, None], axis=1)[:, 0]
        np.put_along_axis(beside[:, slot], axis[:, None], (at - np.where(at > 0, 1, -1))[:, None], axis=1)
    return beside.astype(np.int32)
