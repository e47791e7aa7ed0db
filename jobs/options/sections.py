"""Options in groups: each group owns its own, and `--help` shows one section a group."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import click


class Section(NamedTuple):
    """A group of options."""

    title: str
    options: tuple[click.Option, ...]


@dataclass(frozen=True)
class Group(ABC):
    """Parameters of a build that belong together. Beside them, in their module, lies the SECTION of their options."""

    @abstractmethod
    def check(self) -> None:
        """Raises ParameterError for what is out of range."""


class SectionedCommand(click.Command):
    """A command whose options come in sections."""

    def __init__(
        self, name: str | None, *, sections: Sequence[Section], params: list[click.Parameter], **others: Any
    ) -> None:
        """params: what belongs to no section, arguments first."""
        self.sections = tuple(sections)
        own = [option for section in sections for option in section.options]
        super().__init__(name, params=[*params, *own], **others)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes the sections, and then the options that belong to none."""
        own = {option for section in self.sections for option in section.options}
        options = (param for param in self.get_params(ctx) if isinstance(param, click.Option))
        others = tuple(option for option in options if option not in own)
        for title, listed in (*self.sections, Section("Other", others)):
            lines = [line for option in listed if (line := option.get_help_record(ctx)) is not None]
            with formatter.section(title):
                formatter.write_dl(lines)
