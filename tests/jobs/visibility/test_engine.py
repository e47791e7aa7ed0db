"""The engine as a whole: what must be hidden is, what can be seen never is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from jobs.checking.oracle import examine
from jobs.visibility.engine import CellVisibility, Engine
from jobs.visibility.settings import EngineSettings
from jobs.visibility.surfaces.soup import Soup
from tests.jobs.visibility.scenes import Mesh, box, oracle_of, rooms, sheet, soup_of

QUICK = EngineSettings(resolution=64, proof_resolution=32)


def look(soup: Soup, lo: list[float], hi: list[float], quality: EngineSettings = QUICK) -> CellVisibility:
    return see(Engine(soup, quality), np.array(lo, float), np.array(hi, float), soup.drawables)


def see(engine: Engine, lo: np.ndarray, hi: np.ndarray, cut: np.ndarray) -> CellVisibility:
    """The engine's answer where it is not allowed to give up."""
    found = engine.visible_from(lo, hi, cut)
    assert found is not None
    return found


def accuse(soup: Soup, lo: np.ndarray, hi: np.ndarray, visible: np.ndarray, rays: int, seed: int) -> list[object]:
    """Drawables that rays from the cell see although they are not reported."""
    found = examine(oracle_of(soup), lo, hi, visible, rays, np.random.default_rng(seed))
    return list(found.missed)


def test_a_wall_hides_what_is_behind_it() -> None:
    soup = soup_of([sheet((1000, -4000, -4000), (1000, 4000, 4000), 1), box((2000, -100, -100), (2100, 100, 100))])
    found = look(soup, [-50, -50, -50], [50, 50, 50])
    assert found.visible.tolist() == [0]
    assert found.proven.tolist() == [0]


@pytest.mark.parametrize("cells", [2, 7, 40])
def test_a_tessellated_wall_hides_as_well_as_a_whole_one(cells: int) -> None:
    soup = soup_of([sheet((1000, -4000, -4000), (1000, 4000, 4000), cells), box((2000, -90, -90), (2100, 90, 90))])
    assert look(soup, [-50, -50, -50], [50, 50, 50]).visible.tolist() == [0]


def test_two_drawables_that_share_an_edge_hide_together() -> None:
    left = sheet((1000, -4000, -4000), (1000, 0, 4000), 4)
    right = sheet((1000, 0, -4000), (1000, 4000, 4000), 4)
    soup = soup_of([left, right, box((2000, -90, -90), (2100, 90, 90))])
    assert look(soup, [-50, -50, -50], [50, 50, 50]).visible.tolist() == [0, 1]


def test_a_gap_of_one_grid_unit_hides_nothing_at_the_gap() -> None:
    left = sheet((1000, -4000, -4000), (1000, 0, 4000), 4)
    right = sheet((1000, 1, -4000), (1000, 4000, 4000), 4)
    soup = soup_of([left, right, box((2000, -90, -90), (2100, 90, 90))])
    assert look(soup, [-50, -50, -50], [50, 50, 50]).visible.tolist() == [0, 1, 2]


def test_what_peeps_over_the_wall_from_a_corner_of_the_cell_is_visible() -> None:
    # from the cell's middle the thing is hidden, from its upper corners it is not
    wall = sheet((1000, -4000, -4000), (1000, 4000, 100), 4)
    thing = box((2000, -50, 110), (2100, 50, 130))
    soup = soup_of([wall, thing])
    assert look(soup, [-50, -50, -5], [50, 50, 5], EngineSettings()).visible.tolist() == [0]
    assert look(soup, [-50, -50, -5], [50, 50, 80], EngineSettings()).visible.tolist() == [0, 1]


def test_what_touches_the_cell_is_visible() -> None:
    soup = soup_of([box((40, 40, 40), (60, 60, 60)), box((50, -9, -9), (70, 9, 9)), box((1000, 0, 0), (1010, 9, 9))])
    assert look(soup, [-50, -50, -50], [50, 50, 50]).visible.tolist() == [0, 1, 2]


def test_backs_of_one_sided_drawables_are_culled_and_hide_nothing() -> None:
    # a sheet whose back is turned to the cell, and a thing behind it
    positions, triangles = sheet((1000, -4000, -4000), (1000, 4000, 4000), 3)
    thing = box((2000, -90, -90), (2100, 90, 90))
    seen = []
    for wound in (triangles, triangles[:, ::-1]):
        soup = soup_of([(positions, wound), thing], one_sided=True)
        seen.append(look(soup, [-50, -50, -50], [50, 50, 50]).visible.tolist())
    assert sorted(seen) == [[0], [1]]


def test_an_empty_cut_and_a_drawable_without_triangles() -> None:
    empty: Mesh = (np.zeros((0, 3), np.int32), np.zeros((0, 3), np.int64))
    soup = soup_of([empty, box((100, 0, 0), (110, 10, 10))])
    assert look(soup, [-5, -5, -5], [5, 5, 5]).visible.tolist() == [1]
    engine = Engine(soup, QUICK)
    assert see(engine, np.full(3, -5.0), np.full(3, 5.0), np.zeros(0, np.int64)).visible.tolist() == []


def test_only_the_cut_counts() -> None:
    soup = soup_of([sheet((1000, -4000, -4000), (1000, 4000, 4000), 2), box((2000, -90, -90), (2100, 90, 90))])
    engine = Engine(soup, QUICK)
    lo, hi = np.full(3, -50.0), np.full(3, 50.0)
    assert see(engine, lo, hi, np.array([1])).visible.tolist() == [1]
    assert see(engine, lo, hi, np.array([0, 1])).visible.tolist() == [0]
    with pytest.raises(ValueError, match="does not hold"):
        engine.visible_from(lo, hi, np.array([0, 7]))


def test_it_gives_up_where_the_cell_will_be_split_anyway() -> None:
    soup = soup_of([box((100 * k, 200, 0), (100 * k + 50, 250, 50)) for k in range(10)])
    engine = Engine(soup, QUICK)
    lo, hi = np.full(3, -50.0), np.full(3, 50.0)
    assert engine.visible_from(lo, hi, soup.drawables, 40) is None
    assert engine.visible_from(lo, hi, soup.drawables, 120) is not None


def test_a_limit_only_decides_whether_there_is_an_answer() -> None:
    # with so few pixels it is left to shafts to hide most of what is behind the walls
    coarse = EngineSettings(resolution=16, layers=1, proof_resolution=32)
    engine = Engine(soup_of(rooms(np.random.default_rng(3), 4)), coarse)
    soup, lo, hi = engine.soup, np.full(3, 1900.0), np.full(3, 2100.0)
    whole = see(engine, lo, hi, soup.drawables)
    count = int(soup.triangle_counts[soup.places(whole.visible)].sum())
    for most in range(count - 12, count + 12):
        found = engine.visible_from(lo, hi, soup.drawables, most)
        assert (found is None) == (most < count)
        if found is not None:
            assert found.visible.tolist() == whole.visible.tolist()
            assert found.proven.tolist() == whole.proven.tolist()


def test_the_same_cell_twice_gives_the_same_answer() -> None:
    soup = soup_of(rooms(np.random.default_rng(3), 3))
    lo, hi = np.array([5000.0, 5000, 1000]), np.array([5500.0, 5500, 1500])
    engine = Engine(soup, QUICK)
    first = see(engine, lo, hi, soup.drawables)
    engine.visible_from(lo + 3000, hi + 3000, soup.drawables)
    second = see(engine, lo, hi, soup.drawables)
    assert np.array_equal(first.visible, second.visible)
    assert np.array_equal(first.proven, second.proven)


def test_rooms_hide_other_rooms() -> None:
    soup = soup_of(rooms(np.random.default_rng(1), 5))
    lo, hi = np.array([9800.0, 9800, 1400]), np.array([10000.0, 10000, 1600])
    found = look(soup, list(lo), list(hi), EngineSettings())
    assert set(found.proven) <= set(found.visible)
    assert len(found.visible) < 0.6 * len(soup.drawables)
    assert accuse(soup, lo, hi, found.visible, 30_000, 1) == []


def test_kernels_run_without_compilation() -> None:
    """The same code in plain Python sees the same, in a scene small enough for it."""
    program = """
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from jobs.visibility.engine import Engine
from jobs.visibility.settings import EngineSettings
from tests.jobs.visibility.nasty import nasty_scene
from tests.jobs.visibility.scenes import soup_of
for number in range(6):
    attack = nasty_scene(np.random.default_rng([5, number]))
    soup = soup_of(attack.meshes[:6], see_through=attack.see_through)
    settings = EngineSettings(resolution=16, proof_resolution=8, smallest_window=1)
    found = Engine(soup, settings).visible_from(attack.lo, attack.hi, soup.drawables)
    print(found.visible.tolist(), found.proven.tolist())
"""
    root = str(Path(__file__).parents[3])
    outputs = [
        subprocess.run(
            [sys.executable, "-W", "error", "-c", program],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "NUMBA_DISABLE_JIT": disabled, "PYTHONPATH": root},
            cwd=root,
        ).stdout
        for disabled in ("0", "1")
    ]
    assert outputs[0] == outputs[1]
    assert len(outputs[0].splitlines()) == 6
