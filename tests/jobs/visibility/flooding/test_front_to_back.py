"""A cell's work follows what it sees: trees and laziness change nothing of what is found, and little is touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jobs.visibility.engine import Engine
from jobs.visibility.flooding import occludees, occluders
from jobs.visibility.flooding.front_to_back import WORTH, begin_queue, make_queue, next_cluster
from jobs.visibility.images.layers import add_layer, clear_layers
from jobs.visibility.proof import item_buffer
from jobs.visibility.settings import EngineSettings
from jobs.visibility.surfaces import ray_tree, seen_mesh
from jobs.visibility.surfaces.clusters import Clusters, make_clusters
from jobs.visibility.surfaces.soup import Soup
from tests.jobs.visibility.scenes import rooms, soup_of

R = 16


def seen_by(soup: Soup, places: np.ndarray, lo: np.ndarray, hi: np.ndarray) -> tuple[seen_mesh.Mesh, Clusters]:
    """The soup as a cell with a cut sees it, and its clusters."""
    looked = seen_mesh.make_mesh(
        soup.vertices, soup.triangles, soup.triangle_edges, soup.edge_start, soup.edge_uses, soup.triangle_drawable,
        soup.one_sided, soup.see_through,
    )  # fmt: skip
    seen_mesh.begin(looked, places, 0.5 * (lo + hi), 0.5 * (hi - lo))
    clusters = make_clusters(
        soup.cluster_start, soup.cluster_drawable, soup.cluster_lo, soup.cluster_hi, soup.cluster_breadth
    )
    return looked, clusters


def some_cell(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    lo = rng.integers(100, 11000, 3) * np.array([1.0, 1.0, 0.2])
    return lo, lo + rng.integers(50, 600, 3)


def some_layers(rng: np.random.Generator, empty: float) -> np.ndarray:
    """Layers that hide this and that, and nothing in a part of their pixels."""
    layers = np.empty((6, R, R, 2, 2), np.float32)
    clear_layers(layers)
    for face, j, i in np.argwhere(rng.random((6, R, R)) >= empty):
        depth = float(rng.uniform(1, 8))
        add_layer(layers, face, j, i, depth, np.inf if rng.random() < 0.9 else depth * 3)
    return layers


@pytest.mark.parametrize("seed", range(8))
def test_clusters_come_up_in_the_order_of_their_distances_without_those_that_are_hidden(seed: int) -> None:
    rng = np.random.default_rng(seed)
    soup = soup_of(rooms(rng, 3), cluster_size=int(rng.choice([1, 4, 32])), see_through=range(0, 99, 2 + seed))
    places = np.flatnonzero(rng.random(len(soup.drawables)) < 0.8)
    lo, hi = some_cell(rng)
    looked, clusters = seen_by(soup, places, lo, hi)
    box_lo, box_hi = (soup.cluster_lo - looked.centre) / looked.half, (soup.cluster_hi - looked.centre) / looked.half
    nearest = np.maximum(np.maximum(box_lo, -box_hi), 0).max(axis=1)
    far = np.maximum(np.abs(box_lo), np.abs(box_hi)).max(axis=1)
    broad = soup.cluster_breadth / looked.half.min() >= 2 * (WORTH - 1) * far / (WORTH * far - 1)
    layers = some_layers(rng, float(rng.choice([0.0, 0.01, 0.5])))
    queue = make_queue(len(soup.cluster_lo))
    for face in range(6):
        found = []
        waiting = begin_queue(clusters, looked, face, R, queue)
        while True:
            c, waiting = next_cluster(clusters, looked, face, layers, queue, waiting)
            if c < 0:
                break
            found.append(c)
        expected = [
            c
            for c in np.argsort(nearest, kind="stable")
            if broad[c]
            and not soup.see_through[soup.cluster_drawable[c]]
            and looked.active[soup.cluster_drawable[c]]
            and not occludees.box_hidden_on(face, box_lo[c], box_hi[c], layers, True)
        ]
        assert found == expected


@pytest.mark.parametrize("seed", range(8))
def test_what_is_hidden_is_what_is_hidden_cluster_by_cluster(seed: int) -> None:
    rng = np.random.default_rng(seed)
    soup = soup_of(rooms(rng, 3), bool(seed % 2), int(rng.choice([1, 4, 32])), see_through=range(0, 99, 2 + seed))
    places = np.flatnonzero(rng.random(len(soup.drawables)) < 0.8)
    lo, hi = some_cell(rng)
    looked, clusters = seen_by(soup, places, lo, hi)
    layers = some_layers(rng, float(rng.choice([0.0, 0.01])))
    found = occludees.find_visible(looked, clusters, layers, soup.triangle_counts, -1)
    seen_mesh.look_at_all(looked)
    expected, polygon = np.zeros(len(soup.drawables), np.bool_), np.empty((4, 2))
    for c, d in enumerate(soup.cluster_drawable):
        box_lo, box_hi = ((box[c] - looked.centre) / looked.half for box in (soup.cluster_lo, soup.cluster_hi))
        if not looked.active[d] or occludees.box_hidden(box_lo, box_hi, layers, False):
            continue
        for t in range(soup.cluster_start[c], soup.cluster_start[c + 1]):
            corners = soup.triangles[t]
            if looked.side[t] != seen_mesh.TURNED and not (
                (looked.side[t] != 0 or not occludees.may_touch(looked.q, *corners))
                and occludees.triangle_hidden(looked.q, *corners, layers, polygon)
            ):
                expected[d] = True
    assert found.tolist() == expected.tolist()
    total = int(soup.triangle_counts[found].sum())
    for most in (total - 1, total):
        again = occludees.find_visible(looked, clusters, layers, soup.triangle_counts, most)
        assert (soup.triangle_counts[again].sum() > most) == (total > most)


@pytest.mark.parametrize("seed", range(6))
def test_item_buffers_show_what_rays_through_their_pixels_meet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    soup = soup_of(rooms(rng, 3), bool(seed % 2))
    drawn = rng.random(len(soup.drawables)) < 0.9
    lo, hi = some_cell(rng)
    looked, clusters = seen_by(soup, np.arange(len(drawn)), lo, hi)
    eye = rng.uniform(-1, 1, 3)
    triangle, pixel = np.empty(len(drawn), np.int32), np.empty(len(drawn), np.int32)
    item_buffer.see(looked, clusters, drawn, eye, R, triangle, pixel)
    scene, tree = ray_tree.build_scene(
        soup.vertices, soup.triangles, soup.triangle_drawable, soup.one_sided, soup.cluster_start
    )
    scene = ray_tree.prune(scene, tree, np.flatnonzero(drawn))
    work, stack = np.empty(3), np.empty(ray_tree.STACK, np.int32)
    met = np.full(6 * R * R, -1)
    for at in range(len(met)):
        face, j, i = at // (R * R), at // R % R, at % R
        direction = np.empty(3)
        direction[face // 2] = -1.0 if face % 2 else 1.0
        direction[(face // 2 + 1) % 3], direction[(face // 2 + 2) % 3] = (np.array([i, j]) + 0.5) / R * 2 - 1
        start = looked.centre + eye * looked.half
        t, _ = ray_tree.find_first(scene, start, direction * looked.half, work, stack)
        met[at] = soup.triangle_drawable[t] if t >= 0 else -1
    seen = np.flatnonzero(triangle >= 0)
    assert set(seen) == set(met) - {-1}
    assert (soup.triangle_drawable[triangle[seen]] == seen).all()
    assert (met[pixel[seen]] == seen).all()


def test_a_mesh_knows_sides_and_places_of_what_was_looked_at_in_the_present_cell() -> None:
    rng = np.random.default_rng(1)
    soup = soup_of(rooms(rng, 2), one_sided=True)
    looked, _ = seen_by(soup, np.arange(len(soup.drawables)), *some_cell(rng))
    for _ in range(4):
        places = np.flatnonzero(rng.random(len(soup.drawables)) < 0.5)
        lo, hi = some_cell(rng)
        seen_mesh.begin(looked, places, 0.5 * (lo + hi), 0.5 * (hi - lo))
        assert (looked.side == seen_mesh.UNKNOWN).all()
        corners = soup.vertices[soup.triangles].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        eyes = np.array([[(lo, hi)[bit >> k & 1][k] for k in range(3)] for bit in range(8)])
        above = ((eyes[:, None] - corners[None, :, 0]) * normal).sum(axis=2)
        side = (above > 0).all(axis=0).astype(int) + seen_mesh.TURNED * (above < 0).all(axis=0)
        active = np.isin(soup.triangle_drawable, places)
        for t in rng.permutation(len(side))[: len(side) // 2]:
            found = seen_mesh.look(looked, t)
            assert found == looked.side[t] == (side[t] if active[t] else 0)
            if active[t]:
                assert np.allclose(looked.q[soup.triangles[t]] * looked.half + looked.centre, corners[t])
        assert (looked.side == seen_mesh.UNKNOWN).sum() == len(side) - len(side) // 2


def test_a_cell_in_a_closed_room_looks_at_little_of_the_model() -> None:
    shares = []
    for per_side in (3, 9):
        soup = soup_of(rooms(np.random.default_rng(2), per_side))
        engine = Engine(soup, EngineSettings(resolution=64))
        middle = 4000.0 * (per_side // 2) + np.array([1500.0, 1500.0])
        lo = np.array([*middle, 1500.0])
        for most in (None, int(soup.triangle_counts.sum()) - 1):
            assert engine.visible_from(lo, lo + 100, soup.drawables, most) is not None
            shares.append(int(engine._mesh.looked_count[0]))
    assert shares[2] < 2.5 * shares[0]
    assert shares[3] < 2.5 * shares[1]
    assert max(shares) < 0.4 * len(soup.triangles)


@pytest.mark.parametrize("seal", [0.0, 40.0])
def test_an_engine_finds_the_same_after_any_number_of_cells(seal: float) -> None:
    rng = np.random.default_rng(3)
    soup = soup_of(rooms(rng, 3), seal=seal)
    settings = replace(EngineSettings(resolution=32), seal=seal)
    engine = Engine(soup, settings)
    for number in range(6):
        lo, hi = some_cell(rng)
        cut = np.flatnonzero(rng.random(len(soup.drawables)) < 0.7)
        if number == 4:
            engine._occluders.epoch[0] = occluders.MOST_EPOCHS + 1  # so many floods later
        found, alone = (each.visible_from(lo, hi, cut) for each in (engine, Engine(soup, settings)))
        assert found is not None
        assert alone is not None
        assert found.visible.tolist() == alone.visible.tolist()
        assert found.proven.tolist() == alone.proven.tolist()
        if number == 4:
            assert engine._occluders.epoch[0] < occluders.MOST_EPOCHS
