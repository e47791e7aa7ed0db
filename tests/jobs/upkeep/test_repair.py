"""Repair: from wherever sound bytes are, nothing else is touched, and what cannot be mended is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.errors import WorkInUseError
from jobs.running.executors import SerialExecutor
from jobs.running.workplace import Workplace
from jobs.upkeep import rebuilt
from jobs.upkeep.repair import repair
from storage import open_store
from storage.base.errors import CorruptStoreError, ParameterError, StoreNotFoundError
from storage.cli.command import vlod
from storage.shards.manifest import FILE
from tests.jobs.tiny_model import write_rooms
from tests.jobs.upkeep.two_versions import content, make_two_versions, put
from tests.storage.tiny_store import make_store, room_parts


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_two_versions(tmp_path_factory.mktemp("sound") / "store")


@pytest.fixture
def store(sound: Path, tmp_path: Path) -> Path:
    return put(tmp_path / "store", content(sound))


def shards_of(root: Path, purpose: str, version: int | None = None) -> list[str]:
    manifest = open_store(root, version=version).manifest
    return [f"shards/{record.name}" for what, record in manifest.shards() if what == purpose]


def test_a_sound_store_is_left_alone(store: Path, sound: Path) -> None:
    stamps = {path: path.stat().st_mtime_ns for path in store.rglob("*")}
    done = repair(str(store), source=str(sound))
    assert (done.mended, done.left) == ([], [])
    assert {path: path.stat().st_mtime_ns for path in store.rglob("*") if path.is_file()} == {
        path: stamp for path, stamp in stamps.items() if path.is_file()
    }


def test_where_no_bytes_are_at_hand_it_is_said_and_nothing_is_changed(store: Path) -> None:
    bad, missing = shards_of(store, "cells")[:2]
    (store / bad).write_bytes(b"rubbish")
    (store / missing).unlink()
    before = content(store)
    done = repair(str(store))
    assert done.mended == []
    assert len(done.left) == 2
    for name, line in zip((bad, missing), done.left, strict=True):
        assert line == (
            f"{store}/{name} cannot be mended: no sound copy of it is at hand: "
            "name another copy of the store (--from) or its model (--model)"
        )
    assert content(store) == before


def test_the_work_directory_is_looked_through(store: Path, tmp_path: Path) -> None:
    before = content(store)
    first, second = shards_of(store, "geometry")[0], shards_of(store, "cells", 1)[0]
    for work, name in ((store / "work", first), (tmp_path / "elsewhere", second)):
        (work / "drafts" / "shards").mkdir(parents=True)
        (work / "drafts" / name).write_bytes(before[name])
        (store / name).unlink()
        (work / "drafts" / "shards" / ("0" * 32)).write_bytes(b"another")
    done = repair(str(store))
    assert done.mended == [(first, f"{store}/work/drafts/{first}")]
    assert [line.split()[0] for line in done.left] == [f"{store}/{second}"]
    done = repair(str(store), work=tmp_path / "elsewhere")
    assert done.mended == [(second, f"{tmp_path}/elsewhere/drafts/{second}")]
    assert {name: data for name, data in content(store).items() if not name.startswith("work/")} == before


def test_what_is_damaged_elsewhere_too_is_not_taken(store: Path, sound: Path, tmp_path: Path) -> None:
    name, other = shards_of(store, "cells")[:2]
    copy = put(tmp_path / "copy", content(sound))
    for root in (store, copy):
        (root / name).write_bytes(b"x" + (root / name).read_bytes()[1:])
        (root / other).unlink()
    (copy / other).write_bytes((sound / other).read_bytes()[:-1])
    before = content(store)
    assert len(repair(str(store), source=str(copy)).left) == 2
    assert content(store) == before
    assert repair(str(store), source=sound.as_uri()).left == []
    assert content(store) == content(sound)


def test_manifests_are_mended_from_each_other(store: Path) -> None:
    before = content(store)
    (store / FILE).write_bytes(b"{}")
    assert repair(str(store)).mended == [(FILE, "versions/2.json")]
    (store / "versions" / "2.json").unlink()
    assert repair(str(store)).mended == [("versions/2.json", FILE)]
    assert content(store) == before
    (store / "versions" / "1.json").write_bytes(b"{}")
    done = repair(str(store))
    assert done.mended == []
    assert "versions/1.json is damaged" in done.left[0]
    assert "--from" in done.left[0]


def test_nothing_is_known_without_any_manifest(store: Path, sound: Path) -> None:
    for name in (FILE, "versions/2.json", "versions/1.json"):
        (store / name).write_bytes(b"{}")
    before = content(store)
    with pytest.raises(CorruptStoreError, match=r"manifest\.json cannot be mended: no sound copy"):
        repair(str(store))
    assert content(store) == before
    assert repair(str(store), source=str(sound)).left == []
    assert content(store) == content(sound)


def test_another_store_gives_shards_but_no_manifests(store: Path, tmp_path: Path) -> None:
    """Shards are known by their content, wherever they lie; versions are counted in each store anew."""
    other = tmp_path / "other"
    make_store(other, room_parts()[4:], depth=1, cells_per_shard=8)
    make_store(other, room_parts()[:1], depth=0)
    before = content(store)
    geometry = shards_of(store, "geometry")[0]
    (store / geometry).unlink()
    (store / "versions" / "2.json").write_bytes(b"{}")
    (store / FILE).unlink()
    with pytest.raises(CorruptStoreError):
        repair(str(store), source=str(other))
    (store / FILE).write_bytes(before[FILE])
    assert repair(str(store), source=str(other)).mended == [("versions/2.json", FILE), (geometry, str(other))]
    assert content(store) == before


def test_what_is_refused(store: Path, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="memory://x is an address"):
        repair("memory://x")
    with pytest.raises(StoreNotFoundError, match="nothing of a vLOD store"):
        repair(str(tmp_path / "nowhere"))
    with pytest.raises(StoreNotFoundError, match=r"nowhere: no manifest\.json"):
        repair(str(store), source=str(tmp_path / "nowhere"))
    with Workplace(store / "work", store).locked(), pytest.raises(WorkInUseError, match="another build"):
        repair(str(store))


def test_the_command(store: Path, sound: Path) -> None:
    name = shards_of(store, "cells")[0]
    (store / name).unlink()
    check = ["verify", str(store), "--samples", "0"]
    said = CliRunner().invoke(vlod, [*check, "--repair"])
    assert said.exit_code == 1
    assert f"{store}/{name} cannot be mended" in said.stdout
    assert "NOT sound" in said.stdout
    said = CliRunner().invoke(vlod, [*check, "--repair", "--from", str(sound)])
    assert said.exit_code == 0, said.output
    assert f"mended {name} from {sound}\n" in said.stdout
    said = CliRunner().invoke(vlod, [*check, "--repair"])
    assert said.stdout.startswith("nothing to mend\n")
    (store / name).unlink()
    facts = json.loads(CliRunner().invoke(vlod, [*check, "--repair", "--from", str(sound), "--json"]).stdout)
    assert facts["ok"]
    assert facts["repairs"] == {"mended": [{"file": name, "source": str(sound)}], "left": []}
    assert content(store) == content(sound)
    said = CliRunner().invoke(vlod, [*check, "--from", str(sound)])
    assert said.exit_code == 2
    assert "--repair" in said.output


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A model, and a store of two versions that was built from it; the tasks' results lie in the store."""
    folder = tmp_path_factory.mktemp("built")
    model = write_rooms(folder / "rooms.obj", rooms=2)
    for error in (1.0, 2.0):
        parameters = BuildParameters(triangles_per_cell=150, max_depth=2, pixel_error=error, up="z", seal=0.01)
        build([model], folder / "store", parameters, SerialExecutor())
    return model, folder / "store"


@pytest.mark.parametrize("with_work", [True, False], ids=["with results", "without"])
def test_shards_of_all_versions_are_made_again_from_the_model(
    built: tuple[Path, Path], tmp_path: Path, with_work: bool
) -> None:
    model, original = built
    files = {name: data for name, data in content(original).items() if with_work or not name.startswith("work/")}
    store = put(tmp_path / "store", files)
    stored = {name: data for name, data in files.items() if not name.startswith("work/")}
    old, new = (set(shards_of(store, "cell table", version)) for version in (1, 2))
    bad = {min(old - new), min(new - old), *(shards_of(store, kind)[0] for kind in ("tables", "geometry", "cells"))}
    for name in bad:
        (store / name).write_bytes(stored[name][::-1])
    done = repair(str(store), model=[model], workers=1)
    assert done.left == []
    assert {file for file, _ in done.mended} == bad
    assert {source for _, source in done.mended} == {str(model)}
    assert {name: data for name, data in content(store).items() if not name.startswith("work/")} == stored
    assert (store / "work").exists() == with_work
    assert list(store.rglob(".tmp-*")) == []


def test_another_model_gives_nothing(built: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, original = built
    store = put(tmp_path / "store", content(original))
    name = shards_of(store, "cells")[0]
    (store / name).write_bytes(b"rubbish")
    other = write_rooms(tmp_path / "others.obj", rooms=1)
    before = {path: data for path, data in content(store).items() if not path.startswith("work/")}
    monkeypatch.setattr(rebuilt, "build", lambda *_: pytest.fail("the model is another"))
    done = repair(str(store), model=[other], workers=1)
    assert done.mended == []
    assert done.left == [f"{store}/{name} cannot be mended: it does not come out of this model"]
    assert {path: data for path, data in content(store).items() if not path.startswith("work/")} == before
    assert list(store.rglob(".tmp-*")) == []
