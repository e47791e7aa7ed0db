"""From levels and their placements to nodes and drawables.

Each placement of a node's levels becomes one node of the store, each level of it one drawable. Everything that a
drawable claims (box, error, cone) is worked out from the very positions that a store gives out for it: integers on the
model's grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from storage.kernels import allocating_kernel
from storage.tables import DRAWABLE, NODE, Grid, transform_points

if TYPE_CHECKING:
    from jobs.detail.node import Level, Node

#: Half angles of cones are rounded up to a multiple of this, in radians: far above what differing arccos differ by.
ANGLE_STEP = 2.0**-12


@dataclass(frozen=True)
class Placement:
    """Where a mesh is placed in the model."""

    part: int  # index of the part
    instance: int  # index of its matrix; -1 where the mesh lies in model space already
    matrix: np.ndarray  # (3, 4) float64
    stretch: float  # upper bound of the factor by which the matrix lengthens


def largest_stretch(matrices: np.ndarray) -> np.ndarray:
    """Upper bound (n,) of the largest singular value of the left 3x3 of matrices (n, 3, 4), within 1 part in a million.

    The largest eigenvalue of A = M^T M is at most trace(A^n)^(1/n) and at least that over 3^(1/n). Only sums, products
    and square roots: the same bits on every machine.
    """
    m = np.asarray(matrices, np.float64)[:, :, :3]
    a = _multiply(m.transpose(0, 2, 1), m)
    scale = a[:, 0, 0] + a[:, 1, 1] + a[:, 2, 2]
    power = a / np.where(scale > 0, scale, 1.0)[:, None, None]
    factors = []
    for _ in range(20):
        power = _multiply(power, power)
        trace = power[:, 0, 0] + power[:, 1, 1] + power[:, 2, 2]
        trace = np.where(trace > 0, trace, 1.0)
        power = power / trace[:, None, None]
        factors.append(trace)
    root = np.ones(len(m))
    for trace in reversed(factors):
        root = np.sqrt(root * trace)
    return np.sqrt(scale * root) * (1 + 1e-12)


def _multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products (n, 3, 3) of matrices, summed in a fixed order."""
    terms = [a[:, :, k, None] * b[:, None, k, :] for k in range(3)]
    return (terms[0] + terms[1]) + terms[2]


def place_node(
    made: Node, placements: Sequence[Placement], grid: Grid, first_geometry: int
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (p,) and drawables (p * levels,) of a node's placements, in their order; `end` is left 0.

    The drawables' geometry counts up from first_geometry, finest level first; node and first_drawable count from 0.
    """
    levels = made.levels
    count = len(levels)
    nodes = np.zeros(len(placements), NODE)
    drawables = np.zeros(len(placements) * count, DRAWABLE)
    drawables["node"] = np.repeat(np.arange(len(placements)), count)
    drawables["level"] = np.tile(np.arange(count), len(placements))
    drawables["geometry"] = first_geometry + drawables["level"]
    drawables["instance"] = np.repeat([placement.instance for placement in placements], count)
    drawables["triangles"] = np.tile([len(level.triangles) for level in levels], len(placements))
    drawables["one_sided"] = np.tile([level.one_sided for level in levels], len(placements))
    errors = np.empty((len(placements), count))
    lo, hi = np.empty((len(placements), count, 3)), np.empty((len(placements), count, 3))
    axes, angles = np.empty((len(placements), count, 3)), np.empty((len(placements), count))
    for n, placement in enumerate(placements):
        for number, level in enumerate(levels):
            positions, flipped = grid_positions(level, made.scale, placement, grid)
            lo[n, number], hi[n, number] = _box(positions, level.triangles)
            error = level.error
            if placement.instance >= 0:
                error = error * placement.stretch * (1 + 1e-12) + grid.step * math.sqrt(3) / 2 * (1 + 1e-12)
            errors[n, number] = error
            axes[n, number], angles[n, number] = _cone(level, positions, placement, flipped, level.one_sided)
    stored = float32_up(errors)
    for number in range(1, count):  # rounding must not make two levels' errors equal
        stored[:, number] = np.maximum(stored[:, number], np.nextafter(stored[:, number - 1], np.float32(np.inf)))
    lo, hi = lo * grid.step, hi * grid.step
    drawables["error"], drawables["cone_angle"] = stored.reshape(-1), angles.reshape(-1)
    drawables["cone_axis"] = axes.reshape(-1, 3)
    drawables["lo"], drawables["hi"] = float32_down(lo).reshape(-1, 3), float32_up(hi).reshape(-1, 3)
    reach = stored[:, :1].astype(np.float64)
    nodes["first_drawable"] = np.arange(len(placements)) * count
    nodes["levels"], nodes["part"] = count, [placement.part for placement in placements]
    nodes["lo"] = float32_down(np.minimum(lo[:, 0] - reach, lo.min(axis=1)))
    nodes["hi"] = float32_up(np.maximum(hi[:, 0] + reach, hi.max(axis=1)))
    return nodes, drawables


def grid_positions(level: Level, scale: float, placement: Placement, grid: Grid) -> tuple[np.ndarray, bool]:
    """Grid coordinates (n, 3) int64 of a placed level, and whether the placement mirrors it."""
    if placement.instance < 0:
        return level.positions.astype(np.int64), False
    points = transform_points(placement.matrix, level.positions * np.float64(scale))
    return grid.snap(points).astype(np.int64), _determinant(placement.matrix) < 0


def join_rows(rows: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and drawables of several `place_node` as one pair of tables, in their order."""
    nodes, drawables = [np.zeros(0, NODE)], [np.zeros(0, DRAWABLE)]
    first_node = first_drawable = 0
    for own_nodes, own_drawables in rows:
        n, d = own_nodes.copy(), own_drawables.copy()
        n["first_drawable"] += first_drawable
        d["node"] += first_node
        nodes.append(n)
        drawables.append(d)
        first_node, first_drawable = first_node + len(n), first_drawable + len(d)
    return np.concatenate(nodes), np.concatenate(drawables)


def join_nodes(
    end: np.ndarray, chunks: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], geometries: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """The whole model's nodes and drawables.

    end (n,) int64: the tree, see jobs.objects.tree; chunks: the places in the tree (k,), nodes (k,) and drawables of
    each task; geometries: how many meshes each task stored. Nodes of the tree that nothing was stored for are left
    out. The box of each node grows to hold those below it.
    """
    places = np.concatenate([places for places, _, _ in chunks])
    shifts = np.cumsum([0, *geometries])
    moved = []
    for (_, own_nodes, own_drawables), shift in zip(chunks, shifts[:-1], strict=True):
        d = own_drawables.copy()
        d["geometry"] += np.uint32(shift)
        moved.append((own_nodes, d))
    nodes, drawables = join_rows(moved)
    order = np.argsort(places, kind="stable")
    levels = nodes["levels"][order].astype(np.int64)
    starts = np.concatenate([[0], np.cumsum(levels)])
    source = np.repeat(nodes["first_drawable"][order].astype(np.int64) - starts[:-1], levels) + np.arange(starts[-1])
    nodes, drawables = nodes[order], drawables[source]
    nodes["first_drawable"] = starts[:-1]
    drawables["node"] = np.repeat(np.arange(len(order)), levels)
    nodes["end"] = np.searchsorted(places[order], end[places[order]])
    lo, hi = nodes["lo"].copy(), nodes["hi"].copy()
    ends = nodes["end"].tolist()
    for node in range(len(nodes) - 1, -1, -1):
        child = node + 1
        while child < ends[node]:
            lo[node], hi[node] = np.minimum(lo[node], lo[child]), np.maximum(hi[node], hi[child])
            child = ends[child]
    nodes["lo"], nodes["hi"] = lo, hi
    return nodes, drawables


def float32_up(values: np.ndarray | float) -> np.ndarray:
    """The least float32 not below each value."""
    exact = np.asarray(values, np.float64)
    near = exact.astype(np.float32)
    return np.where(near < exact, np.nextafter(near, np.float32(np.inf)), near)


def float32_down(values: np.ndarray | float) -> np.ndarray:
    """The greatest float32 not above each value."""
    exact = np.asarray(values, np.float64)
    near = exact.astype(np.float32)
    return np.where(near > exact, np.nextafter(near, np.float32(-np.inf)), near)


def _cone(
    level: Level, positions: np.ndarray, placement: Placement, flipped: bool, one_sided: bool
) -> tuple[np.ndarray, float]:
    """Axis and half angle of a cone around the normals of a level's triangles as they are placed."""
    axis = np.asarray(level.cone_axis, np.float64)
    if not one_sided or level.cone_angle >= math.pi:
        return axis.astype(np.float32), math.pi
    if placement.instance >= 0:
        axis = _turn_normal(placement.matrix, axis)
    axis = (axis / max(float(_length(axis[None])[0]), 1e-300)).astype(np.float32).astype(np.float64)
    cosine = _least_cosine(positions, level.triangles, -axis if flipped else axis)
    if cosine > 1e300 or not axis.any():
        return axis, math.pi
    cosine /= float(_length(axis[None])[0])
    angle = math.acos(min(1.0, max(-1.0, cosine)))
    return axis, min(math.pi, math.ceil((angle + 1e-6) / ANGLE_STEP) * ANGLE_STEP)


@allocating_kernel()
def _box(positions: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The box lo, hi (3,) int64 of triangles (m, 3) over positions (n, 3) int64."""
    lo, hi = positions[triangles[0, 0]].copy(), positions[triangles[0, 0]].copy()
    for t in range(len(triangles)):
        for e in range(3):
            for c in range(3):
                p = positions[triangles[t, e], c]
                lo[c], hi[c] = min(lo[c], p), max(hi[c], p)
    return lo, hi


@allocating_kernel()
def _least_cosine(positions: np.ndarray, triangles: np.ndarray, axis: np.ndarray) -> float:
    """The least product of an axis (3,) with the unit normal of a triangle (m, 3) over positions (n, 3) int64.

    Infinite if no triangle has an area.
    """
    least = np.inf
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ux, uy, uz = (
            positions[b, 0] - positions[a, 0],
            positions[b, 1] - positions[a, 1],
            positions[b, 2] - positions[a, 2],
        )
        vx, vy, vz = (
            positions[c, 0] - positions[a, 0],
            positions[c, 1] - positions[a, 1],
            positions[c, 2] - positions[a, 2],
        )
        x, y, z = np.float64(uy * vz - uz * vy), np.float64(uz * vx - ux * vz), np.float64(ux * vy - uy * vx)
        length = np.sqrt((x * x + y * y) + z * z)
        if length > 0.0:
            least = min(least, (x * axis[0] + y * axis[1] + z * axis[2]) / length)
    return least


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors[:, 0] ** 2 + vectors[:, 1] ** 2) + vectors[:, 2] ** 2)


def _cofactors(matrix: np.ndarray) -> np.ndarray:
    """(3, 3): determinant times the inverse's transpose; turns normals."""
    m = np.asarray(matrix, np.float64)[:, :3]
    result = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            r, s, t, u = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            result[i, j] = m[r, t] * m[s, u] - m[r, u] * m[s, t]
    return result


def _determinant(matrix: np.ndarray) -> float:
    m, c = np.asarray(matrix, np.float64), _cofactors(matrix)
    return float((m[0, 0] * c[0, 0] + m[0, 1] * c[0, 1]) + m[0, 2] * c[0, 2])


def _turn_normal(matrix: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The direction that is outward on a placed surface where `normal` (3,) was outward on the mesh; not unit."""
    c = _cofactors(matrix)
    turned = (c[:, 0] * normal[0] + c[:, 1] * normal[1]) + c[:, 2] * normal[2]
    return -turned if _determinant(matrix) < 0 else turned
