"""Telling how far a build is: bars on a terminal, one line per step elsewhere, nothing in library calls."""

from __future__ import annotations

import sys
import time
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, Protocol, Self, TextIO

from storage.base.compiling import WhenLong, listening, notice


class Progress(Protocol):
    """Hears of the steps of long work, one at a time."""

    def start(self, step: str) -> None:
        """A step begins."""
        ...

    def update(self, done: int, total: int) -> None:
        """So much of the current step is done; the total may grow."""
        ...

    def finish(self, note: str) -> None:
        """The current step is done; `note` sums it up in a few words."""
        ...


class Silent:
    """Says nothing."""

    def start(self, step: str) -> None:
        """See `Progress.start`."""

    def update(self, done: int, total: int) -> None:
        """See `Progress.update`."""

    def finish(self, note: str) -> None:
        """See `Progress.finish`."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing to end."""


class _Heard(Silent):
    """Hears of compiling while it is entered."""

    _hearing: AbstractContextManager[None]

    def __enter__(self) -> Self:
        self._hearing = listening(self._compiling)
        self._hearing.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._hearing.__exit__(kind, error, trace)

    def _compiling(self, active: bool) -> None:
        raise NotImplementedError


class Lines(_Heard):
    """Writes one line for each finished step: for log files."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._step = ""
        self._began = 0.0
        self._told = WhenLong(lambda: self._write(f"{self._step}: {notice('a few minutes')}"))

    def start(self, step: str) -> None:
        """See `Progress.start`."""
        self._step, self._began = step, time.monotonic()

    def finish(self, note: str) -> None:
        """See `Progress.finish`."""
        seconds = time.monotonic() - self._began
        self._write(f"{self._step}: {note} ({seconds:.1f} s)")

    def _compiling(self, active: bool) -> None:
        self._told(active)

    def _write(self, line: str) -> None:
        self._stream.write(line + "\n")
        self._stream.flush()


class Bars(_Heard):
    """Draws a bar with the time left for the current step, and leaves a line for each finished one."""

    def __init__(self, stream: TextIO) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as RichProgress

        self._bars: Any = RichProgress(
            TextColumn("{task.description:<10}"),
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
            console=Console(file=stream),
        )
        self._task: Any = None

    def start(self, step: str) -> None:
        """See `Progress.start`."""
        self._task = self._bars.add_task(step, total=None, note="")

    def update(self, done: int, total: int) -> None:
        """See `Progress.update`."""
        self._bars.update(self._task, completed=done, total=total)

    def finish(self, note: str) -> None:
        """See `Progress.finish`."""
        total = self._bars.tasks[self._bars.task_ids.index(self._task)].total
        self._bars.update(self._task, total=total or 1, completed=total or 1, note=note)
        self._task = None

    def __enter__(self) -> Self:
        self._bars.start()
        return super().__enter__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self._bars.stop()

    def _compiling(self, active: bool) -> None:
        if self._task is not None:
            self._bars.update(self._task, note="compiling, once on a machine" if active else "")


def progress_for(stream: TextIO | None = None) -> Bars | Lines:
    """Bars if `stream` (standard error by default) is a terminal, lines if it is not."""
    stream = sys.stderr if stream is None else stream
    return Bars(stream) if stream.isatty() else Lines(stream)
