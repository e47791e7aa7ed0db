"""The tables of a store: what is stored about the model, as numpy structured dtypes.

All dtypes are little-endian and packed, so their bytes are the same on every machine.
Lengths are in model units unless a field says "grid units"; one grid unit is `Grid.step` model units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: A mesh placed in the model: which of the model's names it bears and how many faces it has.
PART = np.dtype(
    [
        ("mesh", "<u4"),  # index of the imported mesh that the part places
        ("faces", "<u4"),  # triangles of the part
    ]
)

#: The placement of an instanced mesh: model position = matrix @ (x, y, z, 1).
INSTANCE = np.dtype([("matrix", "<f8", (3, 4))])

#: One mesh as stored: where it lies inside its pack, a frame of several meshes that are fetched together.
#: Positions are integers; local position = integer * scale (scale is a power of two, in local units).
GEOMETRY = np.dtype(
    [
        ("pack", "<u4"),  # index into PACK
        ("vertex_start", "<u4"),  # first vertex inside the pack
        ("vertices", "<u4"),
        ("triangle_start", "<u4"),  # first triangle inside the pack
        ("triangles", "<u4"),
        ("scale", "<f8"),  # local units per integer step, a power of two
    ]
)

#: Where the compressed bytes of a pack of meshes lie.
PACK = np.dtype(
    [
        ("shard", "<u4"),  # index into the manifest's list of geometry shards
        ("frame", "<u4"),  # index of the frame inside the shard
        ("source_frame", "<i4"),  # index of the frame with the triangles' source faces, -1: none are kept
        ("vertices", "<u4"),
        ("triangles", "<u4"),
    ]
)

#: A node of the hierarchy with its levels: drawables first_drawable ... first_drawable + levels - 1, finest first.
#: Nodes are in preorder: the nodes below node i are i + 1 ... end - 1, its first child is i + 1, the next sibling of
#: a node is its `end`. A node stands for the same surface as its children together, and its box holds theirs.
#: A build makes two trees at most: one of all that is opaque, and behind it one of all that can be seen through.
NODE = np.dtype(
    [
        ("end", "<u4"),  # first node after all below this one; a leaf's own index + 1
        ("first_drawable", "<u4"),
        ("levels", "<u4"),
        ("part", "<u4"),  # index into PART of the part that the node is of; NO_PART where it is of several
        ("lo", "<f4", (3,)),  # box around all levels and the surface they stand for
        ("hi", "<f4", (3,)),
    ]
)

#: In place of a node's part: its triangles come from more than one, or it is an inner node.
NO_PART = 0xFFFFFFFF

#: One (node, level): the unit of visibility, storage and drawing.
DRAWABLE = np.dtype(
    [
        ("node", "<u4"),
        ("level", "<u4"),  # 0 is the finest
        ("geometry", "<u4"),  # index into GEOMETRY; instances share it
        ("instance", "<i4"),  # index into INSTANCE, -1: the mesh lies in model space already
        ("triangles", "<u4"),
        ("error", "<f4"),  # at least the two-sided Hausdorff distance to the model's surface, quantisation included
        ("lo", "<f4", (3,)),  # box of the drawable's mesh, rounded outward
        ("hi", "<f4", (3,)),
        ("one_sided", "?"),  # only fronts count: see storage.meshes.facets
        ("see_through", "?"),  # all its triangles have an alpha below 255, and hide nothing; else none has
    ]
)

#: A view cell with what was found for it.
CELL = np.dtype(
    [
        ("key", "<u8"),  # location code in the octree: see storage.cells.octree
        ("depth", "<u4"),
        ("lo", "<f8", (3,)),
        ("hi", "<f8", (3,)),
        ("computed", "?"),
        ("pixel_error", "<f4"),  # allowed error of the cell's cut in pixels; above the build's where it was raised to
        # keep the most triangles that a cell may report
        ("cut_drawables", "<u4"),
        ("cut_triangles", "<u8"),
        ("drawables", "<u4"),  # drawables reported as visible: the size of the cell's vLOD
        ("triangles", "<u8"),  # triangles reported as visible
        ("turned_triangles", "<u8"),  # of these, in facets that show the cell only their backs: not drawn
        ("proven_drawables", "<u4"),  # of these, proven visible: a ray from the cell surely meets them first
        ("proven_triangles", "<u8"),
        ("hold_out_rays", "<u4"),  # rays that measured what is missed (--sampled, --seal); 0: nothing is
        ("missed_rays", "<u4"),  # of these, met first what is not in the vLOD
    ]
)

#: Cells that follow each other in the store and whose vLODs are coded together: a frame of their shard.
GROUP = np.dtype(
    [
        ("cells", "<u4"),  # how many, computed or not: they follow those of the group before
    ]
)

#: Grid coordinates stay within +-GRID_LIMIT, so float32 holds them exactly.
GRID_LIMIT = 1 << 23


@dataclass(frozen=True)
class Grid:
    """The model-wide position grid: every position a store gives out is an integer multiple of `step`.

    Abutting meshes meet in exactly equal vertices on it, which is what lets edges be identified by position.
    """

    step: float  # model units per grid unit, a power of two

    @staticmethod
    def for_extent(largest: float) -> Grid:
        """The finest grid that holds coordinates up to ±`largest` model units within ±GRID_LIMIT."""
        if not np.isfinite(largest) or largest < 0:
            raise ValueError(f"largest coordinate must be finite and not negative, not {largest}")
        if largest == 0:
            return Grid(2.0**-23)
        _, exponent = np.frexp(np.float64(largest) * 1.001)
        return Grid(float(2.0 ** (int(exponent) - 23)))

    def snap(self, points: np.ndarray) -> np.ndarray:
        """Grid coordinates (int32, same shape) of float64 model positions."""
        return np.rint(np.asarray(points, np.float64) * (1.0 / self.step)).astype(np.int32)
