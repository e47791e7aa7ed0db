"""Makes stores with thousands of cells in seconds, through the writers of storage as a build does: a tower of rooms.

What can be seen is made up: from each cell the things in the rooms around it, but for a few that change from cell to
cell. All that a store says of it is true; rays are not asked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.cells.octree import encode, morton_order
from storage.geometry_reader import open_geometry
from storage.known_cells import KnownCells
from storage.model.cut import pixel_angle
from storage.model.tables import CELL
from storage.shards.manifest import Manifest, commit
from storage.store import Store, open_store
from storage.vlod_writer import cells_section, write_cell_shard
from tests.storage.tiny_store import TinyPart, box_part, make_geometry

#: Cells of a shard: those of a subtree of three levels.
SHARD = 512
#: What stands in a room, each one mesh for all rooms: lower and upper corners in a room of 4 x 4 x 4, and how many
#: squares there are along an edge.
THINGS = {
    "floor": ((0.0, 0.0, 0.0), (4.0, 4.0, 0.2), 2),
    "wall": ((0.0, 0.0, 0.2), (3.0, 0.2, 4.0), 1),
    "side": ((0.0, 0.2, 0.2), (0.2, 3.0, 4.0), 1),
    "table": ((1.5, 1.5, 0.9), (3.0, 2.5, 1.0), 1),
    "chair": ((2.0, 1.0, 0.2), (2.4, 1.4, 1.1), 1),
    "shelf": ((3.5, 0.5, 0.2), (3.9, 2.5, 2.5), 2),
    "lamp": ((2.0, 2.0, 3.6), (2.3, 2.3, 3.9), 1),
    "box": ((0.5, 3.0, 0.2), (0.9, 3.4, 0.6), 1),
}


@dataclass(frozen=True)
class Tower:
    """How large a tower is. Rooms are two cells wide, deep and high."""

    depth: int  # of the cells in the octree; 2 ** (depth - 1) rooms a side
    floors: int  # rooms one above the other
    sight: int  # rooms that are seen in each direction, on the same floor; one floor above and below half as many
    copies: int = 1  # of each of the eight things in each room

    @property
    def side(self) -> int:
        """Rooms along a side."""
        return 1 << (self.depth - 1)


def make_tower(root: Path, tower: Tower, tell: Callable[[int, int], None] = lambda done, total: None) -> Store:
    """Writes the store of a tower to `root` and opens it; tell: called with (done, total) cells."""
    side = tower.side
    rooms = np.array([(x, y, z) for z in range(tower.floors) for y in range(side) for x in range(side)])
    places = [np.column_stack([np.eye(3), 4.0 * room]) for room in rooms]
    parts: list[TinyPart] = [
        box_part(f"{name} {copy}", np.add(lo, 0.01 * copy), np.add(hi, 0.01 * copy), segments=(cuts,), matrices=places)
        for name, (lo, hi, cuts) in THINGS.items()
        for copy in range(tower.copies)
    ]
    section, octree, model = make_geometry(root, parts)
    geometry = open_geometry(root, section)
    everything = np.arange(len(geometry.drawables))
    room_of = np.tile(np.arange(len(rooms)), len(parts))  # part after part, each room after room
    facets, sizes = geometry.facets(everything), geometry.drawables["triangles"].astype(np.int64)

    grid = np.array([(x, y, z) for z in range(2 * tower.floors) for y in range(2 * side) for x in range(2 * side)])
    keys = encode(grid, tower.depth)
    order = morton_order(keys)
    grid, keys = grid[order], keys[order]
    cells = np.zeros(len(keys), CELL)
    cells["key"], cells["depth"], cells["computed"], cells["pixel_error"] = keys, tower.depth, True, 1.0
    cells["lo"], cells["hi"] = octree.boxes(keys)
    cells["cut_drawables"], cells["cut_triangles"] = len(everything), sizes.sum()

    def visible(number: int) -> NDArray[np.uint32]:
        away = np.abs(rooms - grid[number] // 2)
        near = away[:, :2].max(axis=1)
        seen = ((away[:, 2] == 0) & (near <= tower.sight)) | ((away[:, 2] == 1) & (near <= tower.sight // 2))
        ids = everything[seen[room_of]]
        # one in fifty is hidden, another one in each cell: bits of the finaliser of splitmix64
        mixed = (ids.astype(np.uint64) << np.uint64(32)) + np.uint64(number)
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
        return ids[(mixed >> np.uint64(33)) % np.uint64(50) > 0].astype(np.uint32)

    hierarchy = KnownCells(geometry.nodes, geometry.drawables, pixel_angle(1080, 60.0))
    shards = []
    for first in range(0, len(cells), SHARD):
        end = min(first + SHARD, len(cells))
        tell(first, len(cells))
        sets: list[NDArray[np.int64]] = []
        for number in range(first, end):
            ids = visible(number).astype(np.int64)
            sets.append(ids)
            cell = cells[number]
            cell["drawables"], cell["triangles"] = len(ids), sizes[ids].sum()
            turned = facets.turned_away(ids, cell["lo"], cell["hi"])
            cell["turned_triangles"] = turned.triangle_counts.sum()
        shards.append(write_cell_shard(root, cells[first:end], sets, hierarchy))
    tell(len(cells), len(cells))
    commit(
        root,
        Manifest(
            model=model,
            pixel_angle=pixel_angle(1080, 60.0),
            parameters={"sampled": True, "max_depth": tower.depth},
            geometry=section,
            cells=cells_section(root, octree, shards),
        ),
    )
    return open_store(root)
