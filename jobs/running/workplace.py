"""Where a build keeps the results of its tasks: the work directory, with its lock and its leftovers.

    WORK/lock, STORE/lock         there and held while a build runs, or upkeep; see jobs.running.lock
    WORK/<stage>/<key>/           the whole result of a finished task; record.json is written with it
    WORK/drafts/shards/           shards that only tasks read, as a store has them
    WORK/versions/<hash>          the results that a version of the store was made from; the hash is of what it says
    WORK/<stage>/.tmp-...         the result of a task that is running, or was killed; see storage.base.temporary

A result appears under its key in one atomic rename, whole. It is safe to delete the directory when no build runs.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from jobs.running.lock import locked
from storage.base.temporary import abandoned, temporary_path
from storage.shards.shards import atomic_file

#: Folder of a work directory that says what each version was made from.
VERSIONS = "versions"


@dataclass(frozen=True)
class Workplace:
    """The two directories of a build."""

    work: Path  # results of tasks
    store: Path  # the store that is being built

    @property
    def drafts(self) -> Path:
        """Where shards lie that are no part of the store: a root with a folder of shards, as a store has."""
        return self.work / "drafts"

    def result(self, stage: str, key: str) -> Path:
        """Where the finished result of a task lies, or would lie."""
        return self.work / stage / key

    def new_temporary(self, stage: str) -> Path:
        """A fresh directory for a task to write into; its name says who writes."""
        path = temporary_path(self.work / stage)
        path.mkdir(parents=True)
        return path

    def publish(self, temporary: Path, stage: str, key: str, usable: Callable[[Path], bool]) -> None:
        """Moves a whole result to its key, atomically and durably.

        If another process was first, its result stays. usable: whether a directory holds a whole result; what lies
        under the key and does not hold one makes room.
        """
        final = self.result(stage, key)
        for path in (*sorted(temporary.rglob("*")), temporary):
            _flush(path)
        while not _moved(temporary, final):
            if usable(final):
                shutil.rmtree(temporary)
                break
            self._set_aside(final, usable)
        _flush(final.parent)

    def forget(self, stage: str, key: str) -> None:
        """Removes the result of a finished task. A kill in between leaves it whole, or a leftover for `clean`."""
        aside = temporary_path(self.work / stage)
        self.result(stage, key).rename(aside)
        shutil.rmtree(aside)

    def _set_aside(self, final: Path, usable: Callable[[Path], bool]) -> None:
        """Removes what lies under a key and is no whole result. It is looked at once more where nobody else can be:

        another process may have published a whole one between the last look and the move, and that goes back.
        """
        aside = temporary_path(final.parent)
        try:
            final.rename(aside)
        except FileNotFoundError:  # another process was first
            return
        if not usable(aside) or not _moved(aside, final):
            shutil.rmtree(aside)

    def note(self, version: str, results: Mapping[str, Iterable[str]]) -> None:
        """Notes the results that a version is made from: their keys by stage. version: a hash of what it says."""
        content = {stage: sorted(set(keys)) for stage, keys in results.items()}
        with atomic_file(self.work / VERSIONS / version) as file:
            file.write(json.dumps(content, sort_keys=True).encode())

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
        """Keeps other builds out of both directories. Raises WorkInUseError at once if one is in.

        Builds with work directories of their own would else both write the same next version of one store.
        """
        with contextlib.ExitStack() as held:
            held.enter_context(locked(self.work, "choose another --work directory"))
            if self.work.resolve() != self.store.resolve():
                held.enter_context(locked(self.store, "build into another place"))
            yield

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
        for folder in (*self.work.glob("*/"), *self.drafts.glob("*/"), self.store, *self.store.glob("*/")):
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


def _moved(folder: Path, final: Path) -> bool:
    """Moves a directory to where nothing lies, atomically; False where something does."""
    try:
        folder.rename(final)
    except OSError as error:
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
            return False
        raise
    return True


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
