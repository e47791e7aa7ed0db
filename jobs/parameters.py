"""What a build is asked for: all groups of `jobs.options` in one, and where cells are computed."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from jobs.cells.parameters import CellParameters, Visibility
from jobs.options.groups import GroupedParameters
from jobs.options.view_space import Box
from storage.base.errors import ParameterError
from storage.cells.octree import MAX_DEPTH, Octree

#: How much the view space exceeds the model's box on every side by default, as a fraction of the box.
VIEW_MARGIN = 0.02


@dataclass(frozen=True)
class BuildParameters(GroupedParameters):
    """Parameters of a build. Lengths are in model units: the coordinates of the (first) input file."""

    def cells(self, space: ViewSpace) -> CellParameters:
        """Which cells there are in a view space, and what they hold. Raises ParameterError."""
        return CellParameters(
            octree=space.octree,
            view_lo=space.lo,
            view_hi=space.hi,
            max_depth=space.max_depth,
            triangles_per_cell=self.triangles_per_cell,
            max_triangles=self.max_triangles,
            pixel_angle=self.pixel_angle(),
            pixel_error=self.pixel_error,
            min_depth=space.min_depth,
            visibility=Visibility(self.quality, self.visibility_engine, self.sampled, self.seal or 0.0),
        )

    def to_json(self) -> dict[str, Any]:
        """All parameters by name, as JSON."""
        return {
            name: list(value) if isinstance(value, tuple) else value for name, value in dataclasses.asdict(self).items()
        }


@dataclass(frozen=True)
class ViewSpace:
    """Where cells are computed, in model space (the model's origin is subtracted)."""

    octree: Octree
    lo: tuple[float, float, float]  # cells that do not reach into this box are skipped
    hi: tuple[float, float, float]
    min_depth: int  # of cells
    max_depth: int


def view_space(
    parameters: BuildParameters, model_lo: np.ndarray, model_hi: np.ndarray, origin: np.ndarray
) -> ViewSpace:
    """The octree and the box of cells for a model with the box model_lo to model_hi (3,), in model space.

    Raises ParameterError where the region lies outside the view box, and for cells too small for an octree of them.
    """
    if parameters.view_box is None:
        size = model_hi - model_lo
        margin = np.maximum(VIEW_MARGIN * size, 1e-3 * VIEW_MARGIN * size.max())
        lo, hi = model_lo - margin, model_hi + margin
    else:
        lo, hi = _corners(parameters.view_box, origin)
    octree = Octree.around(lo, hi)
    shallowest, deepest = 0, parameters.max_depth
    if parameters.cell_size is not None:
        octree, deepest = _octree_of_cells(octree, parameters.cell_size)
        shallowest = deepest
    if parameters.region is not None:
        region_lo, region_hi = _corners(parameters.region, origin)
        within_lo, within_hi = np.maximum(lo, region_lo), np.minimum(hi, region_hi)
        if not (within_lo < within_hi).all():
            raise ParameterError(
                f"the region {parameters.region} lies outside the view space, which is "
                f"{np.round(np.concatenate([lo, hi]) + np.tile(origin, 2), 6).tolist()}: choose a region inside it"
            )
        lo, hi = within_lo, within_hi
    low, high = ((float(corner[0]), float(corner[1]), float(corner[2])) for corner in (lo, hi))
    return ViewSpace(octree, low, high, shallowest, deepest)


def _octree_of_cells(around: Octree, edge: float) -> tuple[Octree, int]:
    """An octree with the same centre whose cells have that edge at some depth, no smaller than `around`; the depth.

    Raises ParameterError where an octree cannot be as deep.
    """
    depth = max(0, math.ceil(math.log2(around.size / edge) - 1e-9))
    if depth > MAX_DEPTH:
        raise ParameterError(
            f"cells of {edge:g} are too small for a view space of {around.size:g}: choose --cell-size "
            f"{around.size / 2**MAX_DEPTH:.2g} or more"
        )
    size = max(around.size, edge * 2**depth)
    x, y, z = ((around.lo[axis] + around.size / 2) - size / 2 for axis in range(3))
    return Octree((x, y, z), size), depth


def _corners(box: Box, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(box[:3], np.float64) - origin, np.asarray(box[3:], np.float64) - origin
