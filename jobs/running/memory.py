"""How much memory a task and a whole build take, how much there is, and how amounts of it are written."""

from __future__ import annotations

import contextlib
import math
import re
import resource
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

from storage.base.errors import ParameterError

#: What a task of a build may need unless the user says otherwise, in bytes.
TASK_MEMORY = 2 << 30

_STATUS = Path("/proc/self/status")
_CLEAR = Path("/proc/self/clear_refs")


_SIZE = re.compile(r"([0-9]*\.?[0-9]+)\s*([KMGT]?)(I?)B?", re.IGNORECASE)


def parse_size(text: str) -> int:
    """Bytes of an amount such as 2GiB, 1500MB, 1.5G or 800000000. KiB, MiB ... are powers of 1024, KB, K ... of 1000.

    Raises ParameterError for what is no amount, or none above zero.
    """
    match = _SIZE.fullmatch(text.strip())
    size = 0
    if match is not None:
        number, prefix, binary = match.groups()
        size = int(float(number) * (1024 if binary else 1000) ** " KMGT".index(prefix.upper() or " "))
    if size <= 0:
        raise ParameterError(f"memory {text!r}: expected an amount such as 2GiB or 1500MB")
    return size


def format_size(size: int) -> str:
    """An amount of memory for people, in MiB or GiB, rounded up: as `parse_size` reads it."""
    if size < 1 << 30:
        return f"{math.ceil(size / (1 << 20))}MiB"
    return f"{math.ceil(size / (1 << 30) * 10) / 10:.1f}".removesuffix(".0") + "GiB"


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


def memory_available() -> int:
    """Memory, in bytes, that this machine can give to a build: its whole memory, or its container's limit."""
    import psutil

    total = int(psutil.virtual_memory().total)
    for limit in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        with contextlib.suppress(OSError, ValueError):
            total = min(total, int(Path(limit).read_text()))
    return total


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
