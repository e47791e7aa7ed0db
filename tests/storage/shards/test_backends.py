"""One conformance suite for every place that a store can be read from."""

import http.server
import shutil
import socket
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest

from storage import open_store
from storage.base.errors import CorruptStoreError, MissingDependencyError, StoreNotFoundError, StoreUnreachableError
from storage.geometry_reader import Geometry
from storage.shards import files
from storage.shards.shards import TAIL_READ, shard_path
from storage.store import Store
from tests.storage.served import Plain, served
from tests.storage.tiny_store import box_part, make_store, room_parts


class _Ranges(http.server.SimpleHTTPRequestHandler):
    """Serves a folder and answers requests for ranges of bytes."""

    def do_GET(self) -> None:
        wanted = self.headers.get("Range")
        path = Path(self.translate_path(self.path))
        if wanted is None or not path.is_file():
            super().do_GET()
            return
        first, last = wanted.removeprefix("bytes=").split("-")
        content = path.read_bytes()[int(first) : int(last) + 1]
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{last}/{path.stat().st_size}")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Keeps quiet."""


def _served(folder: Path, handler: type) -> Iterator[str]:
    with served(folder, handler) as url:
        yield url


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return make_store(tmp_path_factory.mktemp("store"), room_parts())


BACKENDS = ("path", "string", "file", "memory", "http", "plain http")


@pytest.fixture(params=BACKENDS)
def place(request: pytest.FixtureRequest, original: Store, tmp_path: Path) -> Iterator[str | Path]:
    """A copy of the store, at each kind of place."""
    folder = tmp_path / "copy"
    shutil.copytree(original.files.url, folder)
    if request.param == "path":
        yield folder
    elif request.param == "string":
        yield f"{folder}/"
    elif request.param == "file":
        yield folder.as_uri()
    elif request.param == "memory":
        memory = fsspec.filesystem("memory")
        memory.put(str(folder), "/copy", recursive=True)
        yield "memory://copy"
        memory.rm("/copy", recursive=True)
    else:
        yield from _served(folder, _Ranges if request.param == "http" else Plain)


def test_the_same_is_read_everywhere(original: Store, place: str | Path) -> None:
    store = open_store(place)
    assert store.manifest == original.manifest
    assert np.array_equal(store.cells, original.cells)
    for cell in range(0, len(store.cells), 7):
        assert np.array_equal(store.vlod(cell), original.vlod(cell))
        for other in store.neighbours(cell):
            for mine, theirs in zip(store.delta(cell, other), original.delta(cell, other), strict=True):
                assert np.array_equal(mine, theirs)
    for drawable in range(len(store.drawables)):
        for mine, theirs in zip(store.mesh(drawable), original.mesh(drawable), strict=True):
            assert np.array_equal(mine, theirs)
    assert store.bytes_fetched > 0
    assert not list(store.check())


def test_a_missing_store_is_named(place: str | Path) -> None:
    missing = f"{str(place).rstrip('/')}/nothing-here"
    with pytest.raises(StoreNotFoundError, match=r"nothing-here: no manifest.json: not a vLOD store, or its build"):
        open_store(missing)


@pytest.mark.parametrize("scheme", ["path", "memory", "http"])
def test_a_missing_shard_is_named(original: Store, tmp_path: Path, scheme: str) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(original.files.url, folder)
    name = original.manifest.geometry.shards[0].name
    (folder / "shards" / name).unlink()
    places: dict[str, Callable[[], Iterator[str]]] = {
        "path": lambda: iter([str(folder)]),
        "memory": lambda: iter(["memory://holed"]),
        "http": lambda: _served(folder, _Ranges),
    }
    if scheme == "memory":
        fsspec.filesystem("memory").put(str(folder), "/holed", recursive=True)
    serving = places[scheme]()
    store = open_store(next(serving))
    with pytest.raises(CorruptStoreError, match=f"{name} is missing"):
        store.mesh(0)
    problems = list(store.check())
    assert [problem.file for problem in problems] == [f"shards/{name}"]
    assert list(serving) == []
    if scheme == "memory":
        fsspec.filesystem("memory").rm("/holed", recursive=True)


def test_ranges_fetch_less_than_the_files(original: Store) -> None:
    serving = _served(Path(original.files.url), _Ranges)
    store = open_store(next(serving))
    opened = store.bytes_fetched
    store.mesh(0)
    assert store.bytes_fetched - opened < sum(record.bytes for _, record in store.manifest.shards())
    assert list(serving) == []


def test_few_requests_open_a_store_and_read_a_cell(original: Store) -> None:
    """Each is a wait of its own for whoever is far away."""
    asked: list[str] = []

    class Counting(_Ranges):
        def parse_request(self) -> bool:
            understood = super().parse_request()
            asked.append(self.requestline)
            return understood

    def requests() -> int:
        count = len(asked)
        asked.clear()
        return count

    serving = _served(Path(original.files.url), Counting)
    store = open_store(next(serving))
    assert 1 <= requests() <= 3  # the manifest, the tables, the cells' table
    store.vlod(20)
    assert requests() <= 1  # the shard is small, and comes whole
    store.vlod(21)
    store.delta(20, 21)
    assert requests() == 0  # the same shard
    store.mesh(0)
    assert 1 <= requests() <= 2
    assert list(serving) == []


def test_requests_for_a_cell_of_a_large_shard(tmp_path: Path) -> None:
    def visible(geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        return cut[np.random.default_rng(int(cell["key"])).random(len(cut)) < 0.6]

    corners = np.indices((12, 12, 12)).reshape(3, -1).T.tolist()
    parts = [box_part(f"{x} {y} {z}", (x, y, z), (x + 0.5, y + 0.5, z + 0.5), segments=(1,)) for x, y, z in corners]
    written = make_store(tmp_path, parts, depth=3, visible=visible, cells_per_shard=512)
    assert written.manifest.cells is not None
    assert written.manifest.cells.shards[0].bytes > TAIL_READ
    store = open_store(tmp_path)
    asked = 0
    real = store.files.read

    def read(*args: Any) -> bytes:
        nonlocal asked
        asked += 1
        return real(*args)

    store.files.read = read  # type: ignore[method-assign]
    store.vlod(0)
    assert asked == 2  # the shard's end, the group


def test_a_server_without_ranges_sends_each_file_once(tmp_path: Path) -> None:
    asked: list[str] = []

    class Counting(Plain):
        def send_head(self) -> Any:
            asked.append(self.path)
            return super().send_head()

    content = np.random.default_rng(0).bytes(1 << 17)
    (tmp_path / "shard").write_bytes(content)
    serving = _served(tmp_path, Counting)
    files_there = files.Files(next(serving))
    ranges = [files.Range("shard", at, at + 10) for at in range(0, len(content), files.GAP + 20)]
    assert len(ranges) > 1
    for _ in range(2):
        assert files_there.read_many(ranges[::-1]) == [content[start:end] for _, start, end in ranges[::-1]]
    assert asked == ["/shard"]
    assert files_there.bytes_fetched == len(content)
    assert list(serving) == []


def test_many_ranges_at_once(place: str | Path, original: Store) -> None:
    """Near ones share a request; what is missing takes nothing else with it."""
    at = files.Files(place)
    path = shard_path(original.manifest.geometry.shards[0].name)
    content = (Path(original.files.url) / path).read_bytes()
    wanted = [(200, 300), (0, 10), (250, 260), (len(content) - 5, len(content) + 50), (0, 10), (7, 7)]
    *found, missing = at.read_many([*(files.Range(path, *range_) for range_ in wanted), files.Range("no", 0, 1)])
    assert found == [content[start:end] for start, end in wanted]
    assert isinstance(missing, StoreNotFoundError)
    assert at.read_many([]) == []


def test_packs_fetched_together_take_two_rounds(place: str | Path, original: Store) -> None:
    """The ends of shards, then all frames; afterwards nothing more is read."""
    store = open_store(place)
    store.fetch(list(range(len(store.packs))))
    before = store.bytes_fetched
    for number in range(len(store.packs)):
        assert np.array_equal(store.pack(number).positions, original.pack(number).positions)
    assert store.bytes_fetched == before


def test_near_ranges_are_one_request(original: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    at = files.Files(original.files.url)
    asked: list[tuple[Any, ...]] = []
    real = at.read
    monkeypatch.setattr(at, "read", lambda *args: asked.append(args) or real(*args))
    path = shard_path(original.manifest.geometry.shards[0].name)
    far = 50 + files.GAP
    at.read_many([files.Range(path, far + 1, far + 2), files.Range(path, 40, 50), files.Range(path, 0, 20)])
    assert sorted(asked) == [(path, 0, 50), (path, far + 1, far + 2)]


def test_a_server_that_is_not_there() -> None:
    with pytest.raises(
        StoreUnreachableError,
        match=r"^http://127.0.0.1:9/none/manifest.json cannot be read: .* 127.0.0.1:9 \[.*; see that the address",
    ) as caught:
        open_store("http://127.0.0.1:9/none")
    assert "ssl" not in str(caught.value)


class _Refusing(_Ranges):
    """Refuses the first requests of each run with a status, and counts them all."""

    status = 503
    refusals = 2
    requests = 0

    def do_GET(self) -> None:
        type(self).requests += 1
        if type(self).requests <= self.refusals:
            self.send_error(self.status)
        else:
            super().do_GET()


@pytest.fixture
def refusing(monkeypatch: pytest.MonkeyPatch) -> type[_Refusing]:
    monkeypatch.setattr(files, "FIRST_PAUSE", 0.01)
    return type("Refusing", (_Refusing,), {})


@pytest.mark.parametrize("status", [500, 503, 429])
def test_what_a_busy_server_refuses_is_asked_again(original: Store, refusing: type[_Refusing], status: int) -> None:
    refusing.status = status
    serving = _served(Path(original.files.url), refusing)
    place = files.Files(next(serving))
    assert place.read("manifest.json") == original.files.read("manifest.json")
    assert refusing.requests == 3
    assert place.bytes_fetched == len(place.read("manifest.json"))
    assert list(serving) == []


@pytest.mark.parametrize(
    ("status", "expected", "said"),
    [
        (404, StoreNotFoundError, r"manifest\.json is missing$"),
        (403, StoreUnreachableError, r"manifest\.json cannot be read: 403, .*; see that you may read it$"),
    ],
)
def test_what_is_not_there_or_not_allowed_is_asked_once(
    original: Store, refusing: type[_Refusing], status: int, expected: type[Exception], said: str
) -> None:
    refusing.status, refusing.refusals = status, 9
    serving = _served(Path(original.files.url), refusing)
    with pytest.raises(expected, match=said):
        files.Files(next(serving)).read("manifest.json")
    assert refusing.requests == 1
    assert list(serving) == []


def test_a_server_that_only_fails_is_given_up(original: Store, refusing: type[_Refusing]) -> None:
    refusing.refusals = 99
    serving = _served(Path(original.files.url), refusing)
    place = files.Files(next(serving))
    with pytest.raises(StoreUnreachableError, match=r"manifest\.json cannot be read: 503"):
        place.read("manifest.json")
    assert refusing.requests == files.ATTEMPTS
    assert list(serving) == []


def test_a_server_that_falls_silent_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "SILENCE_TIME", 0.1)
    monkeypatch.setattr(files, "FIRST_PAUSE", 0.01)
    with socket.create_server(("127.0.0.1", 0)) as listening:  # accepts, and never says a word
        began = time.monotonic()
        with pytest.raises(StoreUnreachableError, match="x cannot be read"):
            files.Files(f"http://127.0.0.1:{listening.getsockname()[1]}").read("x")
        assert time.monotonic() - began < 20


def test_whatever_a_file_system_raises_means_that_it_gave_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    class OfItsOwnError(Exception):
        """Neither an OSError nor known to anyone here."""

    def fail(*_: object, **__: object) -> None:
        raise OfItsOwnError("the bucket is closed")

    place = files.Files("memory://somewhere")
    monkeypatch.setattr(type(place._system), "cat_file", fail)
    with pytest.raises(StoreUnreachableError, match="memory://somewhere/x cannot be read: the bucket is closed"):
        place.read("x")


def test_http_without_aiohttp(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    monkeypatch.delitem(sys.modules, "fsspec.implementations.http", raising=False)
    loaded = sys.modules["fsspec.registry"]
    monkeypatch.delitem(loaded._registry, "http", raising=False)
    monkeypatch.delitem(loaded._registry, "https", raising=False)
    with pytest.raises(MissingDependencyError, match=r"pip install 'fsspec\[http\]'"):
        open_store("http://127.0.0.1:9/never-reached")


def test_addresses_that_make_no_sense() -> None:
    with pytest.raises(StoreNotFoundError, match="is no address that can be opened"):
        open_store("unheard-of://somewhere")


@pytest.mark.skipif(sys.platform == "win32", reason="needs unix permissions")
def test_a_store_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(StoreUnreachableError, match=r"cannot be read: .*Permission denied.*; see that you may"):
        open_store(tmp_path)


def test_a_disk_that_fails_and_a_folder_for_a_file(tmp_path: Path) -> None:
    (tmp_path / "itself").symlink_to("itself")
    (tmp_path / "folder").mkdir()
    place = files.Files(tmp_path)
    with pytest.raises(StoreUnreachableError, match=r"itself cannot be read: .*; see that its disk is there"):
        place.read("itself")
    with pytest.raises(StoreNotFoundError, match=f"^{tmp_path}/folder is a folder and no file$"):
        place.read("folder")
    assert place.size("folder") is None


def test_a_file_is_no_store(tmp_path: Path) -> None:
    file = tmp_path / "model.glb"
    file.write_bytes(b"glTF")
    with pytest.raises(StoreNotFoundError, match="not a vLOD store"):
        open_store(file)


def test_what_was_read_once_comes_from_the_disk_next_time(original: Store, tmp_path: Path) -> None:
    pytest.importorskip("diskcache")
    folder = tmp_path / "cache"
    serving = _served(Path(original.files.url), _Ranges)
    url = next(serving)
    first = open_store(url, cache_dir=folder)
    first.vlod(20), first.mesh(0)
    again = open_store(url, cache_dir=folder)
    assert np.array_equal(again.vlod(20), original.vlod(20))
    assert np.array_equal(again.mesh(0).positions, original.mesh(0).positions)
    assert again.bytes_fetched == len((Path(original.files.url) / "manifest.json").read_bytes())
    assert list(serving) == []


def test_damage_that_was_kept_is_fetched_anew(original: Store, tmp_path: Path) -> None:
    pytest.importorskip("diskcache")
    shutil.copytree(original.files.url, tmp_path / "copy")
    shard = tmp_path / "copy" / shard_path(original.manifest.geometry.shards[0].name)
    sound = shard.read_bytes()
    shard.write_bytes(bytes([*sound[:20], sound[20] ^ 1, *sound[21:]]))
    serving = _served(tmp_path / "copy", _Ranges)
    url = next(serving)
    with pytest.raises(CorruptStoreError):
        open_store(url, cache_dir=tmp_path / "cache").mesh(0)
    shard.write_bytes(sound)
    again = open_store(url, cache_dir=tmp_path / "cache")
    assert np.array_equal(again.mesh(0).positions, original.mesh(0).positions)
    assert list(serving) == []


def test_round_trips(original: Store) -> None:
    """What is asked for at once is one wait for whoever is far away: two to open, one for a cell, two for packs."""
    spans: list[tuple[float, float]] = []

    class Slow(_Ranges):
        def do_GET(self) -> None:
            begun = time.monotonic()
            time.sleep(0.2)
            super().do_GET()
            spans.append((begun, time.monotonic()))

    def trips() -> int:
        """Most requests of which each began after the one before it had ended."""
        count, ended = 0, 0.0
        for begun, end in sorted(spans, key=lambda span: span[1]):
            if begun >= ended - 0.1:
                count, ended = count + 1, end
        spans.clear()
        return count

    serving = _served(Path(original.files.url), Slow)
    store = open_store(next(serving))
    assert trips() == 2
    store.vlod(20)
    assert trips() <= 1
    store.fetch(list(range(len(store.packs))))
    assert trips() <= 2
    assert list(serving) == []
