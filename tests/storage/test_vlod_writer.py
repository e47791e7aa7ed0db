from pathlib import Path

import numpy as np
import pytest

from storage.cells.codecs import CODECS
from storage.cells.octree import Octree
from storage.known_cells import KnownCells
from storage.model.tables import CELL
from storage.shards.sections import CellCounts
from storage.store import Store, open_store
from storage.vlod_writer import GROUP_DECISIONS, cells_section, write_cell_shard
from tests.storage.tiny_store import make_store, room_parts


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return make_store(tmp_path_factory.mktemp("store"), room_parts())


@pytest.fixture(scope="module")
def known(store: Store) -> KnownCells:
    return KnownCells(store.nodes, store.drawables, store.manifest.pixel_angle)


def test_a_section_counts_its_cells(store: Store, known: KnownCells, tmp_path: Path) -> None:
    rows = store.cells[:3].copy()
    rows["computed"][1], rows["drawables"][1] = False, 0
    sets = [store.vlod(0), np.zeros(0, np.int64), store.vlod(2)]
    shard = write_cell_shard(tmp_path, rows, sets, known)
    assert cells_section(tmp_path, Octree((0, 0, 0), 1), [shard]).counts == CellCounts(3, 2)
    assert shard.groups["cells"].sum() == shard.record.cells == 3


def test_sets_that_do_not_fit_are_refused(store: Store, known: KnownCells, tmp_path: Path) -> None:
    rows, ids = store.cells[:1].copy(), store.vlod(0)
    with pytest.raises(ValueError, match="1 cells but 2 sets"):
        write_cell_shard(tmp_path, rows, [ids, ids], known)
    with pytest.raises(ValueError, match=f"its set must hold {len(ids)} increasing ids, and holds {len(ids) - 1}"):
        write_cell_shard(tmp_path, rows, [ids[1:]], known)
    with pytest.raises(ValueError, match="increasing"):
        write_cell_shard(tmp_path, rows, [ids[::-1]], known)
    beside = np.setdiff1d(np.arange(len(store.drawables)), store.cut(0))[:1]
    rows["drawables"] = 1
    with pytest.raises(ValueError, match="not in its cut"):
        write_cell_shard(tmp_path, rows, [beside], known)


def test_overlapping_cells_are_refused(store: Store, known: KnownCells, tmp_path: Path) -> None:
    shards = 2 * [write_cell_shard(tmp_path, store.cells[:1], [store.vlod(0)], known)]
    with pytest.raises(ValueError, match="overlap"):
        cells_section(tmp_path, Octree((0, 0, 0), 1), shards)


def test_groups_are_closed_by_what_their_cells_cost(
    store: Store, known: KnownCells, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sets = [store.vlod(cell) for cell in range(64)]
    one = write_cell_shard(tmp_path, store.cells, sets, known)
    assert one.groups["cells"].tolist() == [64]  # of a room, far below GROUP_DECISIONS
    monkeypatch.setattr("storage.vlod_writer.GROUP_DECISIONS", GROUP_DECISIONS // 500)
    several = write_cell_shard(tmp_path, store.cells, sets, known)
    assert several.groups["cells"].sum() == 64
    assert 4 < len(several.groups) < 64
    monkeypatch.setattr("storage.vlod_writer.GROUP_DECISIONS", 0)
    assert (write_cell_shard(tmp_path, store.cells, sets, known).groups["cells"] == 1).all()


@pytest.mark.parametrize("codec", CODECS)
def test_every_codec_gives_the_sets_again_whatever_the_groups(
    codec: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def some(geometry: object, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        return cut[np.random.default_rng(int(cell["key"])).random(len(cut)) < 0.6]

    for decisions in (0, 100, GROUP_DECISIONS):
        monkeypatch.setattr("storage.vlod_writer.GROUP_DECISIONS", decisions)
        folder = tmp_path / str(decisions)
        made = make_store(folder, room_parts(), visible=some, codecs=[codec], uncomputed=[0, 5, 6, 63])
        again = open_store(folder)
        for cell in np.flatnonzero(made.cells["computed"]).tolist():
            assert np.array_equal(again.vlod(cell), some(None, again.cells[cell], again.cut(cell)))
        assert list(again.check()) == []


def test_no_cells_at_all(known: KnownCells, tmp_path: Path) -> None:
    section = cells_section(tmp_path, Octree((0, 0, 0), 1), [write_cell_shard(tmp_path, np.zeros(0, CELL), [], known)])
    assert section.counts == CellCounts(0, 0)
