"""gc: what is kept stays, what nothing kept needs goes, and a kill in between leaves a sound store."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.errors import WorkInUseError
from jobs.running.executors import SerialExecutor
from jobs.running.tasks import RECORD
from jobs.running.workplace import Workplace
from jobs.upkeep import garbage
from jobs.upkeep.folder import held
from jobs.upkeep.garbage import collect_garbage
from storage import open_store
from storage.base.errors import CorruptStoreError, ParameterError, StoreNotFoundError
from storage.base.temporary import host
from storage.cli.command import vlod
from storage.versions import content_of
from tests.jobs.tiny_model import write_rooms
from tests.jobs.upkeep.two_versions import all_of, all_of_version, content, make_two_versions, put
from tests.storage.tiny_store import make_store, room_parts

#: The number of a process that there cannot be.
DEAD = 2**31 - 1


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Three versions, the last one's geometry another."""
    make_two_versions(tmp_path / "store")
    make_store(tmp_path / "store", room_parts()[3:], depth=0)
    return tmp_path / "store"


def named(root: Path, *versions: int) -> set[str]:
    """The shards of some versions."""
    return {record.name for version in versions for _, record in open_store(root, version=version).manifest.shards()}


def in_folder(root: Path) -> set[str]:
    return {path.name for path in (root / "shards").iterdir()}


def test_without_options_all_versions_are_kept_and_only_orphans_go(store: Path) -> None:
    before = content(store)
    (store / "shards" / ("0" * 32)).write_bytes(b"an orphan")
    (store / "shards" / "notes.txt").write_text("no shard at all")
    (store / "shards" / f".tmp-{host()}-{DEAD}-x").write_bytes(b"half")
    (store / "versions" / f".tmp-{host()}-{DEAD}-x").write_bytes(b"half")
    (store / f".tmp-{host()}-{DEAD}-x" / "shards").mkdir(parents=True)
    (store / f".tmp-{host()}-{DEAD}-x" / "shards" / ("1" * 32)).write_bytes(b"of a repair")
    found = collect_garbage(str(store))
    assert (found.kept, found.dropped) == ((1, 2, 3), ())
    assert found.bytes == len("an orphan") + 2 * len("half") + len("of a repair")
    assert content(store) == {**before, "shards/notes.txt": b"no shard at all"}


@pytest.mark.parametrize(
    ("options", "kept"),
    [
        ({"keep": 1}, (3,)),
        ({"keep": 2}, (2, 3)),
        ({"keep": 9}, (1, 2, 3)),
        ({"keep_versions": [1]}, (1, 3)),
        ({"keep_versions": [2, 3]}, (2, 3)),
        ({"keep_versions": []}, (3,)),
    ],
)
def test_versions_that_are_not_kept_go_with_what_only_they_need(
    store: Path, options: dict[str, object], kept: tuple[int, ...]
) -> None:
    before, shown = content(store), {version: all_of_version(store, version) for version in kept}
    told = collect_garbage(str(store), **options, dry_run=True)  # type: ignore[arg-type]
    assert content(store) == before
    found = collect_garbage(str(store), **options)  # type: ignore[arg-type]
    assert told == found
    assert found.kept == kept
    assert found.dropped == tuple(sorted({1, 2, 3} - set(kept)))
    assert in_folder(store) == named(store, *kept)
    left = content(store)
    assert found.bytes == sum(map(len, before.values())) - sum(map(len, left.values()))
    assert left == {name: before[name] for name in left}
    assert {path.name for path in (store / "versions").iterdir()} == {f"{version}.json" for version in kept}
    for version in kept:
        assert all((a == b).all() for a, b in zip(all_of_version(store, version), shown[version], strict=True))
    for version in found.dropped:
        with pytest.raises(StoreNotFoundError, match=f"no version {version}"):
            open_store(store, version=version)


def test_a_reader_of_a_kept_version_goes_on(store: Path) -> None:
    pinned, shown = open_store(store, version=2), all_of_version(store, 2)
    collect_garbage(str(store), keep=2)
    assert all((a == b).all() for a, b in zip(all_of(pinned), shown, strict=True))


def test_the_next_version_counts_on(store: Path) -> None:
    collect_garbage(str(store), keep=1)
    assert make_two_versions(store) == store
    assert sorted(path.name for path in (store / "versions").iterdir()) == ["3.json", "4.json", "5.json"]


def test_a_kill_at_any_moment_leaves_what_is_kept_and_no_version_without_its_shards(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (store / "shards" / ("0" * 32)).write_bytes(b"an orphan")
    before = content(store)
    gone, steps = garbage._gone, 0

    class Killed(BaseException):
        """As a kill: nothing else runs."""

    while True:
        folder, left = put(tmp_path / "copy", before), steps

        def step(path: Path) -> None:
            nonlocal left
            if left == 0:
                raise Killed
            left -= 1
            gone(path)

        monkeypatch.setattr(garbage, "_gone", step)
        try:
            collect_garbage(str(folder), keep=1)
            break
        except Killed:
            for path in (folder / "versions").iterdir():
                assert list(open_store(folder, version=int(path.stem)).check()) == []
        monkeypatch.setattr(garbage, "_gone", gone)
        collect_garbage(str(folder), keep=1)
        assert in_folder(folder) == named(folder, 3)
        steps += 1
    assert steps > 5


def test_what_an_unfinished_commit_left_goes(store: Path) -> None:
    """It writes the new version's manifest, and then the current one."""
    (store / "versions" / "4.json").write_bytes((store / "manifest.json").read_bytes())
    collect_garbage(str(store))
    assert sorted(path.name for path in (store / "versions").iterdir()) == ["1.json", "2.json", "3.json"]


def test_a_kept_version_that_cannot_be_read_stops_it(store: Path) -> None:
    (store / "versions" / "2.json").write_bytes(b"{}")
    before = content(store)
    with pytest.raises(CorruptStoreError, match=r"versions/2\.json is damaged.*or do not keep version 2"):
        collect_garbage(str(store))
    assert content(store) == before
    assert collect_garbage(str(store), keep=1).dropped == (1, 2)
    assert in_folder(store) == named(store, 3)


def test_what_is_refused(store: Path, tmp_path: Path) -> None:
    before = content(store)
    with pytest.raises(ParameterError, match="has no version 7, 9, but 1, 2, 3"):
        collect_garbage(str(store), keep_versions=[9, 1, 7])
    with pytest.raises(ParameterError, match="do not go together"):
        collect_garbage(str(store), keep=1, keep_versions=[1])
    with pytest.raises(ParameterError, match="--keep must be 1 or more"):
        collect_garbage(str(store), keep=0)
    with pytest.raises(ParameterError, match=r"http://x/y is an address"):
        collect_garbage("http://x/y")
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / ("0" * 32)).write_bytes(b"no store")
    with pytest.raises(StoreNotFoundError, match=r"no manifest\.json"):
        collect_garbage(str(tmp_path / "home"))
    assert [path.name for path in (tmp_path / "home").iterdir()] == ["0" * 32]
    assert content(store) == before


def test_not_while_a_build_runs_and_no_build_meanwhile(store: Path, tmp_path: Path) -> None:
    before = content(store)
    for work in (store / "work", tmp_path / "elsewhere"):
        place = Workplace(work, store)
        place.work.mkdir()
        who = f"another build \\(process {os.getpid()} on {re.escape(host())}\\)"
        with (
            place.locked(),
            pytest.raises(WorkInUseError, match=f"{store}.* is in use by {who}: wait for it, or end it"),
        ):
            collect_garbage(str(store), keep=1)
        with (
            held("vlod gc", place.work, store),
            pytest.raises(WorkInUseError, match=f"in use by vlod gc \\(process {os.getpid()} "),
            place.locked(),
        ):
            pass
    assert content(store) == before
    (store / "work").rmdir()
    assert collect_garbage(str(store), keep=1).dropped == (1, 2)
    assert not (store / "work").exists()
    assert not (store / "lock").exists()


def result(work: Path, stage: str, key: str, record: dict[str, object]) -> Path:
    """A finished task's result of 100 bytes and its record."""
    folder = work / stage / (key * 32)
    folder.mkdir(parents=True)
    (folder / "data").write_bytes(bytes(100))
    (folder / RECORD).write_text(json.dumps({"record": record}))
    return folder


def test_results_that_kept_versions_were_made_from_stay(store: Path) -> None:
    """By hand: each result's key is one digit, 32 times over."""
    work = store / "work"
    kept = [
        result(work, "import", "1", {"digest": "x"}),
        result(work, "nodes", "2", {"drafts": [["d" * 32, 1]]}),
        result(work, "tables", "3", {"shards": [[name, 1] for name in named(store, 3)]}),
    ]
    dropped = [result(work, "import", "8", {"digest": "y"}), result(work, "tables", "9", {})]
    gone = [result(work, "cells", "5", {})]  # made, and no version came of it
    place = Workplace(work, store)
    for version, keys in ((1, "182"), (2, "9"), (3, "123")):
        note = content_of(open_store(store, version=version).manifest)
        place.note(note, {"any": [key * 32 for key in keys]})
        if version < 3:
            dropped.append(work / "versions" / note)
        else:
            kept.append(work / "versions" / note)
    torn = work / "old" / ("b" * 32)
    torn.mkdir(parents=True)
    (torn / RECORD).write_text('{"record"')
    for name in ("d", "e"):
        (work / "drafts" / "shards").mkdir(parents=True, exist_ok=True)
        (work / "drafts" / "shards" / (name * 32)).write_bytes(bytes(10))
    (work / "import" / "notes.txt").write_text("nobody's")
    make_store(work / "other.store", room_parts()[:1], depth=0)
    other = content(work / "other.store")
    left = work / "cells" / f".tmp-{host()}-{DEAD}-x"
    left.mkdir()
    (left / "half").write_bytes(bytes(50))

    gone += [torn, work / "drafts" / "shards" / ("e" * 32)]
    assert {item.path for item in collect_garbage(str(store), dry_run=True).results} == set(gone)
    found = collect_garbage(str(store), keep=1)
    assert {item.path for item in found.results} == {*gone, *dropped}
    assert [item.bytes for item in found.leftovers] == [50]
    assert all(path.exists() for path in kept)
    assert not any(path.exists() for path in (*gone, *dropped, torn.parent, left))
    assert [path.name for path in (work / "drafts" / "shards").iterdir()] == ["d" * 32]
    assert (work / "import" / "notes.txt").is_file()
    assert content(work / "other.store") == other
    assert list(work.rglob(".tmp-*")) == []


def test_the_command(store: Path) -> None:
    before = content(store)
    told = CliRunner().invoke(vlod, ["gc", str(store), "--keep-versions", "2,3", "--dry-run", "--json"])
    facts = json.loads(told.stdout)
    assert (facts["kept"], facts["dropped"], facts["dry_run"]) == ([2, 3], [1], True)
    assert facts["bytes"] == facts["shards"]["bytes"] + facts["manifests"]["bytes"] > 0
    assert content(store) == before
    said = CliRunner().invoke(vlod, ["gc", str(store), "--keep", "2"])
    assert said.exit_code == 0
    assert f"versions kept: 2, 3; dropped: 1; removed {facts['shards']['count']} shards, 0 results" in said.stdout
    assert f"{facts['bytes']:,} bytes" in said.stdout
    assert sum(map(len, before.values())) - sum(map(len, content(store).values())) == facts["bytes"]
    wrong = CliRunner().invoke(vlod, ["gc", str(store), "--keep-versions", "2;3"])
    assert wrong.exit_code == 2
    assert "--keep-versions wants numbers with commas between them, such as 3,5, not '2;3'" in wrong.output


@pytest.mark.slow
def test_a_build_of_a_kept_version_finds_all_that_it_did(tmp_path: Path) -> None:
    """Also tasks that only led to others, and those that were done for an earlier version."""
    model, root = write_rooms(tmp_path / "rooms.obj", rooms=2), tmp_path / "store"
    reports = []
    for error in (1.0, 2.0, 2.0, 1.0):
        parameters = BuildParameters(triangles_per_cell=150, max_depth=3, pixel_error=error)
        reports.append(build([model], root, parameters, SerialExecutor()))
        if len(reports) == 2:
            assert collect_garbage(str(root)).bytes == 0
            assert len(collect_garbage(str(root), keep=1).results) > 5
    assert [report.version for report in reports] == [1, 2, 2, 3]
    assert reports[2].tasks_run == 0
    made = {stage.name for stage in reports[3].stages if stage.run}
    assert "cells" in made
    assert made.isdisjoint({"import", "pieces", "hierarchy", "shared", "nodes", "tables"})
