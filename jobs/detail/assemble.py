"""From levels and their placements to nodes and drawables.

Each placement of a node's levels becomes one node of the store, each level of it one drawable. Everything that a
drawable claims (box, error) is worked out from the very positions that a store gives out for it: integers on the
model's grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from storage.base.kernels import kernel
from storage.model.tables import DRAWABLE, NODE, Grid

if TYPE_CHECKING:
    from jobs.detail.node import Node


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


class PlacedNode(NamedTuple):
    """A node's levels at one of their places, finest first."""

    part: int
    instance: int
    geometry: int  # of the finest level; those of the others follow
    triangles: list[int]
    one_sided: list[bool]
    see_through: bool
    errors: list[float]
    lo: np.ndarray  # (levels, 3) float64: the box of each
    hi: np.ndarray


def place_levels(made: Node, placements: Sequence[Placement], grid: Grid, first_geometry: int) -> list[PlacedNode]:
    """A node's levels at each of their places; their geometry counts up from first_geometry, finest level first."""
    levels = made.levels
    see_through = bool(levels[0].colours[0, 3] < 255)  # one vertex tells: no node is of both kinds
    triangles, one_sided = [len(level.triangles) for level in levels], [level.one_sided for level in levels]
    placed = []
    for to in placements:
        moved = to.instance >= 0
        errors = [level.error for level in levels]
        if moved:
            snapping = grid.step * math.sqrt(3) / 2 * (1 + 1e-12)
            errors = [error * to.stretch * (1 + 1e-12) + snapping for error in errors]
        lo, hi = np.empty((len(levels), 3)), np.empty((len(levels), 3))
        for number, level in enumerate(levels):
            _placed_box(level.positions, to.matrix, moved, made.scale, grid.step, lo[number], hi[number])
        placed.append(
            PlacedNode(to.part, to.instance, first_geometry, triangles, one_sided, see_through, errors, lo, hi)
        )
    return placed


def make_rows(placed: Sequence[PlacedNode]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (p,), their `end` left 0, and drawables of placed levels, in their order."""
    nodes = np.zeros(len(placed), NODE)
    counts = np.array([len(own.triangles) for own in placed], np.int64)
    starts = np.cumsum(counts) - counts
    drawables = np.zeros(int(counts.sum()), DRAWABLE)
    if not len(placed):
        return nodes, drawables
    drawables["node"] = np.repeat(np.arange(len(placed)), counts)
    drawables["level"] = level = np.arange(len(drawables)) - np.repeat(starts, counts)
    drawables["geometry"] = np.repeat([own.geometry for own in placed], counts) + level
    drawables["instance"] = np.repeat([own.instance for own in placed], counts)
    drawables["triangles"] = [count for own in placed for count in own.triangles]
    drawables["one_sided"] = [one for own in placed for one in own.one_sided]
    drawables["see_through"] = np.repeat([own.see_through for own in placed], counts)
    stored = float32_up([error for own in placed for error in own.errors])
    for number in range(1, int(counts.max())):  # rounding must not make two levels' errors equal
        at = np.flatnonzero(level == number)
        stored[at] = np.maximum(stored[at], np.nextafter(stored[at - 1], np.float32(np.inf)))
    drawables["error"] = stored
    lo, hi = (np.concatenate([getattr(own, name) for own in placed]) for name in ("lo", "hi"))
    drawables["lo"], drawables["hi"] = float32_down(lo), float32_up(hi)
    reach = stored[starts, None].astype(np.float64)
    nodes["first_drawable"], nodes["levels"] = starts, counts
    nodes["part"] = [own.part for own in placed]
    nodes["lo"] = float32_down(np.minimum(lo[starts] - reach, np.minimum.reduceat(lo, starts)))
    nodes["hi"] = float32_up(np.maximum(hi[starts] + reach, np.maximum.reduceat(hi, starts)))
    return nodes, drawables


def join_rows(rows: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and drawables of several `make_rows` as one pair of tables, in their order."""
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

    end (n,) int64: the trees, see jobs.objects.hierarchy; chunks: the places in them (k,), nodes (k,) and drawables of
    each task, which have each node once; geometries: how many meshes each task stored. The box of each node
    grows to hold those below it.
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
    nodes["end"] = end
    lo, hi = nodes["lo"].copy(), nodes["hi"].copy()
    ends = nodes["end"].tolist()
    for node in range(len(nodes) - 1, -1, -1):
        child = node + 1
        while child < ends[node]:
            lo[node], hi[node] = np.minimum(lo[node], lo[child]), np.maximum(hi[node], hi[child])
            child = ends[child]
    nodes["lo"], nodes["hi"] = lo, hi
    return nodes, drawables


def float32_up(values: ArrayLike) -> np.ndarray:
    """The least float32 not below each value."""
    exact = np.asarray(values, np.float64)
    near = exact.astype(np.float32)
    return np.where(near < exact, np.nextafter(near, np.float32(np.inf)), near)


def float32_down(values: ArrayLike) -> np.ndarray:
    """The greatest float32 not above each value."""
    exact = np.asarray(values, np.float64)
    near = exact.astype(np.float32)
    return np.where(near > exact, np.nextafter(near, np.float32(-np.inf)), near)


@kernel()
def _placed_box(
    positions: np.ndarray, matrix: np.ndarray, moved: bool, scale: float, step: float, lo: np.ndarray, hi: np.ndarray
) -> None:
    """Write the box lo, hi (3,) of a placed mesh, of whose vertices each is used.

    positions (n, 3) int32 times scale, moved by a matrix (3, 4) if `moved`, lie on the grid of `step` as the store
    gives them out (storage.meshes.placement: `transform_points`, `Grid.snap`).
    """
    for i in range(3):
        lo[i], hi[i] = np.inf, -np.inf
    for v in range(len(positions)):
        x, y, z = positions[v, 0] * scale, positions[v, 1] * scale, positions[v, 2] * scale
        for i in range(3):
            place = np.int64(positions[v, i])
            if moved:
                at = ((matrix[i, 0] * x + matrix[i, 1] * y) + matrix[i, 2] * z) + matrix[i, 3]
                place = np.int64(np.rint(at * (1.0 / step)))
            p = place * step
            lo[i], hi[i] = min(lo[i], p), max(hi[i], p)
