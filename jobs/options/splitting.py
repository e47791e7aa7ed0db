"""How the octree of view cells is split."""

from __future__ import annotations

import math
from dataclasses import dataclass

import click

from jobs.options.sections import Group, Section
from storage.base.errors import ParameterError


@dataclass(frozen=True)
class SplittingParameters(Group):
    """How the octree of view cells is split."""

    triangles_per_cell: int = 50_000  # cells that see more are split, down to max_depth
    max_triangles: int | None = None  # no cell reports more: at max_depth its pixel error is raised; None: any number
    max_depth: int = 5  # of the octree of cells; the root has depth 0
    cell_size: float | None = None  # in model units: the edge of every cell; takes the place of all but max_triangles

    def check(self) -> None:
        """Raises ParameterError for what is out of range."""
        from storage.cells.octree import MAX_DEPTH

        if self.triangles_per_cell < 1:
            raise ParameterError(f"triangles per cell must be at least 1, not {self.triangles_per_cell}")
        if self.max_triangles is not None and self.max_triangles < 1:
            raise ParameterError(f"max triangles must be at least 1, not {self.max_triangles}")
        if not 0 <= self.max_depth <= MAX_DEPTH:
            raise ParameterError(f"the depth of the octree must be from 0 to {MAX_DEPTH}, not {self.max_depth}")
        if self.cell_size is not None and not (math.isfinite(self.cell_size) and self.cell_size > 0):
            raise ParameterError(f"the cell size must be positive, not {self.cell_size}")


SECTION = Section(
    "View cells",
    (
        click.Option(
            ["--triangles-per-cell"],
            type=int,
            default=SplittingParameters.triangles_per_cell,
            show_default=True,
            help="Split cells that see more triangles, as long as the octree may get deeper and it saves something: "
            "what is aimed at, no guarantee.",
        ),
        click.Option(
            ["--max-triangles"],
            type=int,
            metavar="N",
            help="No cell reports more triangles, whatever it takes: cells that do are split, and at the deepest level "
            "their pixel error is raised; `vlod info` lists these. Default: no such bound.",
        ),
        click.Option(
            ["--max-depth"],
            type=int,
            default=SplittingParameters.max_depth,
            show_default=True,
            help="Levels of the octree of cells.",
        ),
        click.Option(
            ["--cell-size"],
            type=float,
            metavar="LENGTH",
            help="Edge of every cell in model units, whatever --triangles-per-cell and --max-depth.",
        ),
    ),
)
