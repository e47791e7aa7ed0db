"""Where the viewer may be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import click

from jobs.options.sections import Group, Section
from storage.base.errors import ParameterError

Box = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class ViewSpaceParameters(Group):
    """Where the viewer may be. Lengths in model units."""

    view_box: Box | None = None  # x0 y0 z0 x1 y1 z1: where the viewer may be; None: the model's box, slightly larger
    region: Box | None = None  # only cells that touch it are computed; None: all

    def check(self) -> None:
        """Raises ParameterError for boxes that are none."""
        for name, box in (("view box", self.view_box), ("region", self.region)):
            if box is None:
                continue
            if len(box) != 6 or not all(math.isfinite(value) for value in box):
                raise ParameterError(f"the {name} needs six finite numbers x0 y0 z0 x1 y1 z1, not {box}")
            if not all(low < high for low, high in zip(box[:3], box[3:], strict=True)):
                raise ParameterError(f"the {name} needs x0 < x1, y0 < y1 and z0 < z1, not {box}")


class _Corners(click.Option):
    """An option of six numbers, shown by their names."""

    def __init__(self, names: list[str], help: str) -> None:  # noqa: A002
        super().__init__(names, type=float, nargs=6, metavar="X0 Y0 Z0 X1 Y1 Z1", help=help)


SECTION = Section(
    "View space",
    (
        _Corners(["--view-box"], help="Where the viewer may be, in model units. Default: the model's box and 2 %."),
        _Corners(["--region"], help="Compute only cells that touch this box. Default: the whole view box."),
    ),
)
