"""How much memory a task and a whole build take."""

from __future__ import annotations

import contextlib
import resource
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

#: What a task of a build may need unless the user says otherwise, in bytes.
TASK_MEMORY = 2 << 30

#: What a process of a job holds before it does anything (interpreter, numpy, kernels), in bytes. Measured: 200 MiB, and
#: 620 where it has compiled the kernels itself.
PROCESS = 640 << 20

_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")


def reset_peak() -> None:
    """Forgets this process's peak so far, where the system can (Linux); elsewhere peaks only grow."""
    with contextlib.suppress(OSError):
        _CLEAR.write_text("5")


def peak_memory() -> int:
    """The most memory, in bytes, that this process has held resident since `reset_peak`."""
    try:
        for line in _STATUS.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(largest) if sys.platform == "darwin" else int(largest) * 1024


class MemoryWatch:
    """Samples, on a thread, the resident memory of this process and all its children while it is open.

    `peak` is the largest sum so far, in bytes. Memory that processes share is counted once for each, so it is an upper
    estimate. Workers on other machines are not seen; their tasks report peaks of their own.
    """

    def __init__(self, interval: float = 0.25) -> None:
        """interval: between two samples, in seconds."""
        self.peak = 0
        self._interval = interval
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="memory-watch", daemon=True)

    def __enter__(self) -> Self:
        self.sample()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        self.sample()

    def restart(self) -> int:
        """The peak so far, in bytes; forgets it."""
        self.sample()
        peak, self.peak = self.peak, 0
        return peak

    def sample(self) -> None:
        """Looks once."""
        import psutil

        total = 0
        own = psutil.Process()
        with contextlib.suppress(psutil.Error):
            for process in (own, *own.children(recursive=True)):
                with contextlib.suppress(psutil.Error):
                    total += int(process.memory_info().rss)
        self.peak = max(self.peak, total)

    def _watch(self) -> None:
        while not self._stop.wait(self._interval):
            began = time.monotonic()
            self.sample()
            # Many children make a sample dear: never spend more than a tenth of a core on it.
            self._stop.wait(9 * (time.monotonic() - began))
