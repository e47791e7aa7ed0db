"""Which triangles of a cell's vLOD are not drawn: the very same as the store says of each drawable."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jobs.checking.turned import TurnedTriangles
from tests.storage.tiny_store import make_store, room_parts


def test_it_is_what_the_store_says_of_each_drawable(tmp_path: Path) -> None:
    store = make_store(tmp_path / "store", room_parts(), depth=2, visible=lambda _, cell, cut: cut[cell["key"] % 3 :])
    turned = TurnedTriangles(store)
    some = 0
    for cell in range(0, len(store.cells), 5):
        row, vlod = store.cells[cell], store.vlod(cell)
        found = turned.of(vlod, row["lo"], row["hi"])
        each = [store.turned_away(drawable, row["lo"], row["hi"]) for drawable in vlod.tolist()]
        np.testing.assert_array_equal(found, np.concatenate(each))
        assert found.sum() == row["turned_triangles"]
        some += int(found.sum())
    assert some > 0


def test_nothing_is_turned_away_of_nothing(tmp_path: Path) -> None:
    store = make_store(tmp_path / "store", room_parts(), depth=1)
    assert len(TurnedTriangles(store).of(np.zeros(0, np.int64), np.zeros(3), np.ones(3))) == 0
