"""What rays prove visible is visible in exact arithmetic too, and what sampling misses is measured truthfully."""

from __future__ import annotations

from collections.abc import Collection
from fractions import Fraction

import numpy as np
import pytest

from jobs.checking.oracle import examine, surface_points
from jobs.visibility.engine import Engine
from jobs.visibility.proof import aimed_rays
from jobs.visibility.proof.aimed_rays import INSET, LEAST_WEIGHT, SEEN, TURNED
from jobs.visibility.settings import EngineSettings
from jobs.visibility.surfaces import ray_tree
from jobs.visibility.surfaces.soup import Soup
from tests.jobs.visibility.nasty import nasty_scene
from tests.jobs.visibility.scenes import box, oracle_of, rooms, sheet, soup_of


def scene_and_tree(soup: Soup) -> tuple[ray_tree.Scene, ray_tree.Tree]:
    return ray_tree.build_scene(
        soup.vertices, soup.triangles, soup.triangle_drawable, soup.one_sided, soup.cluster_start
    )


def scene_of(soup: Soup) -> ray_tree.Scene:
    """All that stops rays."""
    return ray_tree.prune(*scene_and_tree(soup), np.flatnonzero(~soup.see_through))


def look(soup: Soup, scene: ray_tree.Scene, t: int, wa: float, wb: float, o: np.ndarray) -> int:
    """What the kernel says when all of the scene stands."""
    ray = aimed_rays.make_ray()
    ray.o[:] = o
    return int(aimed_rays.look(scene, t, int(soup.triangle_drawable[t]), wa, wb, ray, -1))


def exactly_seen(soup: Soup, t: int, wa: float, wb: float, o: np.ndarray) -> bool:
    """Whether no other drawable that stops rays stands before or at the point, which is not seen from a back that is
    not drawn.

    In rational arithmetic, triangle by triangle. Triangles along the ray hide nothing.
    """
    eye = [Fraction(float(x)) for x in o]
    corners = [[[int(x) for x in soup.vertices[v]] for v in triangle] for triangle in soup.triangles]
    weights = (Fraction(wa), Fraction(wb), 1 - Fraction(wa) - Fraction(wb))
    d = [sum(w * c[k] for w, c in zip(weights, corners[t], strict=True)) - eye[k] for k in range(3)]

    def dot(a: list, b: list) -> Fraction:
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    def cross(a: list, b: list) -> list:
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    for number, triangle in enumerate(corners):
        owner = soup.triangle_drawable[number]
        if (owner == soup.triangle_drawable[t] or soup.see_through[owner]) and number != t:
            continue
        a, b, c = ([x - y for x, y in zip(corner, eye, strict=True)] for corner in triangle)
        normal = cross([x - y for x, y in zip(b, a, strict=True)], [x - y for x, y in zip(c, a, strict=True)])
        ahead, along = dot(normal, a), dot(normal, d)
        back = soup.one_sided[owner] and ahead > 0
        if number == t:
            if ahead == 0 or back:
                return False
            continue
        volumes = [dot(d, cross(b, c)), dot(d, cross(c, a)), dot(d, cross(a, b))]
        if along == 0 or back or (min(volumes) < 0 < max(volumes)):
            continue
        if 0 <= ahead / along < 1:
            return False
    return True


@pytest.mark.parametrize("seed", range(6))
def test_what_is_seen_is_seen_in_exact_arithmetic(seed: int) -> None:
    """From and to points of the lattice, too, so that rays pass exactly through edges and corners."""
    rng = np.random.default_rng([17, seed])
    agreed, refused = 0, 0
    for _ in range(25):
        attack = nasty_scene(rng)
        soup = soup_of(attack.meshes[:14], attack.one_sided, attack.cluster_size, see_through=attack.see_through)
        if not len(soup.triangles):
            continue
        scene = scene_of(soup)
        for _ in range(8):
            t = int(rng.integers(len(soup.triangles)))
            if rng.random() < 0.5:
                wa, wb = [(0.25, 0.25), (0.5, 0.25), (0.125, 0.5)][rng.integers(3)]
                o = np.rint(rng.uniform(attack.lo, attack.hi)) + rng.choice([0.0, 0.5], 3)
            else:
                wa, wb = np.maximum(rng.dirichlet((0.3, 0.3, 0.3))[:2] * (1 - 3 * LEAST_WEIGHT), LEAST_WEIGHT)
                o = rng.uniform(attack.lo, attack.hi)
            found = look(soup, scene, t, float(wa), float(wb), o)
            truth = exactly_seen(soup, t, float(wa), float(wb), o)
            assert truth or found != SEEN
            agreed += truth and found == SEEN
            refused += truth and found != SEEN
    assert agreed > 20
    assert refused < 0.3 * agreed  # the margins cost little; coincident things, edges and corners are refused


def test_a_ray_along_the_seam_of_two_walls_sees_nothing_behind_them() -> None:
    left = sheet((100, -400, -400), (100, 0, 400), 4)
    right = sheet((100, 0, -400), (100, 400, 400), 4)
    behind = (np.array([[200, -3, -3], [200, 3, -3], [200, 0, 6]], np.int32), np.array([[0, 1, 2]]))
    soup = soup_of([left, right, behind])
    target = int(np.flatnonzero(soup.triangle_drawable == 2)[0])
    third = 1 / 3
    for y in (0.0, 1e-13, -1e-13, 7.0):
        assert look(soup, scene_of(soup), target, third, third, np.array([0.0, y, 0.0])) >= 0
    soup = soup_of([left, behind])
    target = int(np.flatnonzero(soup.triangle_drawable == 1)[0])
    assert look(soup, scene_of(soup), target, third, third, np.array([0.0, 0.1, 0.0])) == SEEN
    assert look(soup, scene_of(soup), target, third, third, np.array([0.0, 0.0, 0.0])) >= 0  # along the very edge


def test_backs_of_one_sided_drawables_are_not_seen_and_hide_nothing() -> None:
    positions, triangles = sheet((100, -400, -400), (100, 400, 400), 1)
    thing = box((200, -9, -9), (220, 9, 9))
    eye = np.array([0.5, 0.25, 0.125])
    answers = []
    for wound in (triangles, triangles[:, ::-1]):
        soup = soup_of([(positions, wound), thing], one_sided=True)
        near = int(np.flatnonzero(soup.triangle_drawable == 0)[0])
        scene = scene_of(soup)
        of_thing = [look(soup, scene, int(t), 0.3, 0.3, eye) for t in np.flatnonzero(soup.triangle_drawable == 1)]
        answers.append((look(soup, scene, near, 0.3, 0.3, eye), min(x for x in of_thing if x != TURNED)))
    (front, behind_front), (back, behind_back) = sorted(answers, key=lambda pair: pair[0] != SEEN)
    assert (front, behind_back, back) == (SEEN, SEEN, TURNED)
    assert behind_front >= 0


def test_of_coincident_things_both_may_be_drawn_and_what_is_behind_them_may_not() -> None:
    here = sheet((100, -40, -40), (100, 40, 40), 1)
    barely_behind = sheet((101, -40, -40), (101, 40, 40), 1)
    soup = soup_of([here, here, barely_behind])
    scene = scene_of(soup)
    for t, drawable in enumerate(soup.triangle_drawable):
        assert (look(soup, scene, t, 0.3, 0.3, np.zeros(3)) == SEEN) == (drawable < 2)


@pytest.mark.parametrize("seed", range(4))
def test_the_first_hit_is_the_nearest_of_all_triangles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    attack = nasty_scene(rng)
    soup = soup_of(attack.meshes, attack.one_sided, attack.cluster_size)
    scene, tree = scene_and_tree(soup)
    standing = rng.random(len(soup.drawables)) < 0.8
    pruned = ray_tree.prune(scene, tree, np.flatnonzero(standing))
    corners = soup.vertices[soup.triangles].astype(np.float64)
    over, stack = np.empty(3), np.empty(ray_tree.STACK, np.int32)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for _ in range(200):
        o = rng.uniform(attack.lo, attack.hi)
        d = rng.normal(size=3)
        a, b, c = (corners[:, i] - o for i in range(3))
        volumes = np.stack([np.cross(b, c) @ d, np.cross(c, a) @ d, np.cross(a, b) @ d])
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (normal * a).sum(axis=1) / (normal @ d)
        met = ((volumes >= 0).all(axis=0) | (volumes <= 0).all(axis=0)) & (at > 0) & standing[soup.triangle_drawable]
        met &= ~(soup.one_sided[soup.triangle_drawable] & (normal @ d > 0))
        t, nearest = ray_tree.find_first(pruned, o, d, over, stack)
        if met.any():
            assert nearest == pytest.approx(at[met].min(), rel=1e-9)
            assert at[t] == pytest.approx(nearest, rel=1e-9)
        else:
            assert t == -1


@pytest.mark.parametrize("boxes", [0, 1, 2, 7, 1000])
def test_the_tree_holds_every_box_once(boxes: int) -> None:
    rng = np.random.default_rng(boxes)
    lo = rng.integers(-1000, 1000, (boxes, 3)).astype(np.float64)
    hi = lo + rng.integers(0, 50, (boxes, 3))
    box_of, right, cluster, _ = ray_tree.build_tree(lo, hi)
    assert sorted(cluster[cluster >= 0].tolist()) == list(range(boxes))
    for node in range(len(right)):
        if cluster[node] >= 0:
            assert (box_of[node, 0] <= lo[cluster[node]]).all()
            assert (box_of[node, 1] >= hi[cluster[node]]).all()
        else:
            for child in (node + 1, right[node]):
                assert (box_of[node, 0] <= box_of[child, 0]).all()
                assert (box_of[node, 1] >= box_of[child, 1]).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_pruned_tree_holds_what_stands_once_and_nothing_of_the_last_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    soup = soup_of(rooms(rng, 3))
    scene, tree = scene_and_tree(soup)
    owner = soup.triangle_drawable[scene.bundle_start[:-1]]
    for part in (0.0, 0.02, 0.5, 1.0, 0.1):
        standing = np.flatnonzero(rng.random(len(soup.drawables)) < part)
        box, right, bundle, _ = ray_tree.prune_tree(*tree, standing)
        assert sorted(bundle[bundle >= 0]) == np.flatnonzero(np.isin(owner, standing)).tolist()
        for node in np.flatnonzero(bundle < 0):
            below = box[[node + 1, right[node]]]
            assert (box[node, 0] == below[:, 0].min(axis=0)).all()
            assert (box[node, 1] == below[:, 1].max(axis=0)).all()
        for node in np.flatnonzero(bundle >= 0):
            assert (box[node] == tree.box[tree.leaf[bundle[node]]]).all()
        assert not tree.kept.any()


@pytest.mark.parametrize("seed", range(4))
def test_wide_nodes_give_the_bundles_that_the_tree_gives_and_in_its_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    soup = soup_of(rooms(rng, 3))
    scene, tree = scene_and_tree(soup)
    over, stack = np.empty(3), np.empty(ray_tree.STACK, np.int32)
    for part in (0.01, 0.02, 0.1, 0.5, 1.0):
        standing = np.flatnonzero(rng.random(len(soup.drawables)) < part)
        pruned = ray_tree.prune(scene, tree, standing)
        box, right, bundle, axis = ray_tree.prune_tree(*tree, standing)
        for _ in range(20):
            o = rng.uniform(soup.vertices.min(axis=0), soup.vertices.max(axis=0))
            d = rng.normal(size=3) * rng.choice([0.0, 1.0, 1e4], 3)
            ray_tree.inverse(d, over)
            expected = []
            nodes = [0][: len(right)]
            while nodes:
                node = nodes.pop()
                planes = (np.stack([np.floor(box[node, 0]), np.ceil(box[node, 1])]) - o) * over
                if max(planes.min(axis=0).max(), 0.0) > min(planes.max(axis=0).min(), 1.0):
                    continue
                if bundle[node] >= 0:
                    expected.append(bundle[node])
                else:
                    nodes += [node + 1, right[node]] if d[axis[node]] < 0 else [right[node], node + 1]
            stack[0] = 0
            found = []
            c, count = ray_tree.next_bundle(pruned, o, over, 1.0, stack, min(len(pruned.child), 1))
            while c >= 0:
                found.append(c)
                c, count = ray_tree.next_bundle(pruned, o, over, 1.0, stack, count)
            assert found == expected


@pytest.mark.parametrize("seed", range(4))
def test_what_a_ray_passes_beside_it_does_not_meet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    attack = nasty_scene(rng)
    soup = soup_of(attack.meshes, attack.one_sided, attack.cluster_size)
    scene = scene_of(soup)
    beside = met = 0
    for _ in range(20):
        o = rng.uniform(attack.lo, attack.hi)
        target = soup.triangles[rng.integers(len(soup.triangles))]
        weights = rng.dirichlet(np.ones(3)) * (rng.random(3) < 0.7)  # now and then along an edge, or at a corner
        d = 2 * (weights @ soup.vertices[target] / max(weights.sum(), 1e-9) - o)  # it ends behind the triangle
        reach = 2 * float(np.abs(soup.vertices[target] - o).max())
        for c in range(min(len(scene.bundle_start) - 1, 100)):
            mask = ray_tree.passes_beside(scene.corners, c, o, d, reach)
            for t in range(scene.bundle_start[c], scene.bundle_start[c + 1]):
                meets = ray_tree.meets(soup.vertices, soup.triangles, t, o, d, reach) != ray_tree.APART
                past = bool(mask >> (t - scene.bundle_start[c]) & 1)
                assert not (past and meets)
                beside += past
                met += meets
    assert beside > 0
    assert met > 0


def seen_from_corners(soup: Soup, drawable: int, lo: np.ndarray, hi: np.ndarray, rays: int) -> bool:
    """Whether any of many rays from a cell's corners to all over a drawable is stopped by nothing of another before it.

    In float64, every triangle for itself; what lies in the same place does not count as before.
    """
    rng = np.random.default_rng(drawable)
    corners = soup.vertices[soup.triangles].astype(np.float64)
    others = corners[(soup.triangle_drawable != drawable) & ~soup.see_through[soup.triangle_drawable]]
    normal = np.cross(others[:, 1] - others[:, 0], others[:, 2] - others[:, 0])
    targets = corners[rng.choice(np.flatnonzero(soup.triangle_drawable == drawable), rays)]
    targets = (targets * rng.dirichlet((0.2, 0.2, 0.2), rays)[:, :, None]).sum(axis=1)
    for eye, target in zip(lo + (hi - lo) * rng.choice([INSET / 2, 1 - INSET / 2], (rays, 3)), targets, strict=True):
        d = target - eye
        a, b, c = (others[:, i] - eye for i in range(3))
        volumes = np.stack([np.cross(b, c) @ d, np.cross(c, a) @ d, np.cross(a, b) @ d])
        inside = (volumes >= 0).all(axis=0) | (volumes <= 0).all(axis=0)
        along = normal @ d
        at = (normal * a).sum(axis=1) / np.where(along == 0, np.nan, along)
        if not (inside & (at > 0) & (at < 1 - 1e-9)).any():
            return True
    return False


@pytest.mark.parametrize("seed", range(3))
def test_what_is_proven_many_rays_see_as_well_and_little_is_undecided(seed: int) -> None:
    soup = soup_of(rooms(np.random.default_rng(seed), 4), see_through=range(5, 99, 7) if seed else ())
    lo = np.random.default_rng(seed).integers(500, 15000, 3) * np.array([1.0, 1.0, 0.0]) + [0.0, 0.0, 1500.0]
    hi = lo + 300
    found = Engine(soup, EngineSettings(resolution=64)).visible_from(lo, hi, soup.drawables)
    assert found is not None
    seen = examine(oracle_of(soup), lo, hi, found.visible, 300_000, np.random.default_rng(9)).seen
    for drawable in set(found.proven.tolist()) - set(seen.tolist()):
        assert seen_from_corners(soup, drawable, lo, hi, 5000)
    assert len(found.proven) >= 0.9 * len(seen)


def test_aimed_rays_prove_more_than_item_buffers_alone() -> None:
    soup = soup_of(rooms(np.random.default_rng(5), 4))
    lo, hi = np.array([6000.0, 6100, 1500]), np.array([6300.0, 6400, 1800])
    few, many = (
        Engine(soup, EngineSettings(resolution=64, proof_resolution=8, shafts=0, most_aimed_rays=rays))
        .visible_from(lo, hi, soup.drawables)
        for rays in (0, 512)
    )  # fmt: skip
    assert few is not None
    assert many is not None
    assert set(few.proven) < set(many.proven)


@pytest.mark.parametrize("panes", [(), range(3, 99, 5), range(99)])
@pytest.mark.parametrize("rays", [20, 2000])
def test_the_measured_chance_of_a_miss_is_the_oracles(rays: int, panes: Collection[int]) -> None:
    soup = soup_of(rooms(np.random.default_rng(2), 4), see_through=panes)
    lo, hi = np.array([9000.0, 5100, 1200]), np.array([9400.0, 5500, 1600])
    count = 40_000
    settings = EngineSettings(sampled=True, sampling_rays=rays, sampling_aimed_rays=0, hold_out_rays=count)
    engine = Engine(soup, settings)
    found = engine.visible_from(lo, hi, soup.drawables)
    assert found is not None
    assert set(found.proven) <= set(found.visible)
    missed = engine.count_misses(lo, hi, soup.drawables, found.visible, np.random.default_rng(1))
    oracle, owner = oracle_of(soup), soup.triangle_drawable
    rng = np.random.default_rng(2)
    sight = surface_points(lo, hi, count, rng), rng.normal(size=(count, 3)).astype(np.float32)
    hit, along = oracle.cast(*sight)
    wrong = (hit >= 0) & ~np.isin(owner[hit], found.visible)
    through, passed = oracle.passed(*sight, along)
    wrong[through[~np.isin(owner[passed], found.visible)]] = True
    truth = int(wrong.sum())
    assert abs(missed - truth) <= 5 * np.sqrt(missed + truth + 1)
    if rays == 20:
        assert missed > 100  # so few rays miss much, and it is said
    everything = engine.count_misses(lo, hi, soup.drawables, soup.drawables, np.random.default_rng(1))
    nothing = engine.count_misses(lo, hi, soup.drawables, soup.drawables[:0], np.random.default_rng(1))
    assert everything == 0
    assert nothing > 0.9 * count


def test_sampling_sees_part_of_what_is_proven_to_suffice() -> None:
    soup = soup_of(rooms(np.random.default_rng(3), 4))
    lo, hi = np.array([9000.0, 5100, 1200]), np.array([9400.0, 5500, 1600])
    sampled = Engine(soup, EngineSettings(sampled=True)).visible_from(lo, hi, soup.drawables)
    sure = Engine(soup, EngineSettings(resolution=64)).visible_from(lo, hi, soup.drawables)
    assert sampled is not None
    assert sure is not None
    assert set(sampled.visible) <= set(sure.visible)
    assert len(sampled.visible) >= len(sure.proven) - 2
    engine = Engine(soup, EngineSettings(sampled=True))
    assert engine.visible_from(lo, hi, soup.drawables, 10) is None
