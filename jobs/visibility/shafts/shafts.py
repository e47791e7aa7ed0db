"""Shafts: what may lie between a part of the cell and a part of a drawable.

A *shaft* is the convex hull of a part of the cell (a box V) and of a box U that holds what is looked at. There are no
pixels here, and so no rounding but by a thousandth of a grid unit.

**An edge and a shaft.** The hull of two boxes is the union of the boxes a V + (1 - a) U over 0 <= a <= 1. So a point
A + t (B - A) of an edge lies in it if and only if six inequalities hold that are linear in a and t; whether any a and t
fulfil them is decided by eliminating t (Fourier and Motzkin) and clipping the range of a.

Based on: E. Haines, J. Wallace: Shaft Culling for Efficient Ray-Traced Radiosity, Eurographics Workshop on Rendering
1991.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jobs.visibility.surfaces.planes import plane_of
from jobs.visibility.surfaces.ranges import not_above
from storage.base.kernels import allocating_kernel, kernel

#: Boxes are grown by this many grid units: a million times what rounding moves a point by.
GROWN = 2.0**-10
#: Most corners of what is looked at.
CORNERS = 8


class Shaft(NamedTuple):
    """A shaft, in grid units."""

    v: np.ndarray  # (2, 3) float64 the box V
    u: np.ndarray  # (2, 3) float64 the box U, grown
    corners: np.ndarray  # (CORNERS, 3) float64 the first few: of what is looked at; U holds their hull
    low: np.ndarray  # (2, 3) float64 the lower bounds: at U, and how they change from there to V
    high: np.ndarray  # (2, 3) float64 the upper bounds
    centre: np.ndarray  # (3,) float64 of V
    half: np.ndarray  # (3,) float64 half the extents of V, grown
    o: np.ndarray  # (3,) float64 where a segment through the shaft starts
    d: np.ndarray  # (3,) float64 where it leads from there


@allocating_kernel()
def make_shaft() -> Shaft:
    """A shaft to be filled in."""
    return Shaft(
        np.empty((2, 3)), np.empty((2, 3)), np.empty((CORNERS, 3)), np.empty((2, 3)), np.empty((2, 3)), np.empty(3),
        np.empty(3), np.empty(3), np.empty(3),
    )  # fmt: skip


@kernel()
def span(shaft: Shaft, count: int) -> None:
    """Fill in a shaft of which V and `count` corners are known."""
    for k in range(3):
        least, most = np.inf, -np.inf
        for c in range(count):
            least = min(least, shaft.corners[c, k])
            most = max(most, shaft.corners[c, k])
        shaft.u[0, k], shaft.u[1, k] = least - GROWN, most + GROWN
        shaft.low[0, k] = shaft.u[0, k]
        shaft.low[1, k] = shaft.v[0, k] - GROWN - shaft.u[0, k]
        shaft.high[0, k] = shaft.u[1, k]
        shaft.high[1, k] = shaft.v[1, k] + GROWN - shaft.u[1, k]
        shaft.centre[k] = 0.5 * (shaft.v[0, k] + shaft.v[1, k])
        shaft.half[k] = 0.5 * (shaft.v[1, k] - shaft.v[0, k]) * (1.0 + 1e-9) + GROWN


@kernel()
def edge_meets(ax: np.ndarray, bx: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
    """Where an edge meets a shaft: the range of a, within 0 (at U) to 1 (at V); empty, the first above the second,
    where it does not. See the module's docstring.

    Args:
        ax, bx: (3,) int32 the ends of the edge, grid units.
        low, high: (2, 3) float64: the shaft's part at a reaches from low[0] + a low[1] to high[0] + a high[1].
    """
    for k in range(3):
        a, b = float(ax[k]), float(bx[k])
        if max(a, b) < low[0, k] + min(low[1, k], 0.0) or min(a, b) > high[0, k] + max(high[1, k], 0.0):
            return 1.0, 0.0
    first, last = 0.0, 1.0
    for i in range(3):
        di = float(bx[i]) - ax[i]
        if di == 0.0:
            first, last = not_above(first, last, low[0, i] - ax[i], low[1, i])
            first, last = not_above(first, last, ax[i] - high[0, i], -high[1, i])
            continue
        # t is at least p + q a for this axis
        if di > 0.0:
            p, q = (low[0, i] - ax[i]) / di, low[1, i] / di
            r, s = (high[0, i] - ax[i]) / di, high[1, i] / di
        else:
            p, q = (high[0, i] - ax[i]) / di, high[1, i] / di
            r, s = (low[0, i] - ax[i]) / di, low[1, i] / di
        first, last = not_above(first, last, p - 1.0, q)
        first, last = not_above(first, last, -r, -s)
        if first > last:
            return 1.0, 0.0
        for j in range(3):
            dj = float(bx[j]) - ax[j]
            if j == i or dj == 0.0:
                continue
            # and at most r + s a for the others
            if dj > 0.0:
                r, s = (high[0, j] - ax[j]) / dj, high[1, j] / dj
            else:
                r, s = (low[0, j] - ax[j]) / dj, low[1, j] / dj
            first, last = not_above(first, last, p - r, q - s)
    return first, last


@kernel()
def part_within(
    ax: np.ndarray, bx: np.ndarray, low: np.ndarray, high: np.ndarray, first: float, last: float
) -> tuple[float, float]:
    """A range of t that holds the part of an edge within a shaft; first, last: the range of a, see `edge_meets`."""
    t0, t1 = 0.0, 1.0
    for k in range(3):
        dk = float(bx[k]) - ax[k]
        if dk == 0.0:
            continue
        least = low[0, k] + min(first * low[1, k], last * low[1, k])
        most = high[0, k] + max(first * high[1, k], last * high[1, k])
        if dk > 0.0:
            t0, t1 = max(t0, (least - ax[k]) / dk), min(t1, (most - ax[k]) / dk)
        else:
            t0, t1 = max(t0, (most - ax[k]) / dk), min(t1, (least - ax[k]) / dk)
    return t0, max(t0, t1)


@kernel()
def apart(vertices: np.ndarray, triangles: np.ndarray, t: int, corners: np.ndarray, count: int, u: np.ndarray) -> bool:
    """Whether triangle t surely does not touch the hull of some corners (the first `count`); u: (2, 3) their box.

    They are apart where their boxes are, or where all corners lie on one side of the triangle's plane, by GROWN.
    """
    i0, i1, i2 = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    for k in range(3):
        x, y, z = float(vertices[i0, k]), float(vertices[i1, k]), float(vertices[i2, k])
        if max(x, y, z) < u[0, k] or min(x, y, z) > u[1, k]:
            return True
    x0, y0, z0, nx, ny, nz = plane_of(vertices, triangles, t)
    slack = GROWN * (abs(nx) + abs(ny) + abs(nz))
    above = below = True
    for k in range(count):
        along = nx * (corners[k, 0] - x0) + ny * (corners[k, 1] - y0) + nz * (corners[k, 2] - z0)
        above &= along > slack
        below &= along < -slack
    return above or below
