"""Gaps that count as closed: which are found, what is missed through them, what never is, and that it is measured."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jobs.checking.oracle import examine, surface_points
from jobs.visibility.engine import Engine
from jobs.visibility.settings import EngineSettings
from jobs.visibility.surfaces.gaps import MOST, SHORTER, near_part
from jobs.visibility.surfaces.soup import Soup
from tests.jobs.detail.sampling import distances
from tests.jobs.visibility.scenes import Mesh, box, oracle_of, soup_of

#: Of the scenes below: 0.1 mm a grid unit.
MILLIMETRE = 10
SEAL = 10.0 * MILLIMETRE


def reported(meshes: list[Mesh], lo: np.ndarray, hi: np.ndarray, seal: float, one_sided: bool = False) -> list[int]:
    soup = soup_of(meshes, one_sided, seal=seal)
    found = Engine(soup, EngineSettings(seal=seal)).visible_from(lo, hi, soup.drawables)
    assert found is not None
    assert set(found.proven) <= set(found.visible)
    return [int(d) for d in found.visible]


def two_walls(crack: int) -> list[Mesh]:
    """Two abutting walls with a crack between them, and a thing behind it."""
    return [
        box((0, -30_000, -30_000), (2000, 0, 30_000)),
        box((0, crack, -30_000), (2000, 30_000, 30_000)),
        box((9000, -500, -500), (9500, 500, 500)),
    ]


#: A person before the walls.
LO, HI = np.array([-22_000.0, -1000, -1000]), np.array([-20_000.0, 1000, 1000])


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize(("crack", "without", "with_seal"), [(1, True, False), (8, True, False), (20, True, True)])
def test_what_is_behind_a_crack_narrower_than_the_distance_is_left_out(
    crack: int, without: bool, with_seal: bool, one_sided: bool
) -> None:
    meshes = two_walls(crack * MILLIMETRE)
    assert (2 in reported(meshes, LO, HI, 0.0, one_sided)) == without
    assert (2 in reported(meshes, LO, HI, SEAL, one_sided)) == with_seal


def test_a_wall_that_ends_a_little_above_the_floor_or_reaches_into_it_is_sealed() -> None:
    floor = box((-60_000, -60_000, -1000), (60_000, 60_000, 0))
    behind = box((9000, -500, 0), (9500, 500, 900))
    for height, seen in ((5, False), (-5, False), (30, True)):
        wall = box((0, -60_000, height * MILLIMETRE), (2000, 60_000, 40_000))
        lo, hi = np.array([-12_000.0, -1000, 300]), np.array([-10_000.0, 1000, 2300])
        assert (2 in reported([floor, wall, behind], lo, hi, SEAL)) == seen, height


@pytest.mark.parametrize("apart", [1, 5, 9])
def test_edges_in_front_of_a_near_surface_that_ends_there_close_nothing(apart: int) -> None:
    """A plate before another one of the same size: their rims are near each other, and one looks past both."""
    thin = [box((x, -9000, -9000), (x + 3 * MILLIMETRE, 9000, 9000)) for x in (0, (3 + apart) * MILLIMETRE)]
    rng = np.random.default_rng(apart)
    things = []
    for _ in range(60):
        at = np.array([rng.integers(4000, 30_000), *rng.integers(-40_000, 40_000, 2)])
        things.append(box(tuple(at.tolist()), tuple((at + rng.integers(50, 700, 3)).tolist())))
    lo, hi = np.array([-12_000.0, -2000, -2000]), np.array([-9000.0, 1000, 1000])
    open_ = reported(thin + things, lo, hi, 0.0)
    assert reported(thin + things, lo, hi, SEAL) == open_
    assert 2 + len(things) > len(open_) > 20


def test_what_the_wide_end_of_a_wedge_shows_is_kept() -> None:
    """Two walls that meet at their lower corners and are 200 mm apart at the top: the narrow end alone is sealed."""
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    corners = np.array([[0, -30_000, -10_000], [0, 0, -10_000], [0, 0, 10_000], [0, -30_000, 10_000]], np.int32)
    other = np.array([[0, 30_000, -10_000], [0, 0, -10_000], [0, 2000, 10_000], [0, 30_000, 10_000]], np.int32)
    below = [
        (np.array([[0, y, -60_000], [0, 0, -60_000], [0, 0, -10_000], [0, y, -10_000]], np.int32), triangles)
        for y in (-30_000, 30_000)
    ]
    places = [(y, z) for y in range(-900, 900, 200) for z in range(-24_000, 12_000, 700)]
    things = [box((6000, y, z), (6100, y + 50, z + 50)) for y, z in places]
    meshes = [(corners, triangles), (other, triangles[:, ::-1]), *below, *things]
    lo, hi = np.array([-9000.0, -500, -500]), np.array([-8000.0, 500, 500])
    without, with_seal = reported(meshes, lo, hi, 0.0), reported(meshes, lo, hi, SEAL)
    assert set(with_seal) < set(without)
    soup = soup_of(meshes)
    for sight in misses_of(soup, with_seal, lo, hi, 20_000, 1):
        assert clearance(soup, *sight) <= SEAL


def misses_of(
    soup: Soup, visible: list[int], lo: np.ndarray, hi: np.ndarray, rays: int, seed: int
) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Lines of sight to what is not reported, confirmed: from, to, drawable. All that is left out is aimed at."""
    corners = soup.vertices[soup.triangles].astype(np.float32)
    owner, oracle = soup.triangle_drawable.astype(np.int64), oracle_of(soup)
    rng = np.random.default_rng(seed)
    left = np.flatnonzero(~np.isin(owner, visible))
    if not len(left):
        return []
    starts = surface_points(lo, hi, rays, rng)
    rng.shuffle(starts)
    aims = left[rng.integers(0, len(left), rays)]
    ends = (corners[aims].astype(np.float64) * rng.dirichlet((1, 1, 1), rays)[:, :, None]).sum(axis=1)
    directions = (ends - starts).astype(np.float32)
    hits, along = oracle.cast(starts, directions)
    found = []
    for ray in np.flatnonzero((hits >= 0) & ~np.isin(owner[hits], visible)):
        if not np.isnan(oracle.confirm(starts[ray], directions[ray], int(hits[ray]))):
            start = starts[ray].astype(np.float64)
            found.append((start, start + along[ray] * directions[ray].astype(np.float64), int(owner[hits[ray]])))
    return found


def clearance(soup: Soup, start: np.ndarray, end: np.ndarray, drawable: int) -> float:
    """How far a line of sight stays away from all but the drawable that it ends at."""
    others = soup.triangles[soup.triangle_drawable != drawable]
    length = float(np.linalg.norm(end - start))
    places = np.linspace(0, 1, 2 + int(length / 10))[:, None]
    return float(distances(start + places * (end - start), soup.vertices.astype(np.float64), others).min())


def cracked_screens(rng: np.random.Generator) -> tuple[list[Mesh], np.ndarray, np.ndarray, float]:
    """Screens of panels with gaps of all widths, overlaps, tilts and panels left out, things behind; a cell before."""
    seal = int(rng.choice([5, 20, 80]))
    panel, reach = int(rng.choice([40, 120])) * seal // 2, int(rng.integers(2, 4))
    shake = float(rng.choice([0.0, 0.5, 2.0]))
    meshes: list[Mesh] = []
    for x in range(0, int(rng.integers(1, 3)) * panel, panel):
        for i in range(-reach, reach):
            for j in range(-reach, reach):
                if rng.random() < 0.05:
                    continue
                gap = rng.choice([0.0, 0.3, 0.8, 1.5, 4.0], 4, p=[0.2, 0.3, 0.3, 0.1, 0.1]) * seal
                gap *= rng.choice([0.5, 0.5, 0.5, -0.5], 4)
                y0, z0 = i * panel + gap[0], j * panel + gap[1]
                y1, z1 = (i + 1) * panel - gap[2], (j + 1) * panel - gap[3]
                at = x + rng.normal() * shake * seal
                if rng.random() < 0.5:
                    corners = np.array([[at, y0, z0], [at, y1, z0], [at, y1, z1], [at, y0, z1]])
                    if rng.random() < 0.3:
                        corners += rng.normal(size=(4, 3)) * seal
                    meshes.append((np.rint(corners).astype(np.int32), np.array([[0, 1, 2], [0, 2, 3]])))
                else:
                    thick = int(rng.choice([0.3, 1.0, 5.0]) * seal) + 1
                    meshes.append(box((int(at), int(y0), int(z0)), (int(at) + thick, int(y1), int(z1))))
    for _ in range(int(rng.integers(10, 40))):
        low = np.array([rng.integers(2 * panel, 5 * panel), *rng.integers(-reach * panel, reach * panel, 2)])
        meshes.append(box(tuple(low.tolist()), tuple((low + rng.integers(seal, panel // 2, 3)).tolist())))
    half = np.array([1.0, rng.choice([0.3, 1.0]), 1.0]) * float(rng.choice([3, 10, 25])) * seal
    middle = np.array([-half[0] - seal * rng.choice([4.0, 30, 100]), *((2 * rng.random(2) - 1) * reach * panel * 0.7)])
    return meshes, middle - half, middle + half, float(seal)


@pytest.mark.slow
def test_whatever_is_missed_is_seen_through_narrow_gaps_alone() -> None:
    """Nobody who sees something missed does so along a line that keeps the distance from everything else."""
    settings = {"resolution": 128, "proof_resolution": 0}
    missed, lines = 0, 0
    for number in range(40):
        rng = np.random.default_rng([31, number])
        meshes, lo, hi, seal = cracked_screens(rng)
        soup = soup_of(meshes, one_sided=bool(rng.random() < 0.3), seal=seal)
        found = Engine(soup, EngineSettings(seal=seal, **settings)).visible_from(lo, hi, soup.drawables)
        assert found is not None
        sights = misses_of(soup, found.visible.tolist(), lo, hi, 4000, number)
        missed += len({drawable for _, _, drawable in sights})
        for sight in sights[:12]:
            assert clearance(soup, *sight) <= seal, f"scene {number}"
            lines += 1
    assert missed > 10
    assert lines > 50


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_measured_chance_of_a_miss_is_the_oracles(seed: int) -> None:
    """A fence whose slits are all sealed: most of what is behind is missed, and the cell says how often it is seen."""
    rng = np.random.default_rng(seed)
    width, slit = 600, 60
    meshes = [box((0, y, -20_000), (50, y + width, 20_000)) for y in range(-12_000, 12_000, width + slit)]
    bars = len(meshes)
    for _ in range(40):
        at = np.array([rng.integers(3000, 20_000), *rng.integers(-9000, 9000, 2)])
        meshes.append(box(tuple(at.tolist()), tuple((at + rng.integers(500, 4000, 3)).tolist())))
    lo, hi = np.array([-4000.0, -500, -500]), np.array([-3000.0, 500, 500])
    soup, count = soup_of(meshes, seal=SEAL), 40_000
    engine = Engine(soup, EngineSettings(seal=SEAL, hold_out_rays=count))
    found = engine.visible_from(lo, hi, soup.drawables)
    assert found is not None
    assert len(found.visible) < bars + 20
    measured = engine.count_misses(lo, hi, soup.drawables, found.visible, np.random.default_rng(seed))
    looked = examine(oracle_of(soup), lo, hi, found.visible, 3 * count, np.random.default_rng(seed))
    assert looked.uniform == count
    assert measured > 100
    assert abs(measured - looked.missed_rays) <= 5 * np.sqrt(measured + looked.missed_rays)
    assert set(found.proven) <= set(looked.seen)


coordinates = st.tuples(*[st.integers(-60, 60)] * 3)


@given(st.lists(coordinates, min_size=5, max_size=5, unique=True), st.floats(0.5, 80))
def test_the_part_of_an_edge_near_a_triangle_is_what_brute_force_finds(points: list, distance: float) -> None:
    vertices = np.array(points, np.int32)
    corners = vertices.astype(np.float64)
    if not np.cross(corners[1] - corners[0], corners[2] - corners[0]).any():
        return
    s0, s1 = near_part(vertices, 0, 1, 2, 3, 4, distance)
    places = np.linspace(0, 1, 401)
    apart = distances(corners[3] + places[:, None] * (corners[4] - corners[3]), corners, np.array([[0, 1, 2]]))
    inside = (places >= s0) & (places <= s1)
    assert (apart[inside] <= distance + 1e-6).all()
    assert (apart[~inside] >= distance - 1e-6).all()


@pytest.mark.parametrize("seed", range(4))
def test_the_gaps_of_a_soup_are_those_that_brute_force_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    meshes = [box(tuple(at.tolist()), tuple((at + 80).tolist())) for at in rng.integers(0, 4000, (60, 3))]
    meshes += [box((5000, 0, 0), (5100, 900, 900)), box((5105, 0, 0), (5200, 900, 900))]
    soup = soup_of(meshes, seal=12.0)
    gaps = soup.gaps
    assert gaps is not None
    assert len(gaps.near) > 20
    expected = 0
    for e in range(len(soup.edge_start) - 1):
        t, backwards = soup.edge_uses[soup.edge_start[e]] >> 1, soup.edge_uses[soup.edge_start[e]] & 1
        side = int(np.flatnonzero(soup.triangle_edges[t] == e)[0])
        a, b = (int(soup.triangles[t, (side + k) % 3]) for k in ((1, 0) if backwards else (0, 1)))
        mine = slice(*gaps.start[e : e + 2])
        assert mine.stop - mine.start <= MOST
        for other, (s0, s1) in zip(gaps.near[mine].tolist(), gaps.part[mine].tolist(), strict=True):
            corners = soup.triangles[other]
            assert not {a, b} <= set(corners.tolist())
            exact = near_part(soup.vertices, *corners.tolist(), a, b, 12.0 * SHORTER)
            assert np.allclose((s0, s1), exact, atol=1e-6)
        flat = set(soup.triangles[soup.edge_uses[slice(*soup.edge_start[e : e + 2])] >> 1].ravel().tolist())
        if np.ptp(soup.vertices[list(flat)], axis=0).min() == 0:
            assert mine.start == mine.stop  # the diagonal of a face
            continue
        for other, corners in enumerate(soup.triangles):
            if not {a, b} & set(corners.tolist()):
                s0, s1 = near_part(soup.vertices, *corners.tolist(), a, b, 12.0 * SHORTER)
                expected += s1 > s0
                full = mine.stop - mine.start == MOST  # then some are let go
                assert (s1 > s0) == (other in gaps.near[mine]) or (full and s1 > s0)
    assert expected > 20


def test_a_soup_without_narrow_gaps_has_none() -> None:
    far_apart = [box((x, 0, 0), (x + 300, 300, 300)) for x in range(0, 6000, 1000)]
    assert soup_of(far_apart).gaps is None
    assert soup_of(far_apart, seal=50.0).gaps is None
