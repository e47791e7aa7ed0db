"""Reading the files of a store, wherever they are: a folder, an HTTP server, memory, an object store.

Goes through fsspec; folders are read directly.
"""

from __future__ import annotations

import os
from pathlib import Path
from threading import Lock
from typing import Any
from urllib.parse import unquote

from storage.base.errors import MissingDependencyError, StoreNotFoundError, StoreUnreachableError

#: Packages whose errors mean that the place cannot be reached: fsspec's file systems pass them on.
_NETWORK_PACKAGES = ("aiohttp", "asyncio", "botocore", "gcsfs", "adlfs", "yarl")


class Files:
    """The files below one path or URL, read-only. Safe to use from several threads.

    Raises MissingDependencyError if the URL's protocol needs a package that is not installed, StoreNotFoundError if its
    protocol is unknown.
    """

    def __init__(self, url: str | os.PathLike[str]) -> None:
        self.url = os.fspath(url).rstrip("/") or "/"
        self.bytes_fetched = 0
        self._lock = Lock()
        self._folder: Path | None = None
        self._system: Any = None
        if self.url.startswith("file://"):
            self._folder = Path(unquote(self.url.removeprefix("file://")))
        elif "://" not in self.url and "::" not in self.url:
            self._folder = Path(self.url)
        else:
            import fsspec

            try:
                self._system, self._prefix = fsspec.core.url_to_fs(self.url)
            except ImportError as error:
                raise MissingDependencyError(
                    f"{self.url} cannot be read: {error}; pip install 'fsspec[{self.url.split(':')[0]}]'"
                ) from error
            except ValueError as error:
                raise StoreNotFoundError(
                    f"{self.url} is no address that can be opened: {error}; give a path or a URL"
                ) from error

    def read(self, path: str, start: int = 0, end: int | None = None) -> bytes:
        """The bytes from start to end of a file; fewer where the file is shorter.

        Raises StoreNotFoundError if there is no such file, StoreUnreachableError if it cannot be read.
        """
        try:
            data = self._read_folder(path, start, end) if self._folder else self._read_system(path, start, end)
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError) as error:
            raise StoreNotFoundError(f"{self.url}/{path} does not exist") from error
        except Exception as error:
            if isinstance(error, OSError) or type(error).__module__.split(".")[0] in _NETWORK_PACKAGES:
                raise StoreUnreachableError(
                    f"{self.url}/{path} cannot be read: {error or type(error).__name__}"
                ) from error
            raise
        with self._lock:
            self.bytes_fetched += len(data)
        return data

    def size(self, path: str) -> int | None:
        """Length of a file in bytes; None if it does not exist."""
        try:
            if self._folder:
                return (self._folder / path).stat().st_size
            return int(self._system.size(f"{self._prefix}/{path}"))
        except (FileNotFoundError, NotADirectoryError):
            return None

    def _read_folder(self, path: str, start: int, end: int | None) -> bytes:
        assert self._folder is not None
        with (self._folder / path).open("rb", buffering=0) as file:
            file.seek(start)
            if end is None:
                return file.read()
            data = file.read(end - start)
            while len(data) < end - start and (more := file.read(end - start - len(data))):
                data += more
            return data

    def _read_system(self, path: str, start: int, end: int | None) -> bytes:
        place = f"{self._prefix}/{path}"
        if end is None:
            return bytes(self._system.cat_file(place))
        if end <= start:
            return b""
        data = bytes(self._system.cat_file(place, start=start, end=end))
        if len(data) > end - start:  # a server that knows no ranges sends the whole file
            with self._lock:
                self.bytes_fetched += len(data) - (end - start)
            data = data[start:end]
        return data
