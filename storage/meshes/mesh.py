"""Meshes as a store gives them out: in their own coordinates, and placed in model space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from storage.meshes.normals import from_octahedral
from storage.meshes.placement import normal_matrix, placed, transform_points


class LocalMesh(NamedTuple):
    """A mesh as stored, in its own coordinates: local position = integer * scale. Instances share it."""

    positions: NDArray[np.int32]  # (n, 3)
    triangles: NDArray[np.uint32]  # (m, 3)
    folded: NDArray[np.int16]  # (n, 2), the normals in octahedral coordinates: storage.meshes.normals
    colours: NDArray[np.uint8]  # (n, 4)
    scale: float  # local units per integer step, a power of two

    @property
    def normals(self) -> NDArray[np.float32]:
        """Unit normals (n, 3), unfolded now. Read-only."""
        normals = from_octahedral(self.folded.astype(np.int32))
        normals.flags.writeable = False
        return normals


class Mesh(NamedTuple):
    """A drawable's triangles in model space."""

    positions: NDArray[np.float32]  # (n, 3), model units; each an exact integer multiple of the grid's step
    triangles: NDArray[np.uint32]  # (m, 3), counter-clockwise as seen from the side the normals point to
    normals: NDArray[np.float32]  # (n, 3), unit
    colours: NDArray[np.uint8]  # (n, 4), red, green, blue, opacity


class Surfaces(NamedTuple):
    """The triangles of several drawables in grid coordinates, one drawable after the other."""

    points: NDArray[np.int32]  # (n, 3), multiples of grid.step
    triangles: NDArray[np.int64]  # (m, 3) into points, wound as in `Mesh`
    vertex_counts: NDArray[np.int64]  # (d,) points of each drawable
    triangle_counts: NDArray[np.int64]  # (d,) triangles of each drawable


def in_model_space(local: LocalMesh, matrix: NDArray[np.float64] | None, step: float) -> Mesh:
    """A mesh placed by a matrix (3, 4), or where it is for None.

    step: of the grid, in model units. Positions are exact integer multiples of it; placed ones are snapped to it. Their
    normals are turned by the inverse transpose of the matrix, and the winding of mirrored ones is reversed.
    """
    triangles, normals = local.triangles, local.normals
    if matrix is None:
        positions = (local.positions * np.float64(local.scale)).astype(np.float32)
    else:
        on_grid = placed(local.positions, local.scale, matrix, step)
        positions = (on_grid * np.float64(step)).astype(np.float32)
        linear, mirrored = normal_matrix(matrix)
        normals = _unit(transform_points(np.column_stack([linear, np.zeros(3)]), normals))
        if mirrored:
            triangles = np.ascontiguousarray(triangles[:, [0, 2, 1]])
            triangles.flags.writeable = False
    positions.flags.writeable = False
    return Mesh(positions, triangles, normals, local.colours)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float32]:
    """Vectors (n, 3) scaled to unit length; +z where there is no direction. Read-only."""
    x, y, z = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    lengths = np.sqrt((x * x + y * y) + z * z)
    result = np.where(lengths[:, None] > 0, vectors / np.where(lengths > 0, lengths, 1)[:, None], [0.0, 0.0, 1.0])
    unit = result.astype(np.float32)
    unit.flags.writeable = False
    return unit
