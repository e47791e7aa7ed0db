"""From drawable ids to draw commands: one command per run of a mesh's triangles, however many instances show it.

What can be seen through has a list of its own, for it is drawn after all that is opaque.

Pure array functions; nothing here touches OpenGL.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from player.renderer.facet_table import CellBox, FacetTable, FacetUsers, Runs
from player.renderer.instances import mirrored

#: Which sides of a drawable are drawn; the cull mode of a batch.
BOTH_SIDES, FRONT_ONLY, BACK_ONLY = 0, 1, 2

#: What an instance that is drawn brings along: its placement (see player.renderer.instances) and its tint.
RECORD = np.dtype([("placement", "<u4"), ("tint", "u1", (4,))])

#: OpenGL's DrawElementsIndirectCommand.
COMMAND = np.dtype(
    [
        ("indices", "<u4"),
        ("instances", "<u4"),
        ("first_index", "<u4"),
        ("base_vertex", "<i4"),
        ("base_instance", "<u4"),  # where the command's records begin in the list of records
    ]
)


@dataclass(frozen=True, eq=False)
class DrawTables:
    """What drawing must know of each drawable; arrays as long as the store's tables."""

    geometry: NDArray[np.int64]  # (drawables,) index of the mesh
    record: np.ndarray  # RECORD (drawables,)
    side: NDArray[np.uint8]  # (drawables,) BOTH_SIDES, FRONT_ONLY, or BACK_ONLY for mirrored one-sided instances
    see_through: NDArray[np.bool_]  # (drawables,) which can be seen through: all BOTH_SIDES
    pack: NDArray[np.int64]  # (geometries,) the pack that holds the mesh
    first_index: NDArray[np.int64]  # (geometries,) first index inside the pack
    indices: NDArray[np.int64]  # (geometries,)
    facets: FacetUsers


def draw_tables(drawables: np.ndarray, geometry: np.ndarray, instances: np.ndarray, step: float) -> DrawTables:
    """The tables for a store's DRAWABLE, GEOMETRY and INSTANCE arrays, without tints; step: of the grid."""
    instance = np.ascontiguousarray(drawables["instance"])
    record = np.zeros(len(drawables), RECORD)
    record["placement"] = instance + 1
    sides = np.where(mirrored(instances["matrix"]), BACK_ONLY, FRONT_ONLY).astype(np.uint8)
    side = np.append(sides, np.uint8(FRONT_ONLY))[instance]
    see_through = np.ascontiguousarray(drawables["see_through"])
    side[~drawables["one_sided"] | see_through] = BOTH_SIDES
    mesh = drawables["geometry"].astype(np.int64)
    users = FacetUsers(
        geometry=mesh,
        instance=instance,
        scale=np.ascontiguousarray(geometry["scale"]),
        matrices=instances["matrix"].copy(),
        step=step,
    )
    return DrawTables(
        geometry=mesh,
        record=record,
        side=side,
        see_through=see_through,
        pack=geometry["pack"].astype(np.int64),
        first_index=geometry["triangle_start"].astype(np.int64) * 3,
        indices=geometry["triangles"].astype(np.int64) * 3,
        facets=users,
    )


@dataclass(frozen=True)
class Batch:
    """Commands that share a slab and a cull mode."""

    slab: int
    side: int
    first: int  # index of the first command
    commands: int


@dataclass(frozen=True, eq=False)
class DrawList:
    """What is drawn together."""

    commands: np.ndarray  # COMMAND (n,)
    records: np.ndarray  # RECORD (drawables,) of each instance drawn, in the commands' order
    batches: tuple[Batch, ...]
    triangles: int
    drawables: int
    turned: int  # triangles of these drawables that are left out: the view cell can only see their backs


@dataclass(frozen=True, eq=False)
class DrawLists:
    """Everything to draw one frame."""

    opaque: DrawList
    see_through: DrawList | None  # None: nothing of it can be seen through

    @property
    def lists(self) -> tuple[DrawList, ...]:
        """One after the other."""
        return (self.opaque,) if self.see_through is None else (self.opaque, self.see_through)

    @property
    def triangles(self) -> int:
        """How many triangles are drawn."""
        return sum(one.triangles for one in self.lists)

    @property
    def drawables(self) -> int:
        """How many drawables these are of."""
        return sum(one.drawables for one in self.lists)

    @property
    def turned(self) -> int:
        """Triangles of these drawables that are left out."""
        return sum(one.turned for one in self.lists)


def build_parted(
    ids: NDArray[np.int64],
    tables: DrawTables,
    slab_of: NDArray[np.int32],
    first_index: NDArray[np.int64],
    facets: FacetTable,
    cell: CellBox | None,
) -> DrawLists:
    """What is opaque of sorted drawable `ids` and what can be seen through, each as `build` makes it."""
    arena = slab_of, first_index, facets, cell
    see_through = tables.see_through[ids]
    if not see_through.any():
        return DrawLists(build(ids, tables, *arena), None)
    return DrawLists(build(ids[~see_through], tables, *arena), build(ids[see_through], tables, *arena))


def build(
    ids: NDArray[np.int64],
    tables: DrawTables,
    slab_of: NDArray[np.int32],
    first_index: NDArray[np.int64],
    facets: FacetTable,
    cell: CellBox | None,
) -> DrawList:
    """Draw commands for sorted drawable `ids`, all of whose packs must be in the arena.

    slab_of, first_index (packs,): where the arena holds each pack; facets: of the meshes in the arena; cell: leave out
    what this view cell sees only from behind; None: nothing. Within a batch, meshes come in the order of their first
    drawable: the same order whatever else is drawn, so that coplanar surfaces look the same every time.
    """
    geometry = tables.geometry[ids]
    slab = slab_of[tables.pack[geometry]].astype(np.int64)
    if np.any(slab < 0):
        raise ValueError("a drawable's pack is not in the arena")
    wholes = tables.indices[geometry]
    runs = _whole(wholes) if cell is None else facets.runs_of(ids, tables.facets, cell)
    ids, geometry = ids[runs.drawable], geometry[runs.drawable]
    batch = slab[runs.drawable] * 3 + tables.side[ids]
    rank = np.arange(len(ids), dtype=np.int64)
    placed = tables.record["placement"][ids]
    if placed.any():  # several drawables may share a mesh: each takes the rank of the mesh's first
        by_mesh = np.lexsort((rank, geometry, batch))
        starts = _starts(batch[by_mesh], geometry[by_mesh])
        lengths = np.diff(np.append(starts, len(ids)))
        first_rank = np.empty_like(rank)
        first_rank[by_mesh] = np.repeat(rank[by_mesh][starts], lengths)
        order = np.lexsort((rank, runs.indices, runs.first, first_rank, batch))
    else:
        order = np.argsort(batch, kind="stable")
    batch, geometry, ordered, first, indices = (a[order] for a in (batch, geometry, ids, runs.first, runs.indices))
    starts = _starts(batch, geometry, first, indices)
    mesh = geometry[starts]
    commands = np.zeros(len(starts), COMMAND)
    commands["indices"] = indices[starts]
    commands["instances"] = np.diff(np.append(starts, len(ids)))
    commands["first_index"] = first_index[tables.pack[mesh]] + tables.first_index[mesh] + first[starts]
    commands["base_instance"] = starts
    batch_of_command = batch[starts]
    edges = np.flatnonzero(np.diff(batch_of_command, prepend=-1, append=-1))
    batches = tuple(
        Batch(int(batch_of_command[a] // 3), int(batch_of_command[a] % 3), int(a), int(b - a))
        for a, b in pairwise(edges)
    )
    triangles = int(indices.sum()) // 3
    drawables = int((np.diff(runs.drawable, prepend=-1) != 0).sum())
    turned = int(wholes.sum()) // 3 - triangles
    return DrawList(commands, tables.record[ordered], batches, triangles, drawables, turned)


def _whole(indices: NDArray[np.int64]) -> Runs:
    """Every drawable as one run, of so many indices (n,)."""
    return Runs(np.arange(len(indices)), np.zeros(len(indices), np.int64), indices)


def _starts(*keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where one of several arrays that are sorted alike changes."""
    if not len(keys[0]):
        return np.zeros(0, np.int64)
    changes = np.logical_or.reduce([np.diff(key) != 0 for key in keys])
    return np.concatenate([[0], np.flatnonzero(changes) + 1])


def merged_runs(commands: np.ndarray) -> NDArray[np.int64]:
    """Runs (k, 2) of [first index, indices] of single-instance commands, joined where one ends as the next begins."""
    first = commands["first_index"].astype(np.int64)
    count = commands["indices"].astype(np.int64)
    if not len(first):
        return np.zeros((0, 2), np.int64)
    starts = np.flatnonzero(np.concatenate([[True], first[1:] != first[:-1] + count[:-1]]))
    return np.stack([first[starts], np.add.reduceat(count, starts)], axis=1)
