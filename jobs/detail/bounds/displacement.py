"""Positions snapped to the grid, and how far that moves them.

A triangle's points move no farther than its corners, and the moved triangle lies nowhere else: the largest displacement
of a corner bounds the two-sided Hausdorff distance.
"""

from __future__ import annotations

import numpy as np

from storage.base.kernels import allocating_kernel


@allocating_kernel()
def snapped(positions: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grid coordinates (n, 3) int32 of positions (n, 3) float64, and the displacements (n,) float64 in grid steps.

    scale (n,): local units per step, powers of two, so that dividing by them is exact.
    """
    grid = np.empty(positions.shape, np.int32)
    displacement = np.empty(len(positions))
    for v in range(len(positions)):
        total = 0.0
        for i in range(3):
            exact = positions[v, i] / scale[v]
            whole = np.rint(exact)
            grid[v, i] = np.int32(whole)
            total += (exact - whole) * (exact - whole)
        displacement[v] = np.sqrt(total)
    return grid, displacement


@allocating_kernel()
def group_maximum(values: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The largest of the non-negative values (n,) in each group start (groups + 1,): (groups,) float64."""
    largest = np.zeros(len(start) - 1)
    for g in range(len(start) - 1):
        for i in range(start[g], start[g + 1]):
            largest[g] = max(largest[g], values[i])
    return largest
