"""The oracle for a cell of a store: in portions it is what it is as a whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jobs.checking.cut_oracle import CutOracle
from jobs.checking.oracle import examine, surface_points
from jobs.checking.verify import verify
from jobs.checking.workers import Place
from storage.store import Geometry, Store
from tests.storage.tiny_store import make_store, room_parts


def half(_geometry: Geometry, _cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
    return cut[::2]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return make_store(tmp_path_factory.mktemp("oracle") / "store", room_parts(), depth=2, visible=half)


@pytest.fixture(scope="module")
def glazed(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """The room, its west wall and its table of glass."""
    parts = [
        replace(part, colour=(*part.colour[:3], 100)) if part.name in {"wall west", "table"} else part
        for part in room_parts()
    ]
    return make_store(tmp_path_factory.mktemp("oracle") / "glazed", parts, depth=2, visible=half)


def place_of(store: Store) -> Place:
    return Place(store.files.url, store.manifest, store)


def test_its_things_are_what_is_drawn_and_what_is_not(store: Store) -> None:
    for cell in (0, 21, 63):
        oracle, row = CutOracle(place_of(store), cell), store.cells[cell]
        counts = dict(zip(oracle.things.tolist(), np.diff(oracle.starts).tolist(), strict=True))
        vlod = set(store.vlod(cell).tolist())
        for drawable in store.cut(cell).tolist():
            away = int(store.turned_away(drawable, row["lo"], row["hi"]).sum()) if drawable in vlod else 0
            assert counts.get(2 * drawable + 1, 0) == away
            assert counts.get(2 * drawable, 0) == store.drawables["triangles"][drawable] - away
        assert oracle.reported.tolist() == [2 * drawable for drawable in sorted(vlod)]


@pytest.mark.parametrize("held", [0, 2000, 1 << 20])
@pytest.mark.parametrize("room", ["store", "glazed"])
def test_portions_see_what_the_whole_sees(
    request: pytest.FixtureRequest, room: str, monkeypatch: pytest.MonkeyPatch, held: int
) -> None:
    store: Store = request.getfixturevalue(room)
    for cell in (0, 42):
        lo, hi = store.cells["lo"][cell], store.cells["hi"][cell]
        whole = CutOracle(place_of(store), cell)
        with monkeypatch.context() as patched:
            patched.setattr("jobs.checking.cut_oracle.PORTION", 150)
            patched.setattr("jobs.checking.cut_oracle.HELD", held)
            parted = CutOracle(place_of(store), cell)
            rng = np.random.default_rng(cell)
            origins = surface_points(lo, hi, 2000, rng)
            directions = rng.normal(size=(2000, 3)).astype(np.float32)
            for _ in range(2):
                found, distance = parted.cast(origins, directions)
                expected, along = whole.cast(origins, directions)
                np.testing.assert_array_equal(distance, along)
                np.testing.assert_array_equal(found < 0, expected < 0)
                assert (found == expected).mean() > 0.95  # of coincident faces either may be met
                some, others = (
                    set(zip(*(hits.tolist() for hits in o.passed(origins, directions, along)), strict=True))
                    for o in (parted, whole)
                )
                assert len(some ^ others) <= 0.01 * len(others)  # nor are rays that pass an edge told alike
                assert bool(others) == (room == "glazed")
                np.testing.assert_array_equal(parted.see_through, whole.see_through)
            numbers = rng.integers(0, whole.starts[-1], 500)
            np.testing.assert_array_equal(parted.corners(numbers), whole.corners(numbers))
            hits = np.flatnonzero(expected >= 0)[:200]
            confirmed = parted.confirmed(origins[hits], directions[hits], expected[hits])
            np.testing.assert_array_equal(confirmed, whole.confirmed(origins[hits], directions[hits], expected[hits]))
            assert not np.isnan(confirmed).all()
            both = [examine(o, lo, hi, o.reported, 900, np.random.default_rng(1)) for o in (parted, whole)]
        missed = [{sight.drawable for sight in found.missed} for found in both]
        assert missed[0] == missed[1] != set()


def test_only_so_many_triangles_are_held(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jobs.checking.cut_oracle.PORTION", 150)
    built: list[int] = []
    placed = CutOracle._placed

    def noting(self: CutOracle, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        triangles, owner = placed(self, ids)
        built.append(len(triangles))
        return triangles, owner

    monkeypatch.setattr(CutOracle, "_placed", noting)
    origins, directions = np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32)
    rounds = []
    for held in (1 << 20, 2000, 0):
        monkeypatch.setattr("jobs.checking.cut_oracle.HELD", held)
        oracle = CutOracle(place_of(store), 0)
        for _ in range(2):
            built.clear()
            oracle.cast(origins, directions)
            rounds.append(sum(built))
    total = int(CutOracle(place_of(store), 0).starts[-1])
    assert rounds[0] == rounds[2] == rounds[4] == rounds[5] == total
    assert rounds[1] == 0
    assert total - 2000 <= rounds[3] < total
    assert max(built) < 150 + store.drawables["triangles"].max()


def test_a_store_is_verified_in_portions_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_store(tmp_path / "store", room_parts(), depth=1)
    monkeypatch.setattr("jobs.checking.cut_oracle.PORTION", 100)
    monkeypatch.setattr("jobs.checking.cut_oracle.HELD", 0)
    report = verify(str(tmp_path / "store"), samples=300, cells=4, workers=1)
    assert report.problems == []
    assert report.rays == 1200
