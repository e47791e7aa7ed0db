"""Stand-ins: the next coarser level that is there, else the next finer, else nothing."""

from __future__ import annotations

import numpy as np
import pytest

from player.loading.stand_ins import stand_ins
from player.shown_model import ShownModel


def _table(model: ShownModel) -> int:
    """First drawable of a node with three levels."""
    return int(model.first_drawable[np.flatnonzero(model.levels == 3)[0]])


@pytest.mark.parametrize(
    ("wanted", "there", "drawn"), [(0, {1, 2}, 1), (0, {2}, 2), (2, {0, 1}, 1), (1, {0, 2}, 2), (1, {0}, 0)]
)
def test_the_nearest_level_stands_in(model: ShownModel, wanted: int, there: set[int], drawn: int) -> None:
    first = _table(model)
    ready = np.ones(len(model.store.drawables), np.bool_)
    ready[first : first + 3] = [level in there for level in range(3)]
    other = first + 3 if first + 3 < len(ready) else 0
    found = stand_ins(np.sort([first + wanted, other]), model, lambda ids: ready[ids])
    assert found.drawables.tolist() == sorted([first + drawn, other])
    assert (found.replaced, found.absent) == (1, 0)


def test_nothing_is_drawn_of_what_has_not_arrived(model: ShownModel) -> None:
    found = stand_ins(np.sort(model.first_drawable), model, lambda ids: np.zeros(len(ids), np.bool_))
    assert (len(found.drawables), found.replaced, found.absent) == (0, 0, len(model.levels))


def test_what_is_there_is_drawn_as_chosen(model: ShownModel) -> None:
    ids = np.sort(model.first_drawable)
    assert stand_ins(ids, model, lambda wanted: np.ones(len(wanted), np.bool_)).drawables is ids
