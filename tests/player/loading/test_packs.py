"""What reaches the GPU is what the store holds: whole grid coordinates, normals, colours."""

from __future__ import annotations

import moderngl
import numpy as np

from player.loading.packs import Packs, prepare
from player.renderer.arena import Arena
from player.renderer.facet_table import FacetTable
from player.renderer.instances import records, split
from storage.meshes.normals import from_octahedral
from storage.store import Store


def test_normals_are_the_stores_own_code(room: Store) -> None:
    for drawable in np.flatnonzero(room.drawables["instance"] < 0):
        geometry = room.geometry[room.drawables["geometry"][drawable]]
        of_pack = room.geometry["pack"] == geometry["pack"]
        ready = prepare(room.pack(int(geometry["pack"])), room.geometry[of_pack], room.one_sided[of_pack], 1.0)
        own = slice(geometry["vertex_start"], geometry["vertex_start"] + geometry["vertices"])
        unfolded = from_octahedral(ready.vertices["normal"][own].astype(np.int32))
        assert np.array_equal(unfolded, room.mesh(int(drawable)).normals)


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
