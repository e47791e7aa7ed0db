"""Makes small real stores from arrays, for tests of everything that reads one.

    store = make_store(tmp_path / "store", room_parts(), depth=2)

`make_store` writes like a build does. By default each cell's vLOD is its whole cut; pass
`visible` to say otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from storage.cells.codecs import DEFAULT
from storage.cells.octree import Octree
from storage.geometry_reader import Geometry, open_geometry
from storage.geometry_writer import geometry_section, join_geometry, write_geometry_shard, write_tables_shard
from storage.known_cells import KnownCells
from storage.meshes.pack import MeshArrays
from storage.meshes.placement import transform_points
from storage.model.cut import choose_cut, pixel_angle
from storage.model.tables import CELL, DRAWABLE, INSTANCE, NODE, PART, Grid
from storage.shards.manifest import Manifest, commit
from storage.shards.sections import GeometrySection, ModelSection
from storage.store import Store, open_store
from storage.vlod_writer import cells_section, write_cell_shard


@dataclass(frozen=True)
class TinyPart:
    """A mesh with its levels, placed once or several times."""

    name: str
    levels: Sequence[tuple[np.ndarray, np.ndarray]]  # (positions (n, 3), triangles (m, 3)), finest first
    errors: Sequence[float] = (0.0,)  # of each level, in local units, increasing
    matrices: Sequence[np.ndarray] = ()  # (3, 4) each; none: the mesh lies in model space already
    colour: tuple[int, int, int, int] = (200, 200, 200, 255)
    one_sided: bool = False
    normals: Sequence[np.ndarray] = field(default=())  # (n, 3) of each level; none: made from the triangles


def box_part(
    name: str,
    lo: Sequence[float],
    hi: Sequence[float],
    *,
    segments: Sequence[int] = (4, 1),
    colour: tuple[int, int, int, int] = (200, 200, 200, 255),
    matrices: Sequence[np.ndarray] = (),
    errors: Sequence[float] | None = None,
) -> TinyPart:
    """A closed box with outward normals; one level for each number of segments along an edge, finest first."""
    levels = [_box(np.asarray(lo, float), np.asarray(hi, float), count) for count in segments]
    given = [0.001 * 4**level for level in range(len(levels))] if errors is None else list(errors)
    normals = [_box_normals(count) for count in segments]
    return TinyPart(name, levels, given, matrices, colour, True, normals)


def room_parts() -> list[TinyPart]:
    """A floor, four walls, a table and six chairs (one mesh, six instances, one of them mirrored); 8 x 6 x 3 units."""
    walls = [
        box_part("floor", (0, 0, -0.1), (8, 6, 0), segments=(8, 2), colour=(120, 110, 100, 255)),
        box_part("wall west", (-0.1, 0, 0), (0, 6, 3), segments=(6, 1)),
        box_part("wall east", (8, 0, 0), (8.1, 6, 3), segments=(6, 1)),
        box_part("wall south", (0, -0.1, 0), (8, 0, 3), segments=(6, 1)),
        box_part("wall north", (0, 6, 0), (8, 6.1, 3), segments=(6, 1)),
        box_part("table", (3, 2.5, 0.7), (5, 3.5, 0.75), segments=(4, 2, 1), colour=(150, 100, 60, 255)),
    ]
    turns = []
    for number in range(6):
        angle = number * np.pi / 3
        sine, cosine = np.sin(angle), np.cos(angle)
        mirror = -1.0 if number == 5 else 1.0
        turns.append(
            np.array(
                [
                    [cosine, -sine * mirror, 0, 4 + 1.6 * cosine],
                    [sine, cosine * mirror, 0, 3 + 1.2 * sine],
                    [0, 0, 1, 0],
                ]
            )
        )
    chair = box_part(
        "chair", (-0.2, -0.2, 0), (0.2, 0.2, 0.45), segments=(4, 2, 1), colour=(60, 90, 150, 255), matrices=turns
    )
    return [*walls, chair]


def make_geometry(root: Path, parts: Sequence[TinyPart]) -> tuple[GeometrySection, Octree, ModelSection]:
    """Writes the geometry of a store: the manifest's section about it, an octree around it, what the manifest says of
    the model.
    """
    placed = [_placed(part) for part in parts]
    lo = np.min([box[0] for boxes in placed for box in boxes], axis=0)
    hi = np.max([box[1] for boxes in placed for box in boxes], axis=0)
    grid = Grid.for_extent(float(np.abs([lo, hi]).max()) * 1.01)
    record = write_geometry_shard(root, [(0, _levels(part, grid)) for part in parts])
    geometry, packs, shards = join_geometry([record])

    part_rows, names, instances, nodes, drawables = [], [], [], [], []
    first_geometry = 0
    for mesh, part in enumerate(parts):
        matrices = part.matrices or [None]
        for placement, matrix in enumerate(matrices):
            node = np.zeros((), NODE)
            node["first_drawable"], node["levels"], node["part"] = len(drawables), len(part.levels), len(part_rows)
            node["end"] = len(nodes) + 1
            if matrix is not None:
                instances.append(np.array((matrix,), INSTANCE))
            stretch = 1.0 if matrix is None else float(np.linalg.svd(matrix[:, :3], compute_uv=False).max())
            for level in range(len(part.levels)):
                row = np.zeros((), DRAWABLE)
                row["node"], row["level"], row["geometry"] = len(nodes), level, first_geometry + level
                row["instance"] = -1 if matrix is None else len(instances) - 1
                row["triangles"] = geometry["triangles"][first_geometry + level]
                row["error"] = part.errors[level] * stretch + 2 * grid.step
                box = placed[mesh][placement]
                row["lo"] = np.nextafter((box[0] - 2 * grid.step).astype(np.float32), np.float32(-np.inf))
                row["hi"] = np.nextafter((box[1] + 2 * grid.step).astype(np.float32), np.float32(np.inf))
                row["see_through"] = part.colour[3] < 255
                row["one_sided"] = part.one_sided and not row["see_through"]
                drawables.append(row)
            node["lo"], node["hi"] = row["lo"], row["hi"]
            nodes.append(node)
            part_rows.append(np.array((mesh, len(part.levels[0][1])), PART))
            names.append(part.name)
        first_geometry += len(part.levels)
    tables = write_tables_shard(
        root,
        np.array(part_rows, PART),
        names,
        np.array(instances, INSTANCE),
        geometry,
        packs,
        np.array(nodes, NODE),
        np.array(drawables, DRAWABLE),
    )
    margin = 0.05 * (hi - lo).max()
    model = ModelSection(
        digest="tiny",
        triangles=int(sum(len(part.levels[0][1]) * max(1, len(part.matrices)) for part in parts)),
        lo=tuple(lo.tolist()),
        hi=tuple(hi.tolist()),
        origin=(0.0, 0.0, 0.0),
        up="z",
        unit_in_metres=1.0,
    )
    return geometry_section(grid.step, tables, shards), Octree.around(lo - margin, hi + margin), model


def make_store(
    root: Path,
    parts: Sequence[TinyPart],
    *,
    depth: int = 2,
    keys: Sequence[int] | None = None,
    visible: Callable[[Geometry, np.ndarray, np.ndarray], np.ndarray] | None = None,
    uncomputed: Collection[int] = (),
    pixel_error: float = 1.0,
    raised: Mapping[int, float] = MappingProxyType({}),
    triangles_per_cell: int = 1000,
    screen_height: int = 1080,
    field_of_view: float = 60.0,
    cells_per_shard: int = 16,
    codecs: Sequence[str] = (DEFAULT,),
) -> Store:
    """Writes a store to `root` and opens it.

    depth: all cells of the octree at that depth, in Morton order; keys: these cells instead (a leaf set in Morton
    order); visible(geometry, cell, cut): the vLOD of a CELL row, sorted ids out of its cut; uncomputed: numbers of
    cells that are listed but were not computed; raised: cells with a pixel error of
    their own; cells_per_shard: cells in each cell shard; codecs: the codecs of the shards, by turns.
    """
    section, octree, model = make_geometry(root, parts)
    angle = pixel_angle(screen_height, field_of_view)
    geometry = open_geometry(root, section)
    leaves = np.arange(8**depth, 2 * 8**depth, dtype=np.uint64) if keys is None else np.asarray(keys, np.uint64)
    lo, hi = octree.boxes(leaves)
    cells = np.zeros(len(leaves), CELL)
    cells["key"], cells["lo"], cells["hi"] = leaves, lo, hi
    cells["depth"] = [(int(key).bit_length() - 1) // 3 for key in leaves]
    cells["pixel_error"] = [raised.get(number, pixel_error) for number in range(len(cells))]
    sets = []
    sizes = geometry.drawables["triangles"].astype(np.int64)
    for number, cell in enumerate(cells):
        if number in uncomputed:
            sets.append(np.zeros(0, np.uint32))
            continue
        cut = choose_cut(geometry.nodes, geometry.drawables, cell["lo"], cell["hi"], angle, float(cell["pixel_error"]))
        ids = cut if visible is None else np.asarray(visible(geometry, cell, cut))
        cell["computed"] = True
        cell["cut_drawables"], cell["cut_triangles"] = len(cut), sizes[cut].sum()
        cell["drawables"], cell["triangles"] = len(ids), sizes[ids].sum()
        turned = geometry.facets(ids).turned_away(ids, cell["lo"], cell["hi"])
        cell["turned_triangles"] = turned.triangle_counts.sum()
        cell["proven_drawables"], cell["proven_triangles"] = len(ids), sizes[ids].sum()
        sets.append(ids.astype(np.uint32))
    known = KnownCells(geometry.nodes, geometry.drawables, angle)
    shards = []
    for first in range(0, len(cells), cells_per_shard):
        last = min(first + cells_per_shard, len(cells))
        codec = codecs[len(shards) % len(codecs)]
        shards.append(write_cell_shard(root, cells[first:last], sets[first:last], known, codec=codec))
    manifest = Manifest(
        model=model,
        pixel_angle=angle,
        parameters={
            "screen_height": screen_height,
            "field_of_view": field_of_view,
            "pixel_error": pixel_error,
            "max_depth": depth,
            "triangles_per_cell": triangles_per_cell,
        },
        geometry=section,
        cells=cells_section(root, octree, shards),
    )
    commit(root, manifest)
    return open_store(root)


def mistold(store: Store, wrong: list[int]) -> Store:
    """The store with tables that say the opposite of some drawables: as sound as any to checksums."""
    root = Path(store.files.url)
    rows = store.drawables.copy()
    rows["see_through"][wrong] ^= True
    rows["one_sided"][wrong] = False
    tables = write_tables_shard(
        root, store.parts, store.part_names, store.instances, store.geometry, store.packs, store.nodes, rows
    )
    section = geometry_section(store.grid.step, tables, list(store.manifest.geometry.shards))
    commit(root, replace(store.manifest, geometry=section))
    return open_store(root)


def _levels(part: TinyPart, grid: Grid) -> list[MeshArrays]:
    scale = grid.step
    if part.matrices:
        largest = max(float(np.linalg.svd(matrix[:, :3], compute_uv=False).max()) for matrix in part.matrices)
        scale = float(2.0 ** np.floor(np.log2(grid.step / largest)))
    result = []
    for level, (positions, triangles) in enumerate(part.levels):
        normals = part.normals[level] if part.normals else _vertex_normals(positions, triangles)
        numbers = np.arange(len(triangles), dtype=np.uint32)
        faces = np.stack([0 * numbers, numbers], axis=1) if level == 0 else None
        colours = np.tile(np.array(part.colour, np.uint8), (len(positions), 1))
        integers = np.rint(np.asarray(positions, float) / scale).astype(np.int32)
        result.append(
            MeshArrays(
                integers, np.asarray(triangles, np.uint32), np.asarray(normals, np.float32), colours, faces, scale
            )
        )
    return result


def _placed(part: TinyPart) -> list[tuple[np.ndarray, np.ndarray]]:
    """The box of each placement, around all levels."""
    points = np.concatenate([positions for positions, _ in part.levels]).astype(float)
    placements = [transform_points(matrix, points) for matrix in part.matrices] or [points]
    return [(placed.min(axis=0), placed.max(axis=0)) for placed in placements]


def _vertex_normals(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (np.asarray(positions, float)[triangles[:, corner]] for corner in range(3))
    normals = np.zeros((len(positions), 3))
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], np.cross(b - a, c - a))
    lengths = np.linalg.norm(normals, axis=1)
    normals[lengths == 0] = (0, 0, 1)
    return normals / np.where(lengths > 0, lengths, 1)[:, None]


_SIDES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


def _box(lo: np.ndarray, hi: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    steps = np.linspace(0, 1, count + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    quads = np.stack([corner, corner + count + 1, corner + count + 2, corner + 1], axis=1)
    positions, triangles = [], []
    for axis, first, second in _SIDES:
        for end in (0, 1):
            side = np.zeros((len(u), 3))
            side[:, axis], side[:, first], side[:, second] = end, u, v
            order = quads if end else quads[:, ::-1]
            triangles += [order[:, [0, 1, 2]] + len(u) * len(positions), order[:, [0, 2, 3]] + len(u) * len(positions)]
            positions.append(lo + side * (hi - lo))
    return np.concatenate(positions), np.concatenate(triangles).astype(np.uint32)


def _box_normals(count: int) -> np.ndarray:
    normals = []
    for axis, _, _ in _SIDES:
        for sign in (-1.0, 1.0):
            normal = np.zeros((1, 3), np.float32)
            normal[0, axis] = sign
            normals.append(np.repeat(normal, (count + 1) ** 2, axis=0))
    return np.concatenate(normals)
