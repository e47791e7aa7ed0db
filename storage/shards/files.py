"""Reading the files of a store, wherever they are: a folder, an HTTP server, memory, an object store.

Goes through fsspec; folders are read directly. This is the one place where a request is repeated: what a busy or
briefly absent server refuses is asked for again, a few times and ever more slowly; what is not there or not allowed is
not. A server that falls silent is given up after a while, so no read lasts for ever. Many ranges are read in one call,
at once, near ones together. Of a server that knows no ranges each file is read once and kept for a while.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import unquote

from storage.base.errors import MissingDependencyError, StoreError, StoreNotFoundError, StoreUnreachableError
from storage.shards.cache import ByteCache

if TYPE_CHECKING:
    from storage.shards.disk_cache import DiskCache

#: How often a request is made before its place counts as unreachable.
ATTEMPTS = 4

#: The pause before the second attempt, in seconds; each later one is twice as long. To all a random part of as much is
#: added, so that many players do not come back at once.
FIRST_PAUSE = 0.2

#: The longest pause but for its random part, in seconds.
LONGEST_PAUSE = 3.0

#: No attempt begins later than this after the first one, in seconds.
LAST_ATTEMPT = 30.0

#: Whoever is patient hears of it when a request has failed so often.
TOLD_AT = 2

#: How long an HTTP server may take to accept a connection, in seconds.
CONNECT_TIME = 10.0

#: How long an HTTP server may say nothing in the middle of an answer, in seconds.
SILENCE_TIME = 20.0

#: Ranges of one file with no more bytes than so between them are read in one request.
GAP = 1 << 14

#: Paths of files whose content never changes, whatever store they are of: their names are its hashes.
IMMUTABLE = "shards/"

#: How many requests `Files.read_many` makes at once.
AT_ONCE = 16

#: Bytes of whole files that are kept in memory, of a server that knows no ranges.
WHOLE_FILES = 1 << 28

#: Answers of HTTP servers that another attempt may change, besides all from 500 on: time-out, too early, too many.
_LATER = (408, 425, 429)

#: Answers of HTTP servers to who may not read.
_FORBIDDEN = (401, 403, 407)

#: What aiohttp says of every connection that fails, whether it was to be a secure one or not.
_TLS_AS_EVER = " ssl:default"

_NOT_THERE = (FileNotFoundError, NotADirectoryError, IsADirectoryError)


class Range(NamedTuple):
    """Some bytes of a file."""

    path: str  # inside the store
    start: int
    end: int  # after the last byte


class Files:
    """The files below one path or URL, read-only. Safe to use from several threads.

    kept: holds parts of shards, which never change, for the next time; of no use to a folder.
    Raises MissingDependencyError if the URL's protocol needs a package that is not installed, StoreNotFoundError if its
    protocol is unknown.
    """

    def __init__(self, url: str | os.PathLike[str], kept: DiskCache | None = None) -> None:
        self._kept = kept
        self.url = os.fspath(url).rstrip("/") or "/"
        self.bytes_fetched = 0
        self._tell: Callable[[str], None] | None = None
        self._lock = Lock()
        self._folder: Path | None = None
        self._system: Any = None
        self._ranges: bool | None = None  # whether parts of files can be had; None: nobody has tried
        self._first_range = Lock()  # held by who tries
        self._whole: ByteCache[bytes] = ByteCache(WHOLE_FILES)
        if self.url.startswith("file://"):
            self._folder = Path(unquote(self.url.removeprefix("file://")))
        elif "://" not in self.url and "::" not in self.url:
            self._folder = Path(self.url)
        else:
            import fsspec

            try:
                self._system, self._prefix = fsspec.core.url_to_fs(self.url, **_time_limits(self.url))
            except ImportError as error:
                raise MissingDependencyError(
                    f"{self.url} cannot be read: {error}; pip install 'fsspec[{self.url.split(':')[0]}]'"
                ) from error
            except ValueError as error:
                raise StoreNotFoundError(
                    f"{self.url} is no address that can be opened: {error}; give a path or a URL"
                ) from error

    @property
    def near(self) -> bool:
        """Whether they lie in a folder, where a request costs next to nothing."""
        return self._folder is not None

    @contextmanager
    def patient(self, tell: Callable[[str], None]) -> Iterator[None]:
        """While the block runs, what may pass is waited for until LAST_ATTEMPT, not for ATTEMPTS only.

        For what nothing can stand in for. tell: hears, in one line, of every request that is waited for.
        """
        former, self._tell = self._tell, tell
        try:
            yield
        finally:
            self._tell = former

    def read(self, path: str, start: int = 0, end: int | None = None) -> bytes:
        """The bytes from start to end of a file; fewer where the file is shorter.

        Raises StoreNotFoundError if there is no such file, StoreUnreachableError if it cannot be read.
        """
        try:
            if self._folder:
                return self._read_folder(path, start, end)
            if self._kept is None or not path.startswith(IMMUTABLE):
                return self._read_system(path, start, end)
            key = f"{path} {start} {end}"
            data = self._kept.get(key)
            if data is None:
                data = self._read_system(path, start, end)
                self._kept.put(key, data, tag=path)
            return data
        except _NOT_THERE as error:
            state = "is a folder and no file" if isinstance(error, IsADirectoryError) else "is missing"
            raise StoreNotFoundError(f"{self.url}/{path} {state}") from error
        except OSError as error:
            raise self._unreachable(path, error) from error

    def forget(self, path: str) -> None:
        """Nothing that is kept of this file is trusted any more: it was found to be damaged."""
        if self._kept is not None:
            self._kept.forget(path)

    def read_many(self, ranges: Sequence[Range]) -> list[bytes | StoreError]:
        """What `read` gives of each range, or the error that it raises: what fails takes nothing else with it.

        Ranges of a file that lie within GAP bytes of each other are one request; AT_ONCE requests are made at a time.
        """
        joined = _joined(ranges)

        def read(wide: Range) -> bytes | StoreError:
            try:
                return self.read(*wide)
            except StoreError as error:
                return error

        wides = [wide for wide, _ in joined]
        if self._folder or len(wides) < 2:
            found = [read(wide) for wide in wides]
        else:
            with ThreadPoolExecutor(min(AT_ONCE, len(wides))) as pool:
                found = list(pool.map(read, wides))
        parts: list[bytes | StoreError] = [b""] * len(ranges)
        for (wide, members), data in zip(joined, found, strict=True):
            for number in members:
                start, end = (at - wide.start for at in ranges[number][1:])
                parts[number] = data[start:end] if isinstance(data, bytes) else data
        return parts

    def size(self, path: str) -> int | None:
        """Length of a file in bytes; None if there is no such file, or if its server does not say.

        Raises StoreUnreachableError if nothing can be learnt of it.
        """
        try:
            size = self._size_in_folder(path) if self._folder else self._ask("size", path)
        except _NOT_THERE:
            return None
        except OSError as error:
            raise self._unreachable(path, error) from error
        return None if size is None else int(size)

    def _read_folder(self, path: str, start: int, end: int | None) -> bytes:
        assert self._folder is not None
        with (self._folder / path).open("rb", buffering=0) as file:
            file.seek(start)
            if end is None:
                return self._counted(file.read())
            data = file.read(end - start)
            while len(data) < end - start and (more := file.read(end - start - len(data))):
                data += more
            return self._counted(data)

    def _counted(self, data: bytes) -> bytes:
        with self._lock:
            self.bytes_fetched += len(data)
        return data

    def _size_in_folder(self, path: str) -> int | None:
        assert self._folder is not None
        found = (self._folder / path).stat()
        return None if stat.S_ISDIR(found.st_mode) else found.st_size

    def _read_system(self, path: str, start: int, end: int | None) -> bytes:
        if end is None:
            return self._counted(bytes(self._ask("cat_file", path)))
        if end <= start:
            return b""
        if self._ranges is None:
            with self._first_range:  # else all who ask at first would get whole files of a server without ranges
                if self._ranges is None:
                    return self._tried(path, start, end)
        if self._ranges:
            return self._counted(bytes(self._ask("cat_file", path, start=start, end=end)))[: end - start]

        def load() -> tuple[bytes, int]:
            whole = self.read(path)
            return whole, len(whole)

        return self._whole.get(path, load)[start:end]

    def _tried(self, path: str, start: int, end: int) -> bytes:
        """The bytes from start to end of a file; afterwards it is known, most often, whether there are ranges."""
        data = self._counted(bytes(self._ask("cat_file", path, start=start, end=end)))
        if len(data) > end - start:  # the server knows no ranges and has sent the whole file
            self._ranges = False
            if self._kept is not None and path.startswith(IMMUTABLE):
                self._kept.put(f"{path} 0 None", data, tag=path)
            return self._whole.get(path, lambda: (data, len(data)))[start:end]
        if start > 0:
            self._ranges = True
        return data

    def _ask(self, operation: str, path: str, **options: int) -> Any:
        """What the file system answers, asked again where that may help. Raises OSError, whatever the system raises."""
        import tenacity

        tell = self._tell

        def say(attempt: tenacity.RetryCallState) -> None:
            if tell is not None and attempt.attempt_number == TOLD_AT:
                tell(f"{self.url}/{path} does not come: trying again for up to {LAST_ATTEMPT:g} seconds ...")

        attempts = tenacity.stop_after_attempt(ATTEMPTS) if tell is None else tenacity.stop_never
        pauses = tenacity.wait_exponential(multiplier=FIRST_PAUSE, max=LONGEST_PAUSE)
        asking = tenacity.Retrying(
            retry=tenacity.retry_if_exception(_may_pass),
            stop=tenacity.stop_any(attempts, tenacity.stop_after_delay(LAST_ATTEMPT)),
            wait=pauses + tenacity.wait_random(0, FIRST_PAUSE),
            before_sleep=say,
            reraise=True,
        )
        try:
            return asking(getattr(self._system, operation), f"{self._prefix}/{path}", **options)
        except OSError:
            raise
        except Exception as error:  # every file system has errors of its own; all of them mean that it gave no answer
            raise OSError(str(error) or type(error).__name__) from error

    def _unreachable(self, path: str, error: OSError) -> StoreUnreachableError:
        status = getattr(error.__cause__, "status", None)
        if isinstance(error, PermissionError) or status in _FORBIDDEN:
            cure = "see that you may read it"
        elif self._folder:
            cure = "see that its disk is there and sound"
        else:
            cure = "see that the address is right and its server runs"
        said = str(error).replace(_TLS_AS_EVER, "") or type(error).__name__
        return StoreUnreachableError(f"{self.url}/{path} cannot be read: {said}; {cure}")


def _joined(ranges: Sequence[Range]) -> list[tuple[Range, list[int]]]:
    """Ranges to request in place of `ranges`, each with the numbers of those that it covers."""
    joined: list[tuple[Range, list[int]]] = []
    for number in sorted(range(len(ranges)), key=ranges.__getitem__):
        path, start, end = ranges[number]
        if joined:
            last, members = joined[-1]
            if last.path == path and start <= last.end + GAP:
                joined[-1] = Range(path, last.start, max(last.end, end)), [*members, number]
                continue
        joined.append((ranges[number], [number]))
    return joined


def _time_limits(url: str) -> dict[str, Any]:
    """What fsspec must be told so that no server named in a URL is waited for without end.

    Object stores have limits of their own. Raises ImportError where HTTP's client is not installed.
    """
    schemes = [scheme for scheme in ("http", "https") if f"{scheme}://" in url]
    if not schemes:
        return {}
    import aiohttp

    limit = aiohttp.ClientTimeout(total=None, sock_connect=CONNECT_TIME, sock_read=SILENCE_TIME)
    return {scheme: {"client_kwargs": {"timeout": limit}} for scheme in schemes}


def _may_pass(error: BaseException) -> bool:
    """Whether another attempt may succeed: the network failed, or the server says that it is at fault."""
    status = getattr(error, "status", None)  # of an HTTP answer, as aiohttp and others call it
    if isinstance(status, int):
        return status >= 500 or status in _LATER
    return isinstance(error, _passing_errors())


def _passing_errors() -> tuple[type[BaseException], ...]:
    """Errors of the network. aiohttp has its own, and no other errors than its own can come where it is missing."""
    try:
        import aiohttp
    except ImportError:
        return (ConnectionError, TimeoutError)
    return (ConnectionError, TimeoutError, aiohttp.ClientConnectionError, aiohttp.ClientPayloadError)
