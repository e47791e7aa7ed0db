"""Telling how far a build is: bars on a terminal, lines elsewhere, nothing in library calls.

How long a step will still take is told from its first moment on: what was done so far tells how long the rest takes,
and at first a guess stands for one more thing that was done.
"""

from __future__ import annotations

import sys
import threading
import time
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, NamedTuple, Protocol, Self, TextIO

from storage.base.compiling import WhenLong, listening, notice

#: Seconds between two lines of a step that goes on, in a log.
EVERY = 60.0

#: Seconds that one thing of a step is guessed to take before any was done.
GUESS = 5.0


class Progress(Protocol):
    """Hears of the steps of long work, one at a time."""

    def start(self, step: str) -> None:
        """A step begins."""
        ...

    def update(self, done: int, total: int, before: int = 0) -> None:
        """So much of the current step is done, `before` of it before the step began; the total may change."""
        ...

    def finish(self, note: str) -> None:
        """The current step is done; `note` sums it up in a few words."""
        ...


class Silent:
    """Says nothing."""

    def start(self, step: str) -> None:
        """See `Progress.start`."""

    def update(self, done: int, total: int, before: int = 0) -> None:
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


def seconds_left(seconds: float, done: int, total: int, before: int = 0) -> float:
    """How long a step will still take, in seconds, after `seconds` of it; for the rest see `Progress.update`."""
    return (seconds + GUESS) / (done - before + 1) * max(0, total - done)


def time_left(seconds: float) -> str:
    """A time left, for people: rounded to what an estimate is worth."""
    if seconds < 90:
        return f"about {max(10, round(seconds, -1)):.0f} s left"
    if seconds < 90 * 60:
        return f"about {seconds / 60:.0f} min left"
    return f"about {seconds / 3600:.1f} h left"


class _Step(NamedTuple):
    """How far a step is."""

    name: str
    began: float  # as time.monotonic tells it
    done: int = 0
    total: int | None = None
    before: int = 0

    def told(self) -> str:
        """It as a line."""
        seconds = time.monotonic() - self.began
        if self.total is None:
            return f"{self.name}: {seconds:.0f} s so far"
        left = time_left(seconds_left(seconds, self.done, self.total, self.before))
        return f"{self.name}: {self.done:,} of about {self.total:,} after {seconds:.0f} s, {left}"


class Lines(_Heard):
    """Writes a line for each finished step, and one a minute for a step that goes on: for log files."""

    def __init__(self, stream: TextIO, every: float = EVERY) -> None:
        """every: seconds between two lines of a step that goes on."""
        self._stream = stream
        self._step: _Step | None = None
        self._told = WhenLong(lambda: self._write(f"{self._step_name()}: {notice('a few minutes')}"))
        self._every = every
        self._ended = threading.Event()
        self._writing = threading.Lock()
        self._ticker = threading.Thread(target=self._tick, name="progress", daemon=True)

    def start(self, step: str) -> None:
        """See `Progress.start`."""
        self._step = _Step(step, time.monotonic())

    def update(self, done: int, total: int, before: int = 0) -> None:
        """See `Progress.update`."""
        if self._step is not None:
            self._step = self._step._replace(done=done, total=total, before=before)

    def finish(self, note: str) -> None:
        """See `Progress.finish`."""
        step, self._step = self._step, None
        assert step is not None, "a step begins before it ends"
        self._write(f"{step.name}: {note} ({time.monotonic() - step.began:.1f} s)")

    def __enter__(self) -> Self:
        self._ticker.start()
        return super().__enter__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        self._ended.set()
        self._ticker.join()

    def _tick(self) -> None:
        """A line whenever the current step, or what came since, has been silent for a while."""
        while not self._ended.wait(self._every):
            if (step := self._step) is not None and time.monotonic() - step.began >= 0.9 * self._every:
                self._write(step.told())

    def _step_name(self) -> str:
        return "" if self._step is None else self._step.name

    def _compiling(self, active: bool) -> None:
        self._told(active)

    def _write(self, line: str) -> None:
        with self._writing:
            self._stream.write(line + "\n")
            self._stream.flush()


class Bars(_Heard):
    """Draws a bar with the time left for the current step, and leaves a line for each finished one."""

    def __init__(self, stream: TextIO) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as RichProgress
        from rich.text import Text

        class TimeLeft(ProgressColumn):
            """What `seconds_left` says; nothing of a step that is done or whose size is not known."""

            def render(self, task: Task) -> Text:
                if task.total is None or task.finished:
                    return Text("")
                done, total, before = int(task.completed), int(task.total), int(task.fields["before"])
                return Text(time_left(seconds_left(task.elapsed or 0.0, done, total, before)))

        self._bars: Any = RichProgress(
            TextColumn("{task.description:<10}"),
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeLeft(),
            TextColumn("{task.fields[note]}"),
            console=Console(file=stream),
        )
        self._task: Any = None

    def start(self, step: str) -> None:
        """See `Progress.start`."""
        self._task = self._bars.add_task(step, total=None, note="", before=0)

    def update(self, done: int, total: int, before: int = 0) -> None:
        """See `Progress.update`."""
        self._bars.update(self._task, completed=done, total=total, before=before)

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
