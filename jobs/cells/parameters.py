"""What decides the view cells and what they hold. Light to import: a build makes its tasks from it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

from jobs.visibility.settings import METHODS, QUALITIES, EngineSettings
from storage.cells.octree import Octree


@dataclass(frozen=True)
class Visibility:
    """How what can be seen from a cell is found: see `jobs.visibility.engine`."""

    quality: str = "normal"  # one of the names of QUALITIES
    method: str = METHODS[0]  # one of METHODS
    sampled: bool = False  # cells hold what rays meet: smaller, but may miss what can be seen
    seal: float = 0.0  # gaps narrower than this count as closed, in model units

    def settings(self) -> EngineSettings:
        """The engine's settings."""
        return dataclasses.replace(QUALITIES[self.quality], method=self.method, sampled=self.sampled, seal=self.seal)


@dataclass(frozen=True)
class CellParameters:
    """What decides the view cells and what they hold. Lengths in model units."""

    octree: Octree
    view_lo: tuple[float, float, float]  # cells that do not touch this box are left out
    view_hi: tuple[float, float, float]
    max_depth: int  # deepest level of cells
    triangles_per_cell: int  # cells with a larger vLOD are split, where that saves something
    max_triangles: int | None  # no cell reports more; None: whatever it takes
    pixel_angle: float  # see storage.model.cut.pixel_angle
    pixel_error: float  # allowed error in pixels; raised where a cell would be above max_triangles
    visibility: Visibility
    min_depth: int = 0  # shallowest level of cells: all above are split

    @cached_property
    def engine(self) -> EngineSettings:
        """The settings of the engine that looks."""
        return self.visibility.settings()

    def most_triangles(self, depth: int) -> int | None:
        """The largest vLOD that a cell at a depth may have, in triangles, at the allowed error; None: any."""
        if depth == self.max_depth or self.max_triangles is None:
            return self.max_triangles if depth == self.max_depth else self.triangles_per_cell
        return min(self.triangles_per_cell, self.max_triangles)
