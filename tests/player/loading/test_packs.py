"""What reaches the GPU is what the store holds: whole grid coordinates, normals, colours."""

from __future__ import annotations

import moderngl
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from player.loading.packs import Packs, octahedral, prepare
from player.renderer.arena import Arena
from player.renderer.facet_table import FacetTable
from player.renderer.instances import records, split
from storage.store import Store


def _decoded(folded: np.ndarray) -> np.ndarray:
    e = folded / 32767
    z = 1 - np.abs(e).sum(axis=1)
    xy = np.where(z[:, None] < 0, (1 - np.abs(e[:, ::-1])) * np.where(e >= 0, 1, -1), e)
    n = np.concatenate([xy, z[:, None]], axis=1)
    return n / np.linalg.norm(n, axis=1)[:, None]


@given(st.integers(0, 2**32 - 1))
def test_normals_survive_folding(seed: int) -> None:
    normals = np.random.default_rng(seed).normal(size=(50, 3))
    normals[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    assert np.abs(_decoded(octahedral(normals.astype(np.float32))) - normals).max() < 1e-4


def test_prepared_vertices_are_the_stores(room: Store) -> None:
    step = room.grid.step
    for drawable in range(len(room.drawables)):
        row = room.drawables[drawable]
        geometry = room.geometry[row["geometry"]]
        number = int(geometry["pack"])
        rows = room.geometry[room.geometry["pack"] == number]
        ready = prepare(room.pack(number), rows, room.one_sided[room.geometry["pack"] == number], step)
        triangles = ready.triangles[geometry["triangle_start"] :][: geometry["triangles"]]
        corners = ready.vertices["position"][triangles].astype(np.float64)
        mesh = room.mesh(drawable)
        expected = mesh.positions[mesh.triangles].astype(np.float64) / step
        if row["instance"] < 0:
            rows_of = [a.reshape(-1, 9)[np.lexsort(a.reshape(-1, 9).T)] for a in (corners, expected)]
            assert np.array_equal(*rows_of)  # in another order: facet by facet
        else:
            record = records(room.instances["matrix"], step)[row["instance"] + 1].astype(np.float64)
            placed = corners @ record[:3, :3].T + record[:3, 3] + record[3, :3]
            order = np.sort(placed.reshape(-1, 3), axis=0) - np.sort(expected.reshape(-1, 3), axis=0)
            assert np.abs(order).max() < 1.5  # snapping, and float32 rotations


def test_positions_far_from_the_origin_split_without_loss() -> None:
    position = np.array([123456.789, -98765.4321, 0.5])
    whole, rest = split(position, 2.0**-6)
    assert np.all(whole == np.rint(whole))
    assert np.abs((whole.astype(float) + rest) * 2.0**-6 - position).max() < 1e-9


def test_packs_come_and_go_within_the_budget(room: Store, context: moderngl.Context) -> None:
    arena = Arena(context, len(room.packs))
    facets = FacetTable(len(room.geometry))
    packs = Packs(room, arena, facets, budget=1, threads=2)
    try:
        everything = np.arange(len(room.packs))
        packs.need(everything, wait=True)
        assert (arena.slab_of >= 0).all()
        assert (facets.first >= 0).all()
        packs.need(everything[:0], wait=True)
        assert (arena.slab_of < 0).all()
        assert (facets.first < 0).all()
        assert packs.cache.bytes == 0
    finally:
        packs.close()
        arena.release()


def test_kept_packs_stay_and_prefetched_ones_fit(room: Store, context: moderngl.Context) -> None:
    arena = Arena(context, len(room.packs))
    packs = Packs(room, arena, FacetTable(len(room.geometry)), budget=1 << 30, threads=2)
    try:
        packs.keep(np.array([0]))
        packs.prefetch(np.arange(len(room.packs)))
        packs.settle()
        assert packs.cache.resident.all()
        assert packs.pending == 0
    finally:
        packs.close()
        arena.release()
