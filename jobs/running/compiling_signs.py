"""That a worker compiles, told to the build by a file in the work directory, which all machines of a job see.

The file is WORK/compiling/.tmp-..., named as in storage.base.temporary, and is there while its worker compiles. Workers
write it within `shown`; the build looks for such files with `seen`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from jobs.running.workplace import Workplace
from storage.base import compiling
from storage.base.compiling import Stopwatch, listening
from storage.base.temporary import PREFIX, temporary_path

#: No kernel takes so long to compile, in seconds: older files are of workers that were killed.
STALE = 300.0


class _Sign(Stopwatch):
    """A listener to compiling that writes a file when it begins and removes it when it ends.

    It writes none before compiling has taken LONG seconds in all: what is shorter nobody waits for.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def __call__(self, active: bool) -> None:
        """See `storage.base.compiling.Listener`."""
        super().__call__(active)
        if not active:
            self._path.unlink(missing_ok=True)
        elif self.seconds > compiling.LONG:
            self._path.parent.mkdir(exist_ok=True)
            self._path.touch()


@contextmanager
def shown(place: Workplace) -> Iterator[None]:
    """Within the context, a file shows when this process compiles."""
    with listening(_Sign(temporary_path(_folder(place)))):
        yield


def seen(place: Workplace) -> bool:
    """Whether any process that works in the directory compiles."""
    for sign in _folder(place).glob(f"{PREFIX}*"):
        with suppress(OSError):  # it has gone meanwhile
            if time.time() - sign.stat().st_mtime < STALE:
                return True
    return False


def _folder(place: Workplace) -> Path:
    return place.work / "compiling"
