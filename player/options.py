"""The options of `vlod play` and `vlod path`, in groups: each owns its options, their help and what becomes of them.

Names, choices and help of what can be chosen come from its lists (see player.offers). Imports nothing heavy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import reduce
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import click

from player import colouring, strategies
from player.offers import Offer, explained, names
from player.tour import TOURS
from storage.base.amounts import Bytes

Decorator = Callable[[Any], Any]

_MOST_PIXELS = 16384


class Size(click.ParamType):
    """A picture's size, such as 1280x720."""

    name = "WxH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Width and height in pixels."""
        if isinstance(value, tuple):
            return value
        sides = [int(side) if side.isdecimal() else 0 for side in str(value).lower().split("x")]
        if len(sides) != 2 or not all(1 <= side <= _MOST_PIXELS for side in sides):
            what = f"{value!r} is not a size in pixels such as 1280x720 (at most {_MOST_PIXELS} either way)"
            self.fail(what, param, ctx)
        return sides[0], sides[1]


class OptionGroup(Protocol):
    """Options that belong together: a dataclass with a field for each one."""

    TITLE: ClassVar[str]  # of its section in help
    OPTIONS: ClassVar[tuple[Decorator, ...]]  # click's; each gives the field of its name
    __dataclass_fields__: ClassVar[dict[str, Any]]


Group = TypeVar("Group", bound=OptionGroup)


class GroupedCommand(click.Command):
    """A command whose help shows each group of options in a section of its own."""

    groups: Sequence[type[OptionGroup]] = ()

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes a section for each group, and one for the rest."""
        options = [option for option in self.get_params(ctx) if isinstance(option, click.Option)]
        rows = {option.name: option.get_help_record(ctx) for option in options}
        for group in self.groups:
            own = [rows.pop(field.name, None) for field in fields(group)]
            with formatter.section(group.TITLE):
                formatter.write_dl([row for row in own if row is not None])
        with formatter.section("Other options"):
            formatter.write_dl([row for row in rows.values() if row is not None])


def options_of(*groups: type[OptionGroup]) -> Decorator:
    """Gives a GroupedCommand the options of these groups, in this order. Stands above `click.command`."""

    def decorate(command: Any) -> Any:
        command.groups = groups
        return reduce(lambda done, option: option(done), [o for group in groups for o in group.OPTIONS], command)

    return decorate


def taken(group: type[Group], values: dict[str, Any]) -> Group:
    """What was chosen of a group's options, out of all values that the command was given."""
    return group(**{field.name: values[field.name] for field in fields(group)})


def _choice(*declarations: str, offers: Sequence[Offer], help: str, default: bool = True) -> Decorator:  # noqa: A002
    """An option to choose one of the offers; the first of them by default, or none."""
    return click.option(
        *declarations,
        type=click.Choice(names(offers)),
        default=offers[0].name if default else None,
        show_default=default,
        help=f"{help} {explained(offers)}",
    )


@dataclass(frozen=True)
class Drawing:
    """What is drawn, and how it looks."""

    strategy: str
    pixel_error: float | None  # in pixels of the screen that the store was built for
    colours: str
    fog: float  # per model unit

    TITLE: ClassVar[str] = "What is drawn"
    OPTIONS: ClassVar[tuple[Decorator, ...]] = (
        _choice("--strategy", offers=strategies.STRATEGIES, help="How to choose what to draw."),
        click.option(
            "--pixel-error",
            type=click.FloatRange(min=0, min_open=True),
            help="Allowed error in pixels of the screen that the store was built for; another than that is an "
            "approximation that may miss what can be seen. Default: as it was built.",
        ),
        _choice("--colours", offers=colouring.COLOURINGS, help="What the colours show."),
        click.option(
            "--fog",
            type=click.FloatRange(min=0),
            default=0.0,
            show_default=True,
            help="Fade with distance, per model unit.",
        ),
    )


@dataclass(frozen=True)
class Picture:
    """The picture's size, lens and quality."""

    size: tuple[int, int]  # in pixels
    field_of_view: float | None  # in degrees
    samples: str  # per pixel
    gl33: bool

    TITLE: ClassVar[str] = "Picture"
    OPTIONS: ClassVar[tuple[Decorator, ...]] = (
        click.option("--size", type=Size(), default="1280x720", show_default=True, help="In pixels."),
        click.option(
            "--field-of-view",
            type=click.FloatRange(1, 170),
            help="Vertical, in degrees. Default: what the store was built for.",
        ),
        click.option(
            "--samples", type=click.Choice(["0", "2", "4", "8"]), default="0", show_default=True, help="Per pixel."
        ),
        click.option("--gl33", is_flag=True, help="Use no more than OpenGL 3.3, as on old drivers."),
    )


@dataclass(frozen=True)
class Loading:
    """How geometry comes from the store."""

    cache: int  # in bytes
    threads: int
    prefetch: bool
    wait: bool
    cache_dir: Path | None
    cache_bytes: int

    TITLE: ClassVar[str] = "Loading"
    OPTIONS: ClassVar[tuple[Decorator, ...]] = (
        click.option("--cache", type=Bytes(), default="1GiB", show_default=True, help="Budget of geometry on the GPU."),
        click.option("--threads", type=click.IntRange(1, 64), default=4, show_default=True, help="That load geometry."),
        click.option("--prefetch/--no-prefetch", default=True, show_default=True, help="Load ahead of the motion."),
        click.option(
            "--wait/--no-wait",
            default=True,
            show_default=True,
            help="Headless: frames wait for their geometry, so that pictures do not depend on the disk's or network's "
            "speed. What cannot be read is not waited for: other levels stand in, and the exit code is 1.",
        ),
        click.option(
            "--cache-dir",
            type=click.Path(path_type=Path, file_okay=False),
            help="Folder that keeps what comes from a server for the next time; several players may share it.",
        ),
        click.option(
            "--cache-bytes", type=Bytes(), default="1GiB", show_default=True, help="Budget of --cache-dir's folder."
        ),
    )


@dataclass(frozen=True)
class Way:
    """Where the camera goes when nobody steers."""

    path_file: Path | None
    tour: str | None
    tour_frames: int

    TITLE: ClassVar[str] = "Way"
    KIND: ClassVar[Decorator] = _choice(
        "--tour",
        offers=TOURS,
        default=False,
        help="Kind of the automatic tour. Default: the first that the model allows.",
    )
    OPTIONS: ClassVar[tuple[Decorator, ...]] = (
        click.option(
            "--path",
            "path_file",
            type=click.Path(path_type=Path, dir_okay=False),
            help="Path file to follow. Default: an automatic tour.",
        ),
        KIND,
        click.option(
            "--tour-frames",
            type=click.IntRange(1),
            default=120,
            show_default=True,
            help="Frames of the automatic tour.",
        ),
    )


@dataclass(frozen=True)
class Headless:
    """Rendering without a window."""

    headless: bool
    frames: Path | None
    report: Path | None
    as_json: bool
    compare: str | None
    fps: float | None

    TITLE: ClassVar[str] = "Without a window"
    OPTIONS: ClassVar[tuple[Decorator, ...]] = (
        click.option("--headless", is_flag=True, help="Render a path without a window, to files."),
        click.option(
            "--frames", type=click.Path(path_type=Path, file_okay=False), help="Headless: write PNG frames here."
        ),
        click.option(
            "--report",
            type=click.Path(path_type=Path, dir_okay=False),
            help="Headless: write the report (JSON) here.",
        ),
        click.option("--json", "as_json", is_flag=True, help="Headless: print the report's totals as JSON."),
        click.option(
            "--compare",
            type=click.Choice([strategies.FULL]),
            help=f"Headless: also render the full model (strategy {strategies.FULL}), compare each frame with it, and "
            "exit with 1 if a frame has a hole or if more than 1 % of its pixels differ by more than 16 levels.",
        ),
        click.option(
            "--fps",
            type=click.FloatRange(min=0.01),
            help="Headless: frames a second of the path. Default: its own poses.",
        ),
    )

    def check(self) -> None:
        """Raises click.UsageError for options that make no sense with a window, or nothing to do without one."""
        given = {"frames": self.frames, "report": self.report, "json": self.as_json}
        if self.headless and not any(given.values()):
            raise click.UsageError("nothing to do: give --frames DIR, --report FILE or --json")
        for name, value in {**given, "compare": self.compare, "fps": self.fps}.items():
            if value and not self.headless:
                raise click.UsageError(f"--{name} needs --headless")


@dataclass(frozen=True)
class InWindow:
    """Playing in a window."""

    output: Path

    TITLE: ClassVar[str] = "In a window"
    OPTIONS: ClassVar[tuple[Decorator, ...]] = (
        click.option(
            "--output",
            type=click.Path(path_type=Path, file_okay=False),
            default=Path(),
            help="Window: directory of screenshots and recorded paths. Default: the current one.",
        ),
    )
