"""How what was found is written."""

from __future__ import annotations

from dataclasses import dataclass

import click

from jobs.options.sections import Group, Section
from storage.base.errors import ParameterError
from storage.cells.codecs import CODECS, DEFAULT


@dataclass(frozen=True)
class StoredParameters(Group):
    """How what was found is written."""

    codec: str = DEFAULT  # of vLODs and their changes: a name of CODECS

    def check(self) -> None:
        """Raises ParameterError for a codec that is not known."""
        if self.codec not in CODECS:
            raise ParameterError(f"--codec must be {' or '.join(CODECS)}, not {self.codec!r}")


SECTION = Section(
    "Store",
    (
        click.Option(
            ["--codec"],
            type=click.Choice(tuple(CODECS)),
            default=StoredParameters.codec,
            show_default=True,
            help="The codec that cells and the changes between them are written in.",
        ),
    ),
)
