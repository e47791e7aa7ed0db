"""Partition I: objects that are large, or long, and have many triangles are split in space.

An object is split across its longest axis, in the middle of its box; where that leaves one side with few triangles,
across the next longest axis; where all do, at the median of the longest. Connected components stay whole as long as
they are not too large themselves, so borders run through few surfaces. Triangles are never cut.

Based on: W. V. Baxter et al., GigaWalk: Interactive Walkthrough of Complex Environments, UNC TR02-013, 2002, section
4.2.1.
"""

from __future__ import annotations

import numpy as np

from jobs.objects.components import grouped
from jobs.objects.object_options import Limits
from storage.base.kernels import allocating_kernel

#: A split is unbalanced if a side has less than this part of the triangles.
BALANCE = 0.125


@allocating_kernel()
def too_much(triangles: int, lo: np.ndarray, hi: np.ndarray, limits: tuple[int, float, float, int]) -> bool:
    """Whether an object with a box lo, hi (3,) must be split; limits: triangles, diagonal, ratio, most triangles."""
    few, size, ratio, most = limits
    x, y, z = hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]
    if triangles <= few:
        return False
    return triangles > most or x * x + y * y + z * z > size * size or max(x, y, z) > ratio * min(x, y, z)


@allocating_kernel()
def divide(
    lo: np.ndarray, hi: np.ndarray, weight: np.ndarray, limits: tuple[int, float, float, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Group items with boxes lo, hi (k, 3) float64 and weight (k,) int64 triangles each until no group is too much.

    limits: see `too_much`. A group of a single item is never split. Returns the items (k,) int64 group by group, in
    each in their own order, and where the groups begin (groups + 1,) int64.
    """
    k = len(weight)
    order = np.arange(k)
    scratch = np.empty(k, np.int64)
    start = np.zeros(k + 1, np.int64)
    groups = 0
    stack = np.empty((128, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, k
    top = 1
    box_lo, box_hi = np.empty(3), np.empty(3)
    while top > 0:
        top -= 1
        first, last = stack[top, 0], stack[top, 1]
        total = 0
        box_lo[:], box_hi[:] = np.inf, -np.inf
        for i in order[first:last]:
            total += weight[i]
            for c in range(3):
                box_lo[c] = min(box_lo[c], lo[i, c])
                box_hi[c] = max(box_hi[c], hi[i, c])
        if last - first == 1 or top + 2 > len(stack) or not too_much(total, box_lo, box_hi, limits):
            groups += 1
            start[groups] = last
            continue
        axes = np.argsort(box_lo - box_hi, kind="mergesort")
        middle = -1
        for axis in axes:
            below, left = 0, first
            for i in order[first:last]:
                if lo[i, axis] + hi[i, axis] < box_lo[axis] + box_hi[axis]:
                    below += weight[i]
                    left += 1
            if min(below, total - below) >= BALANCE * total:
                halves = box_lo[axis] + box_hi[axis]
                place, other = first, left
                for i in order[first:last]:
                    if lo[i, axis] + hi[i, axis] < halves:
                        scratch[place] = i
                        place += 1
                    else:
                        scratch[other] = i
                        other += 1
                middle = left
                break
        if middle < 0:
            axis = axes[0]
            sorting = np.argsort(lo[order[first:last], axis] + hi[order[first:last], axis], kind="mergesort")
            below, middle = 0, first
            while middle < last - 1 and (middle == first or 2 * below < total):
                below += weight[order[first + sorting[middle - first]]]
                middle += 1
            left = np.sort(sorting[: middle - first])
            right = np.sort(sorting[middle - first :])
            for j in range(len(left)):
                scratch[first + j] = order[first + left[j]]
            for j in range(len(right)):
                scratch[middle + j] = order[first + right[j]]
        order[first:last] = scratch[first:last]
        stack[top, 0], stack[top, 1] = middle, last
        stack[top + 1, 0], stack[top + 1, 1] = first, middle
        top += 2
    return order, start[: groups + 1].copy()


@allocating_kernel()
def boxes(points: np.ndarray, triangles: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes lo, hi (groups, 3) float64 of groups start (groups + 1,) of triangles (m, 3) over points (n, 3)."""
    groups = len(start) - 1
    lo, hi = np.full((groups, 3), np.inf), np.full((groups, 3), -np.inf)
    for g in range(groups):
        for t in range(start[g], start[g + 1]):
            for e in range(3):
                for c in range(3):
                    p = np.float64(points[triangles[t, e], c])
                    lo[g, c] = min(lo[g, c], p)
                    hi[g, c] = max(hi[g, c], p)
    return lo, hi


def partition(
    points: np.ndarray,
    triangles: np.ndarray,
    component: np.ndarray,
    mesh: np.ndarray,
    meshes: int,
    limits: Limits,
    size: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Part the triangles of meshes into pieces.

    points (w, 3) int32 and triangles (m, 3) int32: welded; component (m,) int32 and mesh (m,) int32 of each triangle;
    size (meshes,): the largest diagonal of a piece of each mesh, in grid steps.
    Returns the triangles' order (m,) int64, and where pieces begin in it (pieces + 1,) int64: mesh after mesh.
    """
    components = int(component.max(initial=-1)) + 1
    by_component, component_start = grouped(component, components)
    component_start = component_start[np.append(np.flatnonzero(np.diff(component_start) > 0), components)]
    order, of_component = grouped(mesh[by_component[component_start[:-1]]], meshes)
    starts, ends = component_start[:-1][order], component_start[1:][order]
    lo, hi = boxes(points, np.ascontiguousarray(triangles[by_component]), component_start)
    lo, hi, weight = lo[order], hi[order], ends - starts
    parts: list[np.ndarray] = []
    for m in range(meshes):
        own = slice(int(of_component[m]), int(of_component[m + 1]))
        if own.start == own.stop:
            continue
        bounds = (limits.triangles, float(size[m]), limits.ratio, limits.most)
        items, begin = divide(lo[own], hi[own], weight[own], bounds)
        for group in np.split(items + own.start, begin[1:-1]):
            runs = [by_component[starts[c] : ends[c]] for c in group.tolist()]
            whole = np.concatenate(runs)
            c = int(group[0])
            if len(group) == 1 and too_much(len(whole), lo[c], hi[c], bounds):
                corners = points[triangles[whole]].astype(np.float64)
                inner, cuts = divide(corners.min(axis=1), corners.max(axis=1), np.ones(len(whole), np.int64), bounds)
                parts.extend(np.split(whole[inner], cuts[1:-1]))
            else:
                parts.append(whole)
    sizes = np.cumsum([0, *(len(part) for part in parts)], dtype=np.int64)
    return (np.concatenate(parts) if parts else np.zeros(0, np.int64)), sizes
