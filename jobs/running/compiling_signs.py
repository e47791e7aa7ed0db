"""How a build hears that workers on other machines compile: by files in the work directory, which all of them see.

A sign is WORK/compiling/.tmp-..., named as in storage.base.temporary. It is there while its writer compiles.
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

#: No kernel takes so long, in seconds: older signs are of writers that were killed.
STALE = 300.0


class _Sign(Stopwatch):
    """A listener that puts up a sign and takes it down. Short compiling is not worth one."""

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
    """Within the context, others can see when this process compiles."""
    with listening(_Sign(temporary_path(_folder(place)))):
        yield


def seen(place: Workplace) -> bool:
    """Whether anybody compiles."""
    for sign in _folder(place).glob(f"{PREFIX}*"):
        with suppress(OSError):  # it has gone meanwhile
            if time.time() - sign.stat().st_mtime < STALE:
                return True
    return False


def _folder(place: Workplace) -> Path:
    return place.work / "compiling"
