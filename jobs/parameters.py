"""What a build is asked for."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from jobs.cells.parameters import CellParameters, Visibility
from jobs.detail.detail_options import DetailOptions
from jobs.objects.object_options import Clustering, Limits, ObjectOptions
from jobs.visibility.methods import METHODS
from storage.base.errors import ParameterError
from storage.cells.codecs import DEFAULT, codecs
from storage.cells.octree import MAX_DEPTH, Octree
from storage.model.cut import pixel_angle

#: How much the view space exceeds the model's box on every side by default, as a fraction of the box.
VIEW_MARGIN = 0.02

#: Objects have at most this many times the triangles that a part has before it may be split: t2 / t1.
AGAIN = 10

#: Named settings of what objects are. "gigawalk": the paper's (W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002,
#: sections 4.2 and 6.3.1). "balanced": smaller clusters and a tighter limit of size. Along the demo's path it draws
#: 77,770 triangles a frame where the paper's draw 123,299, culling by the view alone 161,466 where they draw 200,192;
#: with parts of 300 triangles these would be 65,638, but what is far away takes two to four times as many.
OBJECTS: dict[str, dict[str, float]] = {
    "balanced": {"object_triangles": 1000, "object_size": 0.05, "object_ratio": 2.5, "cluster_volume": 1e-5},
    "gigawalk": {"object_triangles": 1000, "object_size": 0.1, "object_ratio": 2.5, "cluster_volume": 1e-3},
}

#: Names of the settings of `jobs.visibility.engine.QUALITIES`, which needs compiled kernels to be asked.
QUALITY_NAMES = ("draft", "normal", "high")

Box = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class BuildParameters:
    """Parameters of a build. Lengths are in model units: the coordinates of the (first) input file."""

    view_box: Box | None = None  # x0 y0 z0 x1 y1 z1: where the viewer may be; None: the model's box, slightly larger
    region: Box | None = None  # only cells that touch it are computed; None: all
    triangles_per_cell: int = 50_000  # cells that see more are split, down to max_depth
    max_triangles: int | None = None  # no cell reports more: at max_depth its pixel error is raised; None: any number
    max_depth: int = 5  # of the octree of cells; the root has depth 0
    quality: str = "normal"  # draft, normal or high: how much time a cell may take to see what is hidden
    cell_size: float | None = None  # cells are not split below this edge; takes the place of max_depth
    pixel_error: float = 1.0  # allowed error, in pixels
    sampled: bool = False  # cells hold what rays meet: smaller, but may miss what can be seen
    seal: float | None = None  # gaps narrower than this count as closed: may miss what is seen through; None: none do
    screen_height: int = 1080  # in pixels
    field_of_view: float = 60.0  # vertical, in degrees
    object_triangles: int = 1000  # t1 of Partition I: parts with more are split if they are large or long
    object_size: float = 0.05  # s1: large is a diagonal above this part of the model's
    object_ratio: float = 2.5  # r1: long is a box whose longest edge is this many times its shortest
    cluster_distance: float = 0.1  # D: parts nearer than this part of the model's extent may become one object
    cluster_cardinality: float = 1500.0  # K: about how many parts one object is made of at most
    cluster_volume: float = 1e-5  # V: largest box of an object of several parts, as a part of the model's
    visibility_engine: str = METHODS[0]  # how what is hidden is found: one of METHODS
    codec: str = DEFAULT  # the code that vLODs and their changes are written in: a name of storage.cells.codecs
    units: str | None = None  # length unit of the input files; None: what they say
    up: str | None = None  # x, y or z; None: what they say

    def __post_init__(self) -> None:
        for name, box in (("view box", self.view_box), ("region", self.region)):
            if box is None:
                continue
            if len(box) != 6 or not all(math.isfinite(value) for value in box):
                raise ParameterError(f"the {name} needs six finite numbers x0 y0 z0 x1 y1 z1, not {box}")
            if not all(low < high for low, high in zip(box[:3], box[3:], strict=True)):
                raise ParameterError(f"the {name} needs x0 < x1, y0 < y1 and z0 < z1, not {box}")
        if self.triangles_per_cell < 1:
            raise ParameterError(f"triangles per cell must be at least 1, not {self.triangles_per_cell}")
        if self.max_triangles is not None and self.max_triangles < 1:
            raise ParameterError(f"max triangles must be at least 1, not {self.max_triangles}")
        if self.quality not in QUALITY_NAMES:
            raise ParameterError(f"the quality must be one of {', '.join(QUALITY_NAMES)}, not {self.quality!r}")
        if not 0 <= self.max_depth <= MAX_DEPTH:
            raise ParameterError(f"the depth of the octree must be from 0 to {MAX_DEPTH}, not {self.max_depth}")
        for name, value in (
            ("cell size", self.cell_size),
            ("pixel error", self.pixel_error),
            ("distance to seal", self.seal),
        ):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ParameterError(f"the {name} must be positive, not {value}")
        self.detail()
        self.objects()
        if self.visibility_engine not in METHODS:
            raise ParameterError(
                f"the visibility engine must be {' or '.join(METHODS)}, not {self.visibility_engine!r}"
            )
        if self.seal is not None and self.sampled:
            raise ParameterError("--seal closes gaps for what hides, --sampled asks rays alone: use one of the two")
        if self.seal is not None and self.visibility_engine != METHODS[0]:
            raise ParameterError(f"--seal works with --visibility-engine {METHODS[0]}, not {self.visibility_engine}")
        if self.codec != DEFAULT and self.codec not in (known := sorted(codecs())):
            raise ParameterError(f"the code of changes must be {' or '.join(known)}, not {self.codec!r}")
        if self.up not in (None, "x", "y", "z"):
            raise ParameterError(f"up must be x, y or z, not {self.up!r}")

    def detail(self) -> DetailOptions:
        """How pieces and levels are made: Partition I. Raises ParameterError."""
        return DetailOptions(
            Limits(self.object_triangles, self.object_size, self.object_ratio, AGAIN * self.object_triangles)
        )

    def objects(self) -> ObjectOptions:
        """How pieces become objects: clustering and Partition II. Raises ParameterError."""
        return ObjectOptions(
            Clustering(self.cluster_distance, self.cluster_cardinality, self.cluster_volume),
            Limits(
                AGAIN * self.object_triangles,
                2 * self.object_size,
                max(1.0, self.object_ratio / 2),
                AGAIN * self.object_triangles,
            ),
        )

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
            visibility=Visibility(self.quality, self.visibility_engine, self.sampled, self.seal or 0.0),
        )

    def pixel_angle(self) -> float:
        """What one pixel spans, in radians: see `storage.model.cut.pixel_angle`. Raises ParameterError."""
        return pixel_angle(self.screen_height, self.field_of_view)

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
    max_depth: int


def view_space(
    parameters: BuildParameters, model_lo: np.ndarray, model_hi: np.ndarray, origin: np.ndarray
) -> ViewSpace:
    """The octree and the box of cells for a model with the box model_lo to model_hi (3,), in model space.

    Raises ParameterError where the region lies outside the view box.
    """
    if parameters.view_box is None:
        size = model_hi - model_lo
        margin = np.maximum(VIEW_MARGIN * size, 1e-3 * VIEW_MARGIN * size.max())
        lo, hi = model_lo - margin, model_hi + margin
    else:
        lo, hi = _corners(parameters.view_box, origin)
    octree = Octree.around(lo, hi)
    depth = parameters.max_depth
    if parameters.cell_size is not None:
        depth = min(MAX_DEPTH, max(0, math.floor(math.log2(octree.size / parameters.cell_size) + 1e-9)))
    if parameters.region is not None:
        region_lo, region_hi = _corners(parameters.region, origin)
        lo, hi = np.maximum(lo, region_lo), np.minimum(hi, region_hi)
        if not (lo < hi).all():
            raise ParameterError(
                f"the region {parameters.region} lies outside the view space, which is "
                f"{np.round(np.concatenate([lo, hi]) + np.tile(origin, 2), 6).tolist()}: choose a region inside it"
            )
    return ViewSpace(
        octree, (float(lo[0]), float(lo[1]), float(lo[2])), (float(hi[0]), float(hi[1]), float(hi[2])), depth
    )


def _corners(box: Box, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(box[:3], np.float64) - origin, np.asarray(box[3:], np.float64) - origin
