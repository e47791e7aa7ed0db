"""What can be seen through hides nothing, before, behind and between whatever else there is, and is hidden itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jobs.checking.oracle import examine
from jobs.visibility.engine import CellVisibility, Engine
from jobs.visibility.settings import QUALITIES, EngineSettings
from jobs.visibility.surfaces.soup import Soup
from tests.jobs.visibility.scenes import Mesh, box, oracle_of, rooms, sheet, soup_of

#: Every way to find what is hidden.
WAYS = {
    "images": EngineSettings(resolution=64, proof_resolution=32, smallest_window=1, shafts=0),
    "images and shafts": EngineSettings(resolution=64, proof_resolution=32),
    "shafts": EngineSettings(resolution=16, proof_resolution=8, smallest_window=1 << 30, least_worth=0),
    "high": QUALITIES["high"],
    "shrunk-occluders": EngineSettings(method="shrunk-occluders", resolution=64, proof_resolution=32),
    "seal": EngineSettings(resolution=64, proof_resolution=32, smallest_window=1, seal=3.0),
    "sampled": EngineSettings(sampled=True),
}
LO, HI = np.full(3, -50.0), np.full(3, 50.0)
SHEETS = [1, 7]


def wall(at: int, reach: int = 4000, cells: int = 1) -> Mesh:
    """A square at right angles to the x axis."""
    return sheet((at, -reach, -reach), (at, reach, reach), cells)


def thing(at: int) -> Mesh:
    return box((at, -90, -90), (at + 100, 90, 90))


def look(soup: Soup, way: str, lo: np.ndarray = LO, hi: np.ndarray = HI) -> CellVisibility:
    """What a cell reports, which holds all that rays see; what it says is proven is seen."""
    settings = WAYS[way]
    found = Engine(soup, settings).visible_from(lo, hi, soup.drawables)
    assert found is not None
    looked = examine(oracle_of(soup), lo, hi, found.visible, 4000, np.random.default_rng(1))
    if not settings.sampled:
        assert looked.missed == []
    assert set(found.proven) <= set(found.visible)
    return found


@pytest.mark.parametrize("cells", SHEETS)
@pytest.mark.parametrize("way", WAYS)
def test_what_is_behind_glass_is_seen_and_proven_and_what_is_behind_a_wall_is_not(way: str, cells: int) -> None:
    meshes = [wall(1000, cells=cells), thing(2000), wall(3000), thing(4000)]
    seal = WAYS[way].seal
    assert look(soup_of(meshes, seal=seal), way).visible.tolist() == [0]
    found = look(soup_of(meshes, seal=seal, see_through=[0]), way)
    assert found.visible.tolist() == [0, 1, 2]
    assert found.proven.tolist() == [0, 1, 2]


@pytest.mark.parametrize("way", WAYS)
def test_a_pane_before_a_pane_hides_neither_it_nor_what_is_behind_both_and_a_wall_hides_panes(way: str) -> None:
    meshes = [wall(500), wall(1000, cells=3), wall(1001), thing(2000), wall(3000), wall(4000), wall(5000)]
    found = look(soup_of(meshes, seal=WAYS[way].seal, see_through=[0, 1, 2, 5]), way)
    assert found.visible.tolist() == [0, 1, 2, 3, 4]
    assert found.proven.tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("way", WAYS)
def test_a_closed_glass_box_shows_what_is_in_it_and_a_closed_box_does_not(way: str) -> None:
    case, showpiece, behind = box((900, -300, -300), (1500, 300, 300)), thing(1100), thing(1600)
    meshes = [case, showpiece, behind]
    seal = WAYS[way].seal
    assert look(soup_of(meshes, seal=seal), way).visible.tolist() == [0]
    assert look(soup_of(meshes, seal=seal, see_through=[0]), way).visible.tolist() == [0, 1]  # behind the showpiece
    assert look(soup_of(meshes, seal=seal, see_through=[0, 1]), way).visible.tolist() == [0, 1, 2]


@pytest.mark.parametrize("way", WAYS)
def test_a_glass_box_around_the_cell_hides_nothing(way: str) -> None:
    meshes = [box((-200, -200, -200), (200, 200, 200)), box((-150, -150, -150), (250, 250, 250)), thing(1000)]
    found = look(soup_of(meshes, seal=WAYS[way].seal, see_through=[0, 1]), way)
    assert found.visible.tolist() == [0, 1, 2]


@pytest.mark.parametrize("cells", SHEETS)
@pytest.mark.parametrize("way", WAYS)
def test_a_pane_closes_no_hole_in_a_wall_whose_edges_it_shares(way: str, cells: int) -> None:
    """A window: its frame's edges, each shared with the pane alone, are edges that somebody can look past."""
    frame = [
        sheet((1000, -4000, -4000), (1000, 4000, -200), 1), sheet((1000, -4000, 200), (1000, 4000, 4000), 1),
        sheet((1000, -4000, -200), (1000, -200, 200), 1), sheet((1000, 200, -200), (1000, 4000, 200), 1),
    ]  # fmt: skip
    window = sheet((1000, -200, -200), (1000, 200, 200), cells)
    meshes = [*frame, window, thing(2000), box((2000, 2000, 0), (2100, 2100, 100))]
    seal = WAYS[way].seal
    found = look(soup_of(meshes, seal=seal, see_through=[4]), way)
    assert set(found.visible) >= {0, 1, 2, 3, 4, 5}
    if not WAYS[way].method.startswith("shrunk"):  # each plate of the frame is larger than the cell, but not by far
        assert found.visible.tolist() == [0, 1, 2, 3, 4, 5]
    assert set(look(soup_of(meshes, seal=seal), way).visible) <= {0, 1, 2, 3, 4, 6}


@pytest.mark.parametrize("way", WAYS)
def test_behind_a_grating_all_is_seen_as_far_as_the_next_wall(way: str) -> None:
    """A grating as textures with holes make them: one sheet, which can be seen through as a whole."""
    grating, bars = wall(1000, cells=9), [box((1500, y, -4000), (1520, y + 20, 4000)) for y in range(-4000, 4000, 400)]
    meshes = [grating, thing(2000), wall(3000), thing(3500), *bars]
    found = look(soup_of(meshes, seal=WAYS[way].seal, see_through=[0]), way)
    assert {0, 1, 2} <= set(found.visible)
    assert 3 not in found.visible


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("way", WAYS)
def test_a_sheet_that_crosses_the_cell_is_seen_and_hides_nothing(way: str, axis: int) -> None:
    lo, hi = [-4000] * 3, [4000] * 3
    lo[axis] = hi[axis] = 10
    inside = [-40] * 3, [40] * 3
    inside[0][axis] = inside[1][axis] = -20
    meshes = [
        sheet((lo[0], lo[1], lo[2]), (hi[0], hi[1], hi[2]), 2),
        sheet((inside[0][0], inside[0][1], inside[0][2]), (inside[1][0], inside[1][1], inside[1][2]), 1),
        thing(1000), wall(2000), thing(3000),
    ]  # fmt: skip
    found = look(soup_of(meshes, seal=WAYS[way].seal, see_through=[0, 1]), way)
    assert found.visible.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("way", WAYS)
def test_of_a_wall_and_a_pane_in_the_same_place_the_wall_hides_and_both_may_be_drawn(way: str) -> None:
    for meshes in ([wall(1000), wall(1000), thing(2000)], [wall(1000), wall(1000, cells=3), thing(2000)]):
        for pane in (0, 1):
            found = look(soup_of(meshes, seal=WAYS[way].seal, see_through=[pane]), way)
            assert 2 not in found.visible
            assert 1 - pane in found.visible
            if not WAYS[way].sampled:
                assert pane in found.visible
        assert look(soup_of(meshes, seal=WAYS[way].seal, see_through=[0, 1]), way).visible.tolist() == [0, 1, 2]


@pytest.mark.parametrize("way", WAYS)
def test_a_slanted_pane_whose_box_holds_the_cell_is_hidden_by_a_wall_before_it(way: str) -> None:
    """A glass roof outside: it does not meet the cell, though its box does."""
    roof = np.array([[3000, -3000, -9000], [3000, -3000, 9000], [-3000, 9000, 0]], np.int32), np.array([[0, 1, 2]])
    found = look(soup_of([box((-200, -200, -200), (200, 200, 200)), roof], seal=WAYS[way].seal, see_through=[1]), way)
    assert found.visible.tolist() == ([0, 1] if way == "shrunk-occluders" else [0])  # which looks at boxes there


def test_rooms_with_panes_are_as_tight_as_without() -> None:
    """A pane in each room changes nothing of what else is seen."""
    meshes = rooms(np.random.default_rng(1), 4)
    lo, hi = np.array([6000.0, 6100, 1500]), np.array([6300.0, 6400, 1800])
    settings = EngineSettings(resolution=64)
    without = Engine(soup_of(meshes), settings).visible_from(lo, hi, np.arange(len(meshes)))
    places = [(x, y) for x in range(1000, 16_000, 4000) for y in range(500, 16_000, 4000)]
    panes = [sheet((x, y, 100), (x, y + 1500, 3000), 3) for x, y in places]
    with_panes = Engine(
        soup_of(meshes + panes, see_through=range(len(meshes), len(meshes) + len(panes))), settings
    ).visible_from(lo, hi, np.arange(len(meshes) + len(panes)))
    assert without is not None
    assert with_panes is not None
    rest = with_panes.visible[with_panes.visible < len(meshes)]
    assert set(without.proven) <= set(rest)
    assert len(np.setxor1d(rest, without.visible)) <= 2  # which shafts are looked at follows from all that is asked
    assert 0 < (with_panes.visible >= len(meshes)).sum() < len(panes)


def test_it_gives_up_only_where_what_is_seen_is_too_much() -> None:
    """Neither panes nor what they do not hide are counted before they are seen."""
    meshes = [wall(500, cells=10), wall(1000), wall(2000, cells=30)]
    engine = Engine(soup_of(meshes, see_through=[0]), WAYS["images and shafts"])
    seen = 200 + 2
    assert engine.visible_from(LO, HI, engine.soup.drawables, seen - 1) is None
    found = engine.visible_from(LO, HI, engine.soup.drawables, seen)
    assert found is not None
    assert found.visible.tolist() == [0, 1]


def test_hold_out_rays_count_panes_and_what_is_seen_through_them() -> None:
    """Of each ray that a whole set of drawables misses, whatever is left of it: the pane, or what stands behind it."""
    case = box((-200, -200, -200), (200, 200, 200))
    meshes = [case, box((-300, -300, -300), (300, 300, 300)), box((-400, -400, -400), (400, 400, 400)), wall(1000)]
    settings = replace(WAYS["sampled"], hold_out_rays=500)
    engine = Engine(soup_of(meshes, see_through=[0, 1]), settings)

    def missed(*visible: int) -> int:
        return engine.count_misses(LO, HI, np.arange(4), np.array(visible, np.int64), np.random.default_rng(1))

    assert missed(0, 1, 2) == 0
    assert missed(0, 1, 2, 3) == 0
    assert missed(0, 2) == missed(1, 2) == missed(0, 1) == missed() == 500
