"""Locks on directories: a file in each that is there and held while something changes them, and names its process.

The system gives a lock back when its process ends, however it ends; what a killed one left of the file keeps nobody
out, and goes with the next.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from jobs.running.errors import WorkInUseError
from storage.base.temporary import host

#: The file in a directory that says that somebody is in.
LOCK = "lock"


@contextlib.contextmanager
def locked(folder: Path, cure: str, who: str = "another build") -> Iterator[None]:
    """Keeps others out of a directory, which is made where it is not there.

    cure: what helps where somebody is in already, beside waiting; who: what those who are kept out hear of this one.
    Raises WorkInUseError at once if another one is in.
    """
    with _held(folder, cure) as file:
        try:
            file.truncate(0)
            file.write(f"{who} (process {os.getpid()} on {host()})\n")
            file.flush()
            yield
        finally:
            (folder / LOCK).unlink(missing_ok=True)


def _held(folder: Path, cure: str) -> TextIO:
    """The lock's file, opened and held."""
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as opened:
            try:
                file = opened.enter_context((folder / LOCK).open("a+"))
            except FileNotFoundError:  # another build ended just now, and took its directory along
                continue
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                owner = file.read().strip() or "another process"
                raise WorkInUseError(f"{folder} is in use by {owner}: wait for it, or {cure}") from None
            if _is_at(file, folder / LOCK):
                opened.pop_all()
                return file


def _is_at(file: TextIO, path: Path) -> bool:
    """Whether an open file is still the one at `path`: what is removed may be locked, and keeps nobody out."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False
