"""How large an error may look, and on which screen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import click

from jobs.options.sections import Group, Section
from storage.base.errors import ParameterError


@dataclass(frozen=True)
class ScreenParameters(Group):
    """How large an error may look, and on which screen."""

    pixel_error: float = 1.0  # allowed error, in pixels
    screen_height: int = 1080  # in pixels
    field_of_view: float = 60.0  # vertical, in degrees

    def check(self) -> None:
        """Raises ParameterError for what is out of range."""
        if not (math.isfinite(self.pixel_error) and self.pixel_error > 0):
            raise ParameterError(f"the pixel error must be positive, not {self.pixel_error}")

    def pixel_angle(self) -> float:
        """What one pixel spans, in radians: see `storage.model.cut.pixel_angle`. Raises ParameterError."""
        from storage.model.cut import pixel_angle

        return pixel_angle(self.screen_height, self.field_of_view)


SECTION = Section(
    "Error on the screen",
    (
        click.Option(
            ["--pixel-error"],
            type=float,
            default=ScreenParameters.pixel_error,
            show_default=True,
            help="Allowed error on the screen, in pixels.",
        ),
        click.Option(
            ["--screen-height"],
            type=int,
            default=ScreenParameters.screen_height,
            show_default=True,
            help="Of the viewer's screen, in pixels.",
        ),
        click.Option(
            ["--field-of-view"],
            type=float,
            default=ScreenParameters.field_of_view,
            show_default=True,
            help="Of the viewer, vertical, in degrees.",
        ),
    ),
)
