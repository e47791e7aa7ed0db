"""The sections of a manifest: what it says of the model, its geometry and its view cells.

Each is written to JSON by the names of its fields. A section may get new fields that name no shards: readers ignore
those that they do not know. What is new as a whole is a section of its own, beside these, that readers may ignore too,
unless the manifest says that it is required: see `storage.shards.manifest`.
"""

from __future__ import annotations

from dataclasses import dataclass

from storage.shards.shards import ShardRecord

#: x, y, z in model units.
Point = tuple[float, float, float]


@dataclass(frozen=True)
class ModelSection:
    """The model that the store was built from."""

    digest: str  # of what was imported
    triangles: int
    lo: Point  # box of the model
    hi: Point
    origin: Point  # what was taken from all coordinates of the files: their coordinates are model space plus this
    up: str  # x, y or z
    unit_in_metres: float  # metres per model unit


@dataclass(frozen=True)
class GeometryCounts:
    """How much geometry there is: the rows of the tables, and what follows from them."""

    parts: int
    instances: int
    geometries: int
    packs: int
    nodes: int
    drawables: int
    leaves: int
    levels: int  # most levels of a node
    stored_triangles: int  # of all meshes, each counted once
    finest_triangles: int  # of the finest levels of all leaves, wherever they are placed


@dataclass(frozen=True)
class GeometrySection:
    """The geometry: made by `storage.geometry_writer.geometry_section`; also what `open_geometry` takes."""

    grid_step: float  # model units per grid unit, a power of two
    tables: ShardRecord
    shards: tuple[ShardRecord, ...]  # of packs, in the order of PACK's `shard`
    counts: GeometryCounts


@dataclass(frozen=True)
class CellShardRecord(ShardRecord):
    """A finished shard of cells."""

    cells: int  # how many; they are numbered on from those of the shard before it
    codec: str  # the codec of its groups: storage.cells.codecs


@dataclass(frozen=True)
class CellCounts:
    """How many view cells there are."""

    cells: int
    computed_cells: int


@dataclass(frozen=True)
class CellsSection:
    """The view cells: made by `storage.vlod_writer.cells_section`."""

    octree_lo: Point
    octree_size: float  # edge of the octree's cube, in model units
    table: ShardRecord  # the CELL rows of all cells, and the GROUP rows
    shards: tuple[CellShardRecord, ...]  # in the order of their cells' numbers
    counts: CellCounts
