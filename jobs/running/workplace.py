"""Where a build keeps the results of its tasks: the work directory, with its lock and its leftovers.

    WORK/lock                     there and held while a build runs; names its process
    WORK/<stage>/<key>/           the whole result of a finished task; record.json is written with it
    WORK/<stage>/.tmp-...         the result of a task that is running, or was killed; see storage.base.temporary

A result appears under its key in one atomic rename, whole. It is safe to delete the directory when no build runs.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import TextIO

from jobs.running.errors import WorkInUseError
from storage.base.temporary import abandoned, host, temporary_path

#: The file in the work directory that says that a build runs.
LOCK = "lock"


@dataclass(frozen=True)
class Workplace:
    """The two directories of a build."""

    work: Path  # results of tasks
    store: Path  # the store that is being built

    def result(self, stage: str, key: str) -> Path:
        """Where the finished result of a task lies, or would lie."""
        return self.work / stage / key

    def new_temporary(self, stage: str) -> Path:
        """A fresh directory for a task to write into; its name says who writes."""
        path = temporary_path(self.work / stage)
        path.mkdir(parents=True)
        return path

    def publish(self, temporary: Path, stage: str, key: str) -> Path:
        """Moves a whole result to its key, atomically and durably. If another process was first, its result stays."""
        final = self.result(stage, key)
        for path in (*sorted(temporary.rglob("*")), temporary):
            _flush(path)
        try:
            temporary.rename(final)
        except OSError:
            if not final.is_dir():
                raise
            shutil.rmtree(temporary)
        _flush(final.parent)
        return final

    @contextlib.contextmanager
    def made(self) -> Iterator[None]:
        """Makes the two directories; what was not there before goes again if nothing came to be in it."""
        new = [
            path
            for start in (self.work, self.store)
            for path in takewhile(lambda path: not path.exists(), (start, *start.parents))
        ]
        self.store.mkdir(parents=True, exist_ok=True)
        self.work.mkdir(parents=True, exist_ok=True)
        try:
            yield
        finally:
            for path in new:
                with contextlib.suppress(OSError):
                    path.rmdir()

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other builds out of the work directory. Raises WorkInUseError at once if one is in.

        The system gives the lock back when its process ends, however it ends.
        """
        with self._lock() as file:
            try:
                file.truncate(0)
                file.write(f"process {os.getpid()} on {host()}\n")
                file.flush()
                yield
            finally:
                (self.work / LOCK).unlink(missing_ok=True)

    def _lock(self) -> TextIO:
        """The lock's file, opened and held."""
        while True:
            self.work.mkdir(parents=True, exist_ok=True)
            with contextlib.ExitStack() as opened:
                try:
                    file = opened.enter_context((self.work / LOCK).open("a+"))
                except FileNotFoundError:  # another build ended just now, and took its directory along
                    continue
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    file.seek(0)
                    owner = file.read().strip() or "another process"
                    raise WorkInUseError(
                        f"{self.work} is in use by another build ({owner}): wait for it, or choose another --work "
                        "directory"
                    ) from None
                if _is_at(file, self.work / LOCK):
                    opened.pop_all()
                    return file

    @contextlib.contextmanager
    def cleaned(self) -> Iterator[None]:
        """Removes leftovers before and after: workers of a killed build may outlive it for a moment."""
        self.clean()
        try:
            yield
        finally:
            self.clean()

    def clean(self) -> int:
        """Removes what killed writers left behind, here and in the store; returns how many. What is written stays.

        Folders of stages in which nothing was finished go as well.
        """
        removed = 0
        for folder in (*self.work.glob("*/"), self.store, *self.store.glob("*/")):
            for path in abandoned(folder):
                if path.is_dir():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    path.unlink(missing_ok=True)
                removed += 1
        for stage in self.work.glob("*/"):
            with contextlib.suppress(OSError):
                stage.rmdir()
        return removed


def _is_at(file: TextIO, path: Path) -> bool:
    """Whether an open file is still the one at `path`: what is removed may be locked, and keeps nobody out."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
