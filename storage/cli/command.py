"""`vlod`, the command line: finds each subcommand where it lives and imports it only when it is asked for.

Exit codes: 0 done, 1 a check failed, 2 wrong usage or bad input, 130 interrupted. What a user can cause or cure ends
in one clear line, never in a traceback.
"""

from __future__ import annotations

import errno
import importlib
import sys
from typing import Any, NamedTuple, NoReturn

import click

from storage.base.errors import MissingDependencyError, VlodError


class _Lazy(NamedTuple):
    """A subcommand that is imported when it is used."""

    module: str
    name: str
    help: str  # shown by `vlod --help`
    extra: str | None  # what must be installed for it: pip install 'vlod[extra]'


_COMMANDS = {
    "build": _Lazy("jobs.commands", "build", "Make a store from model files.", "jobs"),
    "verify": _Lazy("jobs.commands", "verify", "Check a store against independent rays.", "jobs"),
    "info": _Lazy("storage.cli.info", "info", "Say what a store holds.", None),
    "versions": _Lazy("storage.cli.versions", "versions", "List the versions of a store.", None),
    "gc": _Lazy("jobs.commands", "gc", "Remove what no kept version of a store needs.", "jobs"),
    "play": _Lazy("player.commands", "play", "Walk through a store.", "player"),
    "path": _Lazy("player.commands", "path", "Make a tour through a store.", "player"),
    "demo-scene": _Lazy("jobs.commands", "demo_scene", "Make a model to try things with.", "jobs"),
    "report": _Lazy("jobs.commands", "report", "Make a page with pictures and numbers of a demo.", "jobs"),
}

#: The project's own packages: a missing module of theirs is a fault in vLOD, not a missing dependency.
_OWN = ("jobs", "player", "storage")

#: Troubles with files that are a user's to cure.
_FILE_TROUBLES = (
    errno.EACCES,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EISDIR,
    errno.ENAMETOOLONG,
    errno.ENOENT,
    errno.ENOSPC,
    errno.ENOTDIR,
    errno.EPERM,
    errno.EROFS,
)


class LazyGroup(click.Group):
    """A group whose subcommands are imported when they are used, and which ends in one line on errors."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """The subcommands in the order of a user's way through them."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The subcommand, imported now. Raises MissingDependencyError if what it needs is not installed."""
        if cmd_name not in _COMMANDS:
            return None
        lazy = _COMMANDS[cmd_name]
        try:
            command: click.Command = getattr(importlib.import_module(lazy.module), lazy.name)
        except ModuleNotFoundError as error:
            raise _missing(error, cmd_name) from error
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Lists the subcommands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, lazy.help) for name, lazy in _COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Runs the subcommand. Raises MissingDependencyError if something that it needs is not installed."""
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            raise _missing(error, ctx.invoked_subcommand or "") from error

    def main(self, *args: Any, **options: Any) -> NoReturn:
        """Runs the command line and exits with a code of the list at the top of this file."""
        sys.exit(self._run(*args, **options))

    def _run(self, *args: Any, **options: Any) -> int:
        try:
            code = super().main(*args, **{**options, "standalone_mode": False})
            return code if isinstance(code, int) else 0
        except click.ClickException as error:
            error.show()
            return error.exit_code
        except (click.Abort, KeyboardInterrupt):
            click.echo("interrupted", err=True)
            return 130
        except VlodError as error:
            return _refuse(str(error))
        except OSError as error:
            if error.errno not in _FILE_TROUBLES:
                raise
            place = f"{error.filename}: " if error.filename else ""
            return _refuse(f"{place}{error.strerror}")


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Example: vlod build ship.glb ship.store && vlod play ship.store",
)
@click.version_option(package_name="vlod", prog_name="vlod")
def vlod() -> None:
    """Walk interactively, with less than a pixel of error, through 3D models far too large for your machine."""


def main() -> NoReturn:
    """The entry point of the installed command."""
    vlod.main(prog_name="vlod")


def _refuse(message: str) -> int:
    click.echo(f"error: {' '.join(message.split())}", err=True)
    return 2


def _missing(error: ModuleNotFoundError, command: str) -> MissingDependencyError:
    """What to tell a user about a module that is not there. Raises `error` again if it is a fault in vLOD."""
    extra = _COMMANDS[command].extra if command in _COMMANDS else None
    missing = error.name or ""
    if extra is None or (missing != extra and missing.split(".")[0] in _OWN):
        raise error
    return MissingDependencyError(
        f"vlod {command} needs vlod[{extra}] ({missing} is not installed): pip install 'vlod[{extra}]'"
    )
