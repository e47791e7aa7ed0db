"""Which drawables reach into a cell: seen from there beyond doubt, whatever else there is."""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel, kernel


@allocating_kernel()
def reaching_into(
    vertices: np.ndarray, triangles: np.ndarray, first: np.ndarray, chosen: np.ndarray, lo: np.ndarray, hi: np.ndarray
) -> np.ndarray:
    """Which of some drawables have a vertex inside a box, not on its faces.

    Args:
        vertices: (n, 3) int32 grid units; triangles: (m, 3) int32.
        first: (drawables + 1,) int32 offsets of the drawables' triangles.
        chosen: (c,) int64 drawables.
        lo, hi: (3,) float64 the box in grid units.

    Returns:
        (c,) bool.
    """
    reaching = np.zeros(len(chosen), np.bool_)
    for place in range(len(chosen)):
        begin, end = first[chosen[place]], first[chosen[place] + 1]
        reaching[place] = _any_inside(vertices, triangles, begin, end, lo, hi)
    return reaching


@kernel(inline="always")
def _any_inside(
    vertices: np.ndarray, triangles: np.ndarray, begin: int, end: int, lo: np.ndarray, hi: np.ndarray
) -> bool:
    """Whether any corner of triangles begin ... end - 1 is inside."""
    for t in range(begin, end):
        for i in range(3):
            v, inside = triangles[t, i], True
            for k in range(3):
                inside &= lo[k] < vertices[v, k] < hi[k]
            if inside:
                return True
    return False
