import gc
import threading
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from storage import open_store
from storage.base.errors import NotComputedError, ParameterError, StoreNotFoundError
from storage.cells.deltas import apply
from storage.cells.octree import neighbours
from storage.geometry_reader import open_geometry
from storage.meshes.placement import transform_points
from storage.store import Store
from tests.storage.strategies import leaf_sets
from tests.storage.tiny_store import TinyPart, box_part, make_geometry, make_store, room_parts


def _some(seed: int = 0):
    """A vLOD for each cell: a random part of its cut, the same for the same cell."""

    def visible(geometry, cell, cut):
        random = np.random.default_rng([seed, int(cell["key"])])
        return cut[random.random(len(cut)) < 0.6]

    return visible


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return make_store(tmp_path_factory.mktemp("store"), room_parts(), visible=_some())


def test_every_position_lies_on_the_grid(store: Store) -> None:
    for drawable in range(len(store.drawables)):
        mesh = store.mesh(drawable)
        steps = mesh.positions.astype(np.float64) / store.grid.step
        assert np.array_equal(steps, np.rint(steps))
        assert mesh.positions.dtype == np.float32
        assert mesh.triangles.dtype == np.uint32


def test_instances_are_placed_and_snapped(store: Store) -> None:
    for drawable in np.flatnonzero(store.drawables["instance"] >= 0).tolist():
        row = store.drawables[drawable]
        local = store.local_mesh(int(row["geometry"]))
        matrix = store.instances[row["instance"]]["matrix"]
        placed = transform_points(matrix, local.positions * local.scale)
        assert np.array_equal(store.mesh(drawable).positions, np.rint(placed / store.grid.step) * store.grid.step)


def test_winding_and_normals_agree_even_where_mirrored(store: Store) -> None:
    assert (np.linalg.det(store.instances["matrix"][:, :, :3]) < 0).any()
    for drawable in range(len(store.drawables)):
        mesh = store.mesh(drawable)
        a, b, c = (mesh.positions.astype(float)[mesh.triangles[:, corner]] for corner in range(3))
        across = np.cross(b - a, c - a)
        across /= np.linalg.norm(across, axis=1)[:, None]
        for corner in range(3):
            assert (np.sum(across * mesh.normals[mesh.triangles[:, corner]], axis=1) > 0.999).all()


def test_normals_of_stretched_instances_stay_at_right_angles(tmp_path: Path) -> None:
    stretch = np.array([[4.0, 1, 0, 3], [0, 0.5, 0, 1], [0, 0, -2, 2]])
    part = box_part("box", (0, 0, 0), (1, 1, 1), matrices=[stretch, np.eye(4)[:3]])
    store = make_store(tmp_path, [part], depth=0)
    for drawable in range(len(store.drawables)):
        mesh = store.mesh(drawable)
        a, b, c = (mesh.positions.astype(float)[mesh.triangles[:, corner]] for corner in range(3))
        across = np.cross(b - a, c - a)
        across /= np.linalg.norm(across, axis=1)[:, None]
        assert (np.sum(across * mesh.normals[mesh.triangles[:, 0]], axis=1) > 0.999).all()


@pytest.mark.parametrize("at_once", [1, 5, 4096])
def test_surfaces_are_the_meshes_one_after_the_other(
    store: Store, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("storage.geometry_reader.SURFACES_AT_ONCE", at_once)
    ids = np.arange(len(store.drawables))[::-2]
    found = store.surfaces(ids)
    assert found.points.dtype == np.int32
    vertex, triangle = 0, 0
    for place, drawable in enumerate(ids.tolist()):
        mesh = store.mesh(drawable)
        n, m = found.vertex_counts[place], found.triangle_counts[place]
        assert np.array_equal(found.points[vertex : vertex + n] * store.grid.step, mesh.positions)
        assert np.array_equal(found.triangles[triangle : triangle + m] - vertex, mesh.triangles)
        vertex, triangle = vertex + n, triangle + m
    assert (vertex, triangle) == (len(found.points), len(found.triangles))


def test_surfaces_of_nothing(store: Store) -> None:
    found = store.surfaces(np.zeros(0, np.int64))
    assert found.points.shape == (0, 3)
    assert found.triangles.shape == (0, 3)


def test_boxes_hold_the_meshes(store: Store) -> None:
    for drawable, row in enumerate(store.drawables):
        mesh = store.mesh(drawable)
        assert (mesh.positions >= row["lo"]).all()
        assert (mesh.positions <= row["hi"]).all()


def test_source_faces_are_the_triangles_themselves(store: Store) -> None:
    """The tiny store's parts number their faces as given: compares each stored triangle with the part's own."""
    parts = {part.name: part for part in room_parts()}
    for drawable in np.flatnonzero(store.drawables["level"] == 0).tolist():
        owners, faces = store.source_faces(drawable)
        assert (owners == owners[0]).all()
        part = parts[store.part_names[owners[0]]]
        assert store.names_of(int(store.drawables["node"][drawable])) == [part.name]
        local = store.local_mesh(int(store.drawables[drawable]["geometry"]))
        positions, triangles = part.levels[0]
        stored = np.sort((local.positions * local.scale)[local.triangles].sum(axis=1), axis=0)
        given = np.sort(positions[triangles[faces]].sum(axis=1), axis=0)
        assert np.array_equal(np.sort(faces), np.arange(len(triangles)))
        assert np.allclose(stored, given, atol=4 * store.grid.step)


def test_coarser_levels_have_no_source_faces(store: Store) -> None:
    with pytest.raises(ParameterError, match="only the finest levels of leaves have source faces"):
        store.source_faces(int(np.flatnonzero(store.drawables["level"] == 1)[0]))


def test_nothing_given_out_can_be_changed(store: Store) -> None:
    given = [*store.mesh(0), *store.pack(0), store.drawables, store.cells, store.vlod(0), store.source_faces(0)[1]]
    assert not any(array.flags.writeable for array in given)


def _check_cells(store: Store, seed: int = 0) -> None:
    visible = _some(seed)
    computed = store.cells["computed"]
    sets = {}
    for cell in range(len(store.cells)):
        if computed[cell]:
            cut = store.cut(cell)
            sets[cell] = store.vlod(cell)
            assert np.array_equal(sets[cell], visible(store, store.cells[cell], cut))
            assert len(cut) == len(store.nodes)
        else:
            with pytest.raises(NotComputedError, match="was not computed"):
                store.vlod(cell)
    pairs, _ = neighbours(store.cells["key"])
    faces = {(a, b) for a, b in pairs.tolist() if computed[a] and computed[b]}
    assert sum(len(store.neighbours(cell)) for cell in sets) == 2 * len(faces)
    for cell in sets:
        expected = sorted({b for a, b in faces if a == cell} | {a for a, b in faces if b == cell})
        assert store.neighbours(cell).tolist() == expected
    for a, b in faces:
        assert np.array_equal(apply(sets[a].astype(np.uint32), store.delta(a, b)), sets[b])
        assert np.array_equal(apply(sets[b].astype(np.uint32), store.delta(b, a)), sets[a])


def test_cells_and_deltas(store: Store) -> None:
    _check_cells(store)
    with pytest.raises(ParameterError, match="share no face"):
        store.delta(0, 63)
    with pytest.raises(NotComputedError, match="there is no cell 64"):
        store.vlod(64)
    with pytest.raises(NotComputedError, match="there is no cell -1"):
        store.vlod(-1)


@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(leaf_sets(splits=5), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_cells_of_mixed_depths_with_holes(
    tmp_path_factory: pytest.TempPathFactory, keys: np.ndarray, in_a_shard: int, seed: int
) -> None:
    random = np.random.default_rng(seed)
    uncomputed = np.flatnonzero(random.random(len(keys)) < 0.2).tolist()
    root = tmp_path_factory.mktemp("store")
    parts = room_parts()[4:]
    store = make_store(root, parts, keys=keys, visible=_some(seed), uncomputed=uncomputed, cells_per_shard=in_a_shard)
    _check_cells(store, seed)
    assert not list(store.check())


def test_where_cells_are(store: Store) -> None:
    middles = (store.cells["lo"] + store.cells["hi"]) / 2
    assert np.array_equal(store.cell_at(middles), np.arange(len(store.cells)))
    assert np.array_equal(store.cell_at(store.cells["lo"]), np.arange(len(store.cells)))
    outside = store.cells["hi"].max(axis=0) + 1
    assert store.cell_at([outside, middles[3]]).tolist() == [-1, 3]
    assert store.cell_at(middles[5]).tolist() == [5]
    assert store.cell_at(np.zeros((0, 3))).shape == (0,)


def test_uncomputed_cells_are_nowhere(tmp_path: Path) -> None:
    store = make_store(tmp_path, room_parts()[:1], depth=1, uncomputed=[2])
    middles = (store.cells["lo"] + store.cells["hi"]) / 2
    assert store.cell_at(middles).tolist() == [0, 1, -1, 3, 4, 5, 6, 7]
    with pytest.raises(NotComputedError):
        store.neighbours(2)
    with pytest.raises(NotComputedError):
        store.delta(0, 2)


def test_a_store_without_cells(tmp_path: Path) -> None:
    store = make_store(tmp_path, room_parts()[:1], keys=[])
    assert len(store.cells) == 0
    assert store.cell_at([[0, 0, 0]]).tolist() == [-1]


def test_one_cell_costs_little(tmp_path: Path) -> None:
    """Opening, then one cell: far less than the cells' shards."""
    parts = [
        box_part(f"box {i}", (i % 40, i // 40, 0), (i % 40 + 0.5, i // 40 + 0.5, 1), segments=(1,)) for i in range(4000)
    ]
    make_store(tmp_path, parts, depth=3, visible=_some(), cells_per_shard=512)
    store = open_store(tmp_path)
    opened = store.bytes_fetched
    assert store.vlod(137).size
    one = store.bytes_fetched - opened
    shards = sum(record.bytes for purpose, record in store.manifest.shards() if purpose == "cells")
    assert one < shards / 4
    store.vlod(137)
    assert store.bytes_fetched - opened == one


def test_memory_for_shards_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many shards there are, nothing of them is kept outside the caches' budgets."""
    budget = 3_000
    monkeypatch.setattr("storage.store.CELL_CACHE", budget)
    monkeypatch.setattr("storage.geometry_reader.GEOMETRY_CACHE", budget)
    parts = [box_part(f"box {i}", (i, 0, 0), (i + 0.5, 1, 1), segments=(1,)) for i in range(400)]
    make_store(tmp_path, parts, depth=3, visible=_some(), cells_per_shard=1, codecs=["gap-varint-zstd"])
    store = open_store(tmp_path)
    assert store.manifest.cells is not None
    read = sum(shard.bytes for shard in store.manifest.cells.shards)
    assert read > 20 * budget  # so small that each comes whole with its index
    visible = _some()
    order = np.random.default_rng(0).permutation(512).tolist()
    store.vlod(0)  # kernels are loaded, the hierarchy is in memory
    tracemalloc.start()
    try:
        for cell in order:
            assert np.array_equal(store.vlod(cell), visible(store, store.cells[cell], store.cut(cell)))
        store.bytes_by_kind()
        gc.collect()
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 10 * budget < read / 2


def test_many_threads_read_the_same(store: Store) -> None:
    fresh = open_store(store.files.url)
    expected = [store.vlod(cell) for cell in range(64)]
    meshes = [store.mesh(drawable) for drawable in range(len(store.drawables))]
    failures: list[str] = []

    def work(seed: int) -> None:
        random = np.random.default_rng(seed)
        for _ in range(60):
            cell, drawable = int(random.integers(64)), int(random.integers(len(meshes)))
            if not np.array_equal(fresh.vlod(cell), expected[cell]):
                failures.append(f"cell {cell}")
            if not all(np.array_equal(a, b) for a, b in zip(fresh.mesh(drawable), meshes[drawable], strict=True)):
                failures.append(f"drawable {drawable}")
            fresh.neighbours(cell)
            fresh.cell_at(random.uniform(0, 6, (3, 3)))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []


def test_geometry_without_cells(tmp_path: Path) -> None:
    section, _, _ = make_geometry(tmp_path, room_parts())
    geometry = open_geometry(tmp_path, section)
    assert len(geometry.mesh(0).triangles) == geometry.drawables[0]["triangles"]
    with pytest.raises(StoreNotFoundError, match=r"no manifest.json: not a vLOD store, or its build has not finished"):
        open_store(tmp_path)


def test_older_versions_can_be_opened(tmp_path: Path) -> None:
    make_store(tmp_path, room_parts()[:1], depth=0)
    make_store(tmp_path, room_parts()[:2], depth=0)
    assert len(open_store(tmp_path).parts) == 2
    assert len(open_store(tmp_path, version=1).parts) == 1
    assert not list(open_store(tmp_path, version=1).check())
    with pytest.raises(StoreNotFoundError, match="the store has no version 3"):
        open_store(tmp_path, version=3)


def test_meshes_without_triangles(tmp_path: Path) -> None:
    empty = (np.zeros((0, 3)), np.zeros((0, 3), np.uint32))
    full = box_part("box", (0, 0, 0), (1, 1, 1), segments=(1,)).levels[0]
    store = make_store(tmp_path, [TinyPart("vanishing", [full, empty], [0, 1])], depth=0)
    mesh = store.mesh(1)
    assert mesh.positions.shape == (0, 3)
    assert mesh.triangles.shape == (0, 3)
