"""The window's keys: one table of what each does, from which both the bindings and the help are made."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from player import colouring, strategies
from player.camera import steering
from player.offers import names

#: Keys that are held, by their names in moderngl_window, and what they ask for: player.camera.camera.MOVES.
HELD = {"W": "forward", "S": "back", "A": "left", "D": "right", "E": "up", "Q": "down"}

_COARSER = 1.25
_FINER = 1 / _COARSER


class Keyed(Protocol):
    """What keys can ask for."""

    def use_strategy(self, name: str) -> None:
        """Draws by another strategy."""
        ...

    def use_next_colours(self) -> None:
        """Shows something else by colours."""
        ...

    def use_next_steering(self) -> None:
        """Moves in another way."""
        ...

    def change_error(self, factor: float) -> None:
        """Multiplies the allowed error in pixels."""
        ...

    def freeze(self) -> None:
        """Culling stays as it is now, or follows the view again."""
        ...

    def screenshot(self) -> object:
        """Saves the picture."""
        ...

    def record(self) -> None:
        """Begins or ends recording a path."""
        ...

    def replay(self) -> None:
        """Begins or ends the replay of the recorded path."""
        ...

    def toggle_statistics(self) -> None:
        """Shows or hides the statistics."""
        ...

    def toggle_help(self) -> None:
        """Shows or hides the help."""
        ...

    def toggle_mouse(self) -> None:
        """Looks around without a button, or with one."""
        ...

    def quit(self) -> None:
        """Closes the window."""
        ...


Action = Callable[[Keyed], object]


class Row(NamedTuple):
    """Keys that belong together."""

    shown: str  # as help shows them
    what: str  # what help says of them
    actions: dict[str, Action]  # by names of keys in moderngl_window


def key_table() -> list[Row]:
    """Everything that keys and the mouse do, in the order of the help."""
    return [
        Row("W A S D", "move", {}),
        Row("E  Q", "up, down", {}),
        Row("drag", "look around (M: look without dragging)", {"M": lambda viewer: viewer.toggle_mouse()}),
        Row("wheel", "speed (hold shift: four times)", {}),
        Row("G", " or ".join(names(steering.STEERINGS)), {"G": lambda viewer: viewer.use_next_steering()}),
        _strategies(),
        Row(
            "+  -",
            "allowed error in pixels (also page up, page down)",
            {
                **dict.fromkeys(("EQUAL", "PAGE_UP"), lambda viewer: viewer.change_error(_COARSER)),
                **dict.fromkeys(("MINUS", "PAGE_DOWN"), lambda viewer: viewer.change_error(_FINER)),
            },
        ),
        Row("F", "freeze culling", {"F": lambda viewer: viewer.freeze()}),
        Row("C", f"colours: {', '.join(names(colouring.COLOURINGS))}", {"C": lambda viewer: viewer.use_next_colours()}),
        Row("P", "screenshot", {"P": lambda viewer: viewer.screenshot()}),
        Row(
            "R  T",
            "record a path; replay it",
            {"R": lambda viewer: viewer.record(), "T": lambda viewer: viewer.replay()},
        ),
        Row(
            "O  H",
            "statistics; this help",
            {"O": lambda viewer: viewer.toggle_statistics(), "H": lambda viewer: viewer.toggle_help()},
        ),
        Row("Esc", "quit", {"ESCAPE": lambda viewer: viewer.quit()}),
    ]


def help_rows(table: list[Row]) -> list[tuple[str, str]]:
    """The table as it is shown: two columns."""
    return [(row.shown, row.what) for row in table]


def _strategies() -> Row:
    """A digit for each strategy, as far as there are digits."""
    offered = dict(zip("123456789", names(strategies.STRATEGIES), strict=False))

    def use(name: str) -> Action:
        return lambda viewer: viewer.use_strategy(name)

    return Row(
        "  ".join(offered),
        f"strategy: {', '.join(offered.values())}",
        {f"NUMBER_{digit}": use(name) for digit, name in offered.items()},
    )
