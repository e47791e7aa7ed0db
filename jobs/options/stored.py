"""How what was found is written."""

from __future__ import annotations

from dataclasses import dataclass

import click

from jobs.options.sections import Section
from storage.base.errors import ParameterError

#: `storage.cells.codecs.DEFAULT`, which needs numpy to be asked.
CODEC = "gap-varint-zstd"


@dataclass(frozen=True)
class StoredParameters:
    """How what was found is written."""

    codec: str = CODEC  # the code of vLODs and their changes: a name of storage.cells.codecs

    def check(self) -> None:
        """Raises ParameterError for a code that is not known."""
        from storage.cells.codecs import codecs

        if self.codec != CODEC and self.codec not in (known := sorted(codecs())):
            raise ParameterError(f"the code of changes must be {' or '.join(known)}, not {self.codec!r}")


SECTION = Section(
    "Store",
    (
        click.Option(
            ["--codec"],
            metavar="NAME",
            default=StoredParameters.codec,
            show_default=True,
            help="The code that cells and the changes between them are written in.",
        ),
    ),
)
