"""What the input files do not say, or say wrongly."""

from __future__ import annotations

from dataclasses import dataclass

import click

from jobs.options.sections import Group, Section
from storage.base.errors import ParameterError

#: Axes that may point up.
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class ModelFileParameters(Group):
    """What the input files do not say, or say wrongly."""

    units: str | None = None  # length unit of the input files; None: what they say
    up: str | None = None  # one of AXES; None: what they say
    keep_far: bool = False  # also what lies absurdly far from nearly all else, which costs all of it precision

    def check(self) -> None:
        """Raises ParameterError for an axis that is none; units are the import's to know."""
        if self.up not in (None, *AXES):
            raise ParameterError(f"up must be x, y or z, not {self.up!r}")


SECTION = Section(
    "Model files",
    (
        click.Option(
            ["--units"],
            metavar="UNIT",
            help="Length unit of the input (mm, m, in ...). Default: what the files say.",
        ),
        click.Option(["--up"], type=click.Choice(AXES), help="Axis that points up. Default: what the files say."),
        click.Option(
            ["--keep-far"],
            is_flag=True,
            help="Keep a few triangles that lie absurdly far from all others. They are left out, and told, "
            "where they would cost all others their precision.",
        ),
    ),
)
