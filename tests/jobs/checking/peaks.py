"""Memory and processor time of this process and of those that it began, from /proc."""

from __future__ import annotations

import os
from multiprocessing import active_children
from pathlib import Path
from threading import Event, Thread
from types import TracebackType
from typing import NamedTuple, Self

#: Seconds between two looks. A peak is kept by the system, so only the last moments of a process can be overlooked.
LOOK = 0.05


class Use(NamedTuple):
    """What a process has used so far."""

    peak: int  # most memory at a time, in bytes (VmHWM)
    seconds: float  # processor time


class Watch:
    """Looks at this process and its children for as long as it is entered."""

    def __init__(self) -> None:
        self.processes: dict[int, Use] = {}
        self._ended = Event()
        self._thread = Thread(target=self._watch, daemon=True)

    def look(self) -> None:
        """Look now."""
        for pid in (os.getpid(), *(int(child.pid or 0) for child in active_children())):
            try:
                status = Path(f"/proc/{pid}/status").read_text()
                times = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[11:13]
            except (FileNotFoundError, ProcessLookupError):
                continue
            peak = [int(line.split()[1]) << 10 for line in status.splitlines() if line.startswith("VmHWM:")]
            if peak:
                self.processes[pid] = Use(peak[0], sum(map(int, times)) / os.sysconf("SC_CLK_TCK"))

    @property
    def peak(self) -> int:
        """The largest peak of all processes, in bytes."""
        return max(use.peak for use in self.processes.values())

    @property
    def seconds(self) -> float:
        """Processor time of all processes."""
        return sum(use.seconds for use in self.processes.values())

    def _watch(self) -> None:
        while not self._ended.wait(LOOK):
            self.look()

    def __enter__(self) -> Self:
        self.look()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
