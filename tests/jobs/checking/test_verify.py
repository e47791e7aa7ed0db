"""Verify: sound stores pass, and a store that leaves out what can be seen is caught."""

from __future__ import annotations

from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from jobs.checking.findings import MOST_SPELLED, Problems, VerifyReport
from jobs.checking.verify import cells_to_sample, verify
from storage.base.errors import CURE, StoreUnreachableError
from storage.base.progress import Silent
from storage.geometry_reader import Geometry
from storage.meshes.facets import find_turned_away
from storage.shards.manifest import commit
from storage.shards.shards import shard_path
from storage.store import Store
from tests.storage.tiny_store import box_part, make_store, mistold, room_parts


def test_a_store_that_shows_everything_is_sound(tmp_path: Path) -> None:
    make_store(tmp_path / "store", room_parts(), depth=1)
    report = verify(str(tmp_path / "store"), samples=300, cells=8)
    assert report.problems == []
    assert report.rays == 8 * 300
    assert report.missed == 0


def test_a_drawable_left_out_of_one_cell_is_named(tmp_path: Path) -> None:
    table = [part.name for part in room_parts()].index("table")

    def visible(geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        part = geometry.nodes["part"][geometry.drawables["node"][cut]]
        return cut[part != table] if int(cell["key"]) == 0o17 else cut

    make_store(tmp_path / "store", room_parts(), depth=1, visible=visible)
    report = verify(str(tmp_path / "store"), samples=300, cells=8)
    assert not report.ok
    assert report.missed == len(report.problems) == 1
    assert "(key 15) misses drawable" in report.problems[0]
    assert "'table'" in report.problems[0]
    seen = [cell.missed for cell in report.sampled if cell.key == 0o17]
    assert seen == [1]


@pytest.mark.parametrize("left_out", ["wall west", "chair", "table"])
def test_a_pane_left_out_and_what_is_seen_through_it_alone_are_named(tmp_path: Path, left_out: str) -> None:
    """A room with a glass wall, a glass box in it, and a chair in the box."""
    glass = (150, 180, 200, 90)
    parts = [replace(part, colour=glass) if part.name == "wall west" else part for part in room_parts()[:5]]
    parts += [
        box_part("table", (3, 2, 0), (5, 4, 2), colour=glass),
        box_part("chair", (3.5, 2.5, 0.2), (4.5, 3.5, 1.8)),
        box_part("yard", (-3, -1, -0.1), (-0.1, 7, 0)),
    ]

    def visible(geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        part = geometry.nodes["part"][geometry.drawables["node"][cut]]
        outside = int(cell["key"]) == 0o11
        return cut[part != [p.name for p in parts].index(left_out)] if outside else cut

    make_store(tmp_path / "sound", parts, depth=1)
    assert verify(str(tmp_path / "sound"), samples=900, cells=8).ok
    make_store(tmp_path / "store", parts, depth=1, visible=visible)
    report = verify(str(tmp_path / "store"), samples=900, cells=8)
    assert report.missed == len(report.problems) == 1
    assert f"'{left_out}'" in report.problems[0]


def test_a_facet_wrongly_left_out_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rays find the fronts of what a test that is a little too bold takes for backs."""

    def bold(
        first: np.ndarray, count: np.ndarray, instance: np.ndarray, scale: np.ndarray, cones: np.ndarray,
        *others: object,
    ) -> np.ndarray:  # fmt: skip
        wide = cones.copy()
        wide[:, 6] -= 0.2
        return find_turned_away(first, count, instance, scale, wide, *others)

    sound = make_store(tmp_path / "sound", room_parts(), depth=2)
    assert verify(str(tmp_path / "sound"), samples=1000, cells=20).ok
    monkeypatch.setattr("storage.meshes.turned_away.find_turned_away", bold)
    store = make_store(tmp_path / "store", room_parts(), depth=2)
    assert (store.cells["turned_triangles"] >= sound.cells["turned_triangles"]).all()
    report = verify(str(tmp_path / "store"), samples=1000, cells=20)
    assert report.missed >= 5
    assert all("misses the front of a facet that it leaves out of drawable" in line for line in report.problems)


def test_a_wrong_count_of_what_is_turned_away_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_store(tmp_path / "store", room_parts(), depth=1)
    monkeypatch.setattr("storage.meshes.turned_away.find_turned_away", lambda *given: ~find_turned_away(*given))
    report = verify(str(tmp_path / "store"), samples=0, cells=8)
    assert len(report.problems) == 8
    assert "triangles of its vLOD are turned away, the table says" in report.problems[0]


def test_what_a_sampled_store_misses_is_measured_and_is_no_problem(tmp_path: Path) -> None:
    """The share of rays that meet what is left out: the same rays that accuse a store that promises to miss nothing."""
    table = [part.name for part in room_parts()].index("table")

    def visible(geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        part = geometry.nodes["part"][geometry.drawables["node"][cut]]
        return cut[part != table] if int(cell["key"]) == 0o17 else cut

    store = make_store(tmp_path / "store", room_parts(), depth=1, visible=visible)
    accused = verify(str(tmp_path / "store"), samples=3000, cells=8)
    commit(tmp_path / "store", replace(store.manifest, parameters={**store.manifest.parameters, "sampled": True}))
    report = verify(str(tmp_path / "store"), samples=3000, cells=8)
    assert not accused.ok
    assert report.ok
    assert report.approximation == "--sampled"
    assert report.missed == accused.missed == 1
    assert report.uniform_rays == 8 * 1000
    assert 0 < report.missed_rays == accused.missed_rays < 1000
    assert [cell.key for cell in report.sampled if cell.missed_rays] == [0o17]
    written = report.to_json()
    assert (written["approximation"], written["missed_rays"]) == ("--sampled", report.missed_rays)
    assert (written["stored_rays"], written["stored_missed_rays"]) == (0, 0)


def damage(store: Store, purpose: str, number: int) -> str:
    """Changes a byte in the middle of a shard; returns the shard's path inside the store."""
    shard = [record for what, record in store.manifest.shards() if what == purpose][number]
    path = Path(store.files.url) / shard_path(shard.name)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)
    return shard_path(shard.name)


def findings(report: VerifyReport) -> dict[str, Any]:
    """All that a report says but the time that it took."""
    said = report.to_json()
    del said["seconds"]
    for cell in said["per_cell"]:
        del cell["seconds"]
    return said


def some(_geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
    """Other drawables for each cell, so that no two shards are the same."""
    return cut[np.random.default_rng(int(cell["key"])).random(len(cut)) < 0.7]


def test_the_findings_do_not_depend_on_the_number_of_workers(tmp_path: Path) -> None:
    def visible(_geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        return cut[: len(cut) // 2] if int(cell["key"]) % 3 == 0 else cut

    store = make_store(tmp_path / "store", room_parts(), depth=2, visible=visible)
    damage(store, "cells", 1)
    alone, shared = (verify(str(tmp_path / "store"), samples=100, cells=8, workers=count) for count in (1, 2))
    assert alone.missed > 0
    assert alone.read_cells > 0
    assert alone.problems[0].startswith(f"{tmp_path}/store/shards/")
    assert findings(alone) == findings(shared)


def test_work_that_takes_long_is_shared_out_on_the_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_store(tmp_path / "store", room_parts(), depth=1)
    alone = verify(str(tmp_path / "store"), samples=100, cells=8, workers=1)
    monkeypatch.setattr("jobs.checking.workers.PATIENCE", 1e-6)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    began: list[Any] = []
    monkeypatch.setattr("jobs.checking.workers.get_context", lambda name: began.append(name) or get_context(name))
    assert findings(verify(str(tmp_path / "store"), samples=100, cells=8)) == findings(alone)
    assert began == ["spawn", "spawn"]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_pane_that_is_said_to_be_opaque_is_named(tmp_path: Path, workers: int) -> None:
    parts = [*room_parts(), box_part("pane", (3, 3, 1), (5, 3.1, 2), colour=(9, 9, 200, 80))]
    store = make_store(tmp_path / "store", parts, depth=1)
    pane = int(np.flatnonzero(store.drawables["see_through"])[0])
    mistold(store, [pane, pane + 1])
    report = verify(str(tmp_path / "store"), samples=0, workers=workers)
    assert (report.checksums.count, len(report.problems)) == (1, 1)
    assert f"drawable {pane} (and 1 more like it) is said to be one that cannot be seen through" in report.problems[0]


def test_what_lies_in_a_damaged_cell_shard_is_left_out_and_the_rest_is_checked(tmp_path: Path) -> None:
    store = make_store(tmp_path / "store", room_parts(), depth=3, cells_per_shard=128, visible=some)
    victim = damage(store, "cells", 1)
    report = verify(str(tmp_path / "store"), samples=0, cells=512)
    assert report.problems
    assert all(line.startswith(f"{tmp_path}/store/{victim} is damaged: frame ") for line in report.problems)
    assert report.unreadable == 128
    others = [*range(128), *range(256, 512)]
    assert [cell.cell for cell in verify(str(tmp_path / "store"), samples=1, cells=512).sampled] == others
    assert report.read_cells == len(others)


def test_cells_whose_geometry_is_damaged_are_named(tmp_path: Path) -> None:
    store = make_store(tmp_path / "store", room_parts(), depth=1)
    victim = damage(store, "geometry", 0)
    report = verify(str(tmp_path / "store"), samples=50, cells=8)
    assert report.problems[0].startswith(f"{tmp_path}/store/{victim} is damaged: frame ")
    assert report.read_cells == 8
    assert report.sets.count == 0
    assert any(
        f"no rays can be cast from cell 0: {tmp_path}/store/{victim} is damaged" in line for line in report.problems
    )


def test_a_store_whose_tables_are_damaged_still_has_its_shards_checked(tmp_path: Path) -> None:
    store = make_store(tmp_path / "store", room_parts(), depth=1)
    victims = [damage(store, purpose, 0) for purpose in ("tables", "cells")]
    report = verify(str(tmp_path / "store"), samples=50, cells=8)
    assert report.cells == 8
    assert report.read_cells == 0
    assert [line.split(" is damaged")[0] for line in report.problems] == [
        f"{tmp_path}/store/{victim}" for victim in victims
    ]


def test_a_missing_shard_is_named(tmp_path: Path) -> None:
    store = make_store(tmp_path / "store", room_parts(), depth=2, visible=some)
    victim = tmp_path / "store" / damage(store, "cells", 3)
    victim.unlink()
    report = verify(str(tmp_path / "store"), samples=0, cells=8)
    assert len(report.problems) == 1
    assert victim.name in report.problems[0]
    assert f"is missing; {CURE}" in report.problems[0]


def test_a_folder_in_a_shards_place_is_called_one(tmp_path: Path) -> None:
    store = make_store(tmp_path / "store", room_parts(), depth=2, visible=some)
    victim = tmp_path / "store" / damage(store, "cells", 3)
    victim.unlink()
    victim.mkdir()
    report = verify(str(tmp_path / "store"), samples=0, cells=8)
    assert report.problems == [f"{victim} is a folder and no file; {CURE}"]


@pytest.mark.parametrize(("computed", "sampled"), [(0, 10), (64, 10), (101, 11), (680, 68), (5000, 100)])
def test_a_tenth_of_the_cells_is_sampled_unless_told_otherwise(computed: int, sampled: int) -> None:
    assert cells_to_sample(computed) == sampled


def test_the_default_sample_is_what_is_looked_at(tmp_path: Path) -> None:
    make_store(tmp_path / "store", room_parts(), depth=2)
    report = verify(str(tmp_path / "store"), samples=10)
    assert (report.cells, len(report.sampled)) == (64, 10)


@pytest.mark.parametrize("purpose", ["tables", "geometry", "cell table", "cells"])
@pytest.mark.parametrize("workers", [1, 2])
def test_a_shard_that_cannot_be_read_is_a_problem_and_the_rest_is_checked(
    tmp_path: Path, purpose: str, workers: int
) -> None:
    store = make_store(tmp_path / "store", room_parts(), depth=2, cells_per_shard=16, visible=some)
    records = [record for what, record in store.manifest.shards() if what == purpose]
    victim = tmp_path / "store" / shard_path(records[0].name)
    victim.unlink()
    victim.symlink_to(victim.name)  # no rights keep the administrator out, but nobody reads a link to itself
    damaged = damage(store, "cells", 2)
    report = verify(str(tmp_path / "store"), samples=50, cells=64, workers=workers)
    assert sum(line.startswith(f"{victim} cannot be read: ") for line in report.problems) == 1
    assert any(line.startswith(f"{tmp_path}/store/{damaged} is damaged") for line in report.problems)
    assert len(report.sampled) == (32 if purpose == "cells" else 0)
    assert (report.read_cells > 0) == (purpose in ("geometry", "cells"))


def test_what_cannot_be_read_for_a_moment_is_a_problem_of_that_cell_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_store(tmp_path / "store", room_parts(), depth=1)
    whole = verify(str(tmp_path / "store"), samples=50, cells=8)
    real = Store.vlod
    asked: list[int] = []

    def vlod(store: Store, cell: int) -> np.ndarray:
        asked.append(cell)
        if cell == 3 and asked.count(3) == 1:
            raise StoreUnreachableError("nobody answers")
        return real(store, cell)

    monkeypatch.setattr(Store, "vlod", vlod)
    report = verify(str(tmp_path / "store"), samples=50, cells=8, workers=1)
    assert asked.count(3) > 1
    assert report.problems == ["nobody answers"]
    assert report.read_cells == whole.read_cells - 1 == 7
    assert [cell.cell for cell in report.sampled] == list(range(8))


def test_one_problem_is_one(tmp_path: Path) -> None:
    class Heard(Silent):
        said: ClassVar[list[str]] = []

        def finish(self, note: str) -> None:
            self.said.append(note)

    damage(make_store(tmp_path / "store", room_parts(), depth=1), "cells", 0)
    verify(str(tmp_path / "store"), samples=0, progress=Heard())
    assert Heard.said[0].endswith(" MB, 1 problem")


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("too few", "its vLOD is not of the size"),
        ("beside its cut", "holds what is not in its cut"),
        ("backwards", "does not hold increasing drawables"),
        ("beyond the last", "does not hold increasing drawables"),
    ],
)
def test_a_set_that_does_not_fit_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str, what: str
) -> None:
    make_store(tmp_path / "store", room_parts(), depth=1)
    assert verify(str(tmp_path / "store"), samples=0, cells=0).ok
    real = Store.vlod

    def vlod(store: Store, cell: int) -> np.ndarray:
        ids = real(store, cell)
        if cell != 5:
            return ids
        if change == "too few":
            return ids[1:]
        if change == "backwards":
            return ids[::-1]
        if change == "beyond the last":
            return np.append(ids, len(store.drawables))
        return np.sort(np.append(ids, np.setdiff1d(np.arange(len(store.drawables)), ids)[0]))

    monkeypatch.setattr(Store, "vlod", vlod)
    report = verify(str(tmp_path / "store"), samples=0, cells=0, workers=1)
    assert report.read_cells == 8
    assert report.sets.count == len(report.problems) == 1
    assert report.problems[0].startswith("cell 5: ")
    assert what in report.problems[0]


def test_problems_beyond_the_first_of_a_kind_are_counted() -> None:
    found, others = Problems(), Problems()
    found.note(f"fault {number}" for number in range(15))
    others.note(f"other {number}" for number in range(30))
    found.join(others)
    assert (len(found.spelled), found.more, found.count) == (MOST_SPELLED, 25, 45)
    assert found.spelled[14:16] == ["fault 14", "other 0"]


def test_progress_hears_of_every_part(tmp_path: Path) -> None:
    class Heard(Silent):
        def __init__(self) -> None:
            self.said: list[str] = []
            self.last = (0, 0)

        def start(self, step: str) -> None:
            self.said.append(step)

        def update(self, done: int, total: int, before: int = 0) -> None:
            self.last = (done, total)

        def finish(self, note: str) -> None:
            self.said[-1] += f": {note}, {self.last[0]} of {self.last[1]}"

    store = make_store(tmp_path / "store", room_parts(), depth=1)
    size = sum(record.bytes for _, record in store.manifest.shards())
    heard = Heard()
    verify(str(tmp_path / "store"), samples=100, cells=3, progress=heard)
    assert heard.said == [
        f"checksums: 4 shards, {size / 1e6:.1f} MB, 4 of 4",
        "sets: 8 cells, 8 of 8",
        "detail: 3 cells, 3 of 3",
        "rays: 300 rays, 3 of 3",
    ]
