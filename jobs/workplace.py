"""Where a build keeps the results of its tasks: the work directory, with its lock and its leftovers.

    WORK/lock                     held while a build runs; names its process
    WORK/<stage>/<key>/           the whole result of a finished task; record.json is written with it
    WORK/<stage>/.tmp-...         the result of a task that is running, or was killed; see storage.temporary

A result appears under its key in one atomic rename, whole. It is safe to delete the directory when no build runs.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from jobs.errors import WorkInUseError
from storage.temporary import abandoned, host, temporary_path


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
    def locked(self) -> Iterator[None]:
        """Keeps other builds out of the work directory. Raises WorkInUseError at once if one is in.

        The system gives the lock back when its process ends, however it ends.
        """
        self.work.mkdir(parents=True, exist_ok=True)
        with (self.work / "lock").open("a+") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                owner = file.read().strip() or "another process"
                raise WorkInUseError(
                    f"{self.work} is in use by another build ({owner}): wait for it, or choose another --work directory"
                ) from None
            file.truncate(0)
            file.write(f"process {os.getpid()} on {host()}\n")
            file.flush()
            try:
                yield
            finally:
                file.truncate(0)

    @contextlib.contextmanager
    def cleaned(self) -> Iterator[None]:
        """Removes leftovers before and after: workers of a killed build may outlive it for a moment."""
        self.clean()
        try:
            yield
        finally:
            self.clean()

    def clean(self) -> int:
        """Removes what killed writers left behind, here and in the store; returns how many. What is written stays."""
        removed = 0
        for folder in (*self.work.glob("*/"), self.store, *self.store.glob("*/")):
            for path in abandoned(folder):
                if path.is_dir():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    path.unlink(missing_ok=True)
                removed += 1
        return removed


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
