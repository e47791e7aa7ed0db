"""Stand-ins: the next coarser level that is there, else the next finer, else nothing."""

from __future__ import annotations

import numpy as np
import pytest

from player.loading.stand_ins import stand_ins
from player.scene import Scene


def _table(scene: Scene) -> int:
    """First drawable of a node with three levels."""
    return int(scene.first_drawable[np.flatnonzero(scene.levels == 3)[0]])


@pytest.mark.parametrize(
    ("wanted", "there", "drawn"), [(0, {1, 2}, 1), (0, {2}, 2), (2, {0, 1}, 1), (1, {0, 2}, 2), (1, {0}, 0)]
)
def test_the_nearest_level_stands_in(scene: Scene, wanted: int, there: set[int], drawn: int) -> None:
    first = _table(scene)
    ready = np.ones(len(scene.node_of), np.bool_)
    ready[first : first + 3] = [level in there for level in range(3)]
    other = first + 3 if first + 3 < len(ready) else 0
    found = stand_ins(np.sort([first + wanted, other]), scene, lambda ids: ready[ids])
    assert found.drawables.tolist() == sorted([first + drawn, other])
    assert (found.replaced, found.absent) == (1, 0)


def test_nothing_is_drawn_of_what_has_not_arrived(scene: Scene) -> None:
    found = stand_ins(np.sort(scene.first_drawable), scene, lambda ids: np.zeros(len(ids), np.bool_))
    assert (len(found.drawables), found.replaced, found.absent) == (0, 0, len(scene.levels))


def test_what_is_there_is_drawn_as_chosen(scene: Scene) -> None:
    ids = np.sort(scene.first_drawable)
    assert stand_ins(ids, scene, lambda wanted: np.ones(len(wanted), np.bool_)).drawables is ids
