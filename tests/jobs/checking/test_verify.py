"""Verify: sound stores pass, and a store that leaves out what can be seen is caught."""

from __future__ import annotations

from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jobs.checking.verify import verify
from jobs.running.errors import WorkerLostError
from storage.geometry_reader import Geometry
from storage.meshes.facets import find_turned_away
from storage.shards.manifest import commit
from tests.storage.tiny_store import make_store, room_parts


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


def test_the_findings_do_not_depend_on_the_number_of_workers(tmp_path: Path) -> None:
    def visible(_geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        return cut[: len(cut) // 2] if int(cell["key"]) % 3 == 0 else cut

    make_store(tmp_path / "store", room_parts(), depth=1, visible=visible)
    alone, shared = (verify(str(tmp_path / "store"), samples=100, cells=8, workers=count) for count in (1, 2))
    assert alone.missed > 0
    assert alone.problems == shared.problems
    for one, other in zip(alone.sampled, shared.sampled, strict=True):
        assert replace(one, seconds=0) == replace(other, seconds=0)


def test_a_worker_that_dies_is_one_clear_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def __init__(self, *_: object) -> None: ...

        def map(self, *_: object, **__: object) -> None:
            raise BrokenProcessPool

        def shutdown(self, **_: object) -> None: ...

    make_store(tmp_path / "store", room_parts(), depth=1)
    monkeypatch.setattr("jobs.checking.verify.ProcessPoolExecutor", Broken)
    with pytest.raises(WorkerLostError, match="use fewer --workers"):
        verify(str(tmp_path / "store"), samples=10, cells=4, workers=2)
