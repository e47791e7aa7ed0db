"""How what can be seen from a cell is found."""

from __future__ import annotations

import math
from dataclasses import dataclass

import click

from jobs.options.sections import Group, Section
from jobs.visibility.settings import METHODS, QUALITIES
from storage.base.errors import ParameterError


@dataclass(frozen=True)
class VisibilityParameters(Group):
    """How what can be seen from a cell is found."""

    quality: str = "normal"  # one of QUALITIES: how much time a cell may take to see what is hidden
    sampled: bool = False  # cells hold what rays meet: smaller, but may miss what can be seen
    seal: float | None = None  # in model units: gaps narrower than this count as closed; may miss what is seen through
    visibility_engine: str = METHODS[0]  # how what is hidden is found: one of METHODS

    def check(self) -> None:
        """Raises ParameterError for what is not known, and what does not go together."""
        if self.quality not in QUALITIES:
            raise ParameterError(f"the quality must be one of {', '.join(QUALITIES)}, not {self.quality!r}")
        if self.seal is not None and not (math.isfinite(self.seal) and self.seal > 0):
            raise ParameterError(f"the distance to seal must be positive, not {self.seal}")
        if self.visibility_engine not in METHODS:
            raise ParameterError(
                f"the visibility engine must be {' or '.join(METHODS)}, not {self.visibility_engine!r}"
            )
        if self.seal is not None and self.sampled:
            raise ParameterError("--seal closes gaps for what hides, --sampled asks rays alone: use one of the two")
        if self.seal is not None and self.visibility_engine != METHODS[0]:
            raise ParameterError(f"--seal works with --visibility-engine {METHODS[0]}, not {self.visibility_engine}")


SECTION = Section(
    "Visibility",
    (
        click.Option(
            ["--quality"],
            type=click.Choice(tuple(QUALITIES)),
            default=VisibilityParameters.quality,
            show_default=True,
            help="How much time a cell may take to find what is hidden, and to prove what is not. draft: about half of "
            "normal's, for up to 5 % more triangles; high: five to six times normal's, for 1 to 5 % fewer; in open "
            "landscapes the difference is larger. None misses what can be seen.",
        ),
        click.Option(
            ["--sampled"],
            is_flag=True,
            help="Keep for each cell what rays from it meet, and nothing else: an approximation that may miss what can "
            "be seen. The chance of a wrong pixel is measured with other rays and stored. Default: miss nothing.",
        ),
        click.Option(
            ["--seal"],
            type=float,
            metavar="DISTANCE",
            help="Gaps narrower than this, in model units, count as closed: an approximation that may miss what is "
            "seen through them. How much is missed is measured and stored. Default: no gap is closed.",
        ),
        click.Option(
            ["--visibility-engine"],
            type=click.Choice(METHODS),
            default=VisibilityParameters.visibility_engine,
            show_default=True,
            help="How what is hidden is found. shrunk-occluders: as in the vLOD paper, to compare with: safe too, but "
            "slower, and cells hold more.",
        ),
    ),
)
