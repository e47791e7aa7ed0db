"""What is left of a mesh once its vertices have moved: no triangle without area, none twice."""

from __future__ import annotations

import numpy as np

from jobs.objects.weld import is_degenerate, mix, table_size, weld
from storage.base.kernels import allocating_kernel


@allocating_kernel()
def cleaned(points: np.ndarray, triangles: np.ndarray, sided: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weld grid points (n, 3) int32; drop triangles without area and all but one of those that are equal.

    Equal means the same corners, with `sided` in the same winding too: the two sides of a sheet then both stay.
    Returns points (n', 3) int32 in order of use, triangles (m', 3) int32, and which ones they were (m',) int32.
    """
    ids, first = weld(points, np.zeros(len(points), np.int32))
    m = len(triangles)
    kept = np.empty((m, 3), np.int32)
    source = np.empty(m, np.int32)
    count = 0
    for t in range(m):
        a, b, c = ids[triangles[t, 0]], ids[triangles[t, 1]], ids[triangles[t, 2]]
        if not is_degenerate(points, first[a], first[b], first[c]):
            kept[count, 0], kept[count, 1], kept[count, 2] = a, b, c
            source[count] = t
            count += 1
    size = table_size(count)
    table = np.full(size, -1, np.int32)
    fate = np.ones(count, np.bool_)
    for t in range(count):
        a, b, c = np.int64(kept[t, 0]), np.int64(kept[t, 1]), np.int64(kept[t, 2])
        low, high = min(a, b, c), max(a, b, c)
        middle = a + b + c - low - high
        slot = mix((low << 31) ^ (middle << 15) ^ high) & (size - 1)
        while True:
            o = table[slot]
            if o < 0:
                table[slot] = t
                break
            same = True
            for e in range(3):
                v = kept[o, e]
                same = same and (v in (a, b, c))
            if same:
                even = (kept[o, 0] == a and kept[o, 1] == b) or (kept[o, 0] == b and kept[o, 1] == c)
                even = even or (kept[o, 0] == c and kept[o, 1] == a)
                if even or not sided:
                    fate[t] = False
                    break
            slot = (slot + 1) & (size - 1)
    used, left = _compacted(points, first, kept[:count], fate)
    return used, left, source[:count][fate]


@allocating_kernel()
def _compacted(
    points: np.ndarray, first: np.ndarray, triangles: np.ndarray, fate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The triangles whose `fate` is true, over just the points they use."""
    number = np.full(len(first), -1, np.int32)
    out_points = np.empty((len(first), 3), np.int32)
    out = np.empty((len(triangles), 3), np.int32)
    used = 0
    count = 0
    for t in range(len(triangles)):
        if not fate[t]:
            continue
        for e in range(3):
            v = triangles[t, e]
            if number[v] < 0:
                number[v] = used
                for i in range(3):
                    out_points[used, i] = points[first[v], i]
                used += 1
            out[count, e] = number[v]
        count += 1
    return out_points[:used].copy(), out[:count].copy()
