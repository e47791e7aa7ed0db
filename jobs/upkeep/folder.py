"""The directory of a store that is to be changed, and keeping others out of it."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

from jobs.running.lock import locked
from storage.base.errors import ParameterError

#: Names of shards, of tasks' results, and of all else that goes by the hash of what it is.
HASH = re.compile(r"[0-9a-f]{32}")

#: Files of a store's folder of manifests, one a version.
VERSION = re.compile(r"([1-9][0-9]*)\.json")


def store_folder(store: str) -> Path:
    """The directory of the store that a user named. Raises ParameterError for a URL."""
    if "://" in store:
        raise ParameterError(f"{store} is an address: only a store in a folder can be changed; name its folder")
    return Path(store)


def version_numbers(store: Path) -> list[int]:
    """The numbers of all versions whose manifests are there, readable or not, increasing; also of unfinished ones."""
    names = [VERSION.fullmatch(path.name) for path in (store / "versions").glob("*.json")]
    return sorted(int(name[1]) for name in names if name is not None)


@contextlib.contextmanager
def held(who: str, *folders: Path) -> Iterator[None]:
    """Keeps builds out of directories; those that are not there are left out.

    who: what a build that is kept out hears. Raises WorkInUseError at once if one is in.
    """
    with contextlib.ExitStack() as locks:
        for folder in {folder.resolve(): folder for folder in folders if folder.is_dir()}.values():
            locks.enter_context(locked(folder, "end it", who))
        yield


def flush(folder: Path) -> None:
    """Makes what was removed from a directory, or moved into it, durable, where the file system can."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
