"""Draw commands: together they draw exactly the drawables asked for, in an order that does not depend on the others."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from player.renderer.draw_list import (
    BACK_ONLY,
    BOTH_SIDES,
    COMMAND,
    FRONT_ONLY,
    RECORD,
    DrawList,
    DrawTables,
    build,
    build_parted,
    draw_tables,
    merged_runs,
)
from player.renderer.facet_table import CellBox, FacetTable, FacetUsers, PackFacets
from player.renderer.surfaces import draw_calls
from storage.meshes.facets import CONE, part_meshes
from storage.store import Store


def _tables(rng: np.random.Generator, drawables: int, meshes: int, packs: int) -> DrawTables:
    geometry = rng.integers(0, meshes, drawables)
    indices, pack = rng.integers(1, 9, meshes) * 3, rng.integers(0, packs, meshes)
    record = np.zeros(drawables, RECORD)
    record["placement"] = np.where(rng.random(drawables) < 0.5, 0, rng.integers(1, 9, drawables))
    record["tint"] = rng.integers(0, 2, (drawables, 1)) * (1, 2, 3, 255)
    return DrawTables(
        geometry=geometry,
        record=record,
        side=rng.integers(0, 3, drawables).astype(np.uint8),
        see_through=rng.random(drawables) < 0.3,
        pack=pack,
        first_index=rng.integers(0, 50, meshes) * 3,
        indices=indices,
        facets=FacetUsers(geometry, np.full(drawables, -1), np.ones(meshes), np.zeros((0, 3, 4)), 1.0),
    )


@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_every_drawable_is_drawn_once_with_its_placement_and_tint(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    tables = _tables(rng, 40, 12, 5)
    slab_of = rng.integers(0, 2, 5).astype(np.int32)
    first_index = rng.integers(0, 100, 5) * 3
    ids = np.sort(rng.choice(40, count, replace=False)).astype(np.int64)
    draws = build(ids, tables, slab_of, first_index, FacetTable(12), None)
    expected = sorted(
        (
            int(slab_of[tables.pack[g]]),
            int(tables.side[d]),
            int(first_index[tables.pack[g]] + tables.first_index[g]),
            int(tables.indices[g]),
            tables.record[d].tobytes(),
        )
        for d in ids
        for g in [tables.geometry[d]]
    )
    found = sorted(
        (batch.slab, batch.side, int(c["first_index"]), int(c["indices"]), record.tobytes())
        for batch in draws.batches
        for c in draws.commands[batch.first : batch.first + batch.commands]
        for record in draws.records[c["base_instance"] : c["base_instance"] + c["instances"]]
    )
    assert found == expected
    assert draws.drawables == count
    assert 3 * draws.triangles == tables.indices[tables.geometry[ids]].sum()
    singles = sorted(
        (slab, side, triangle, record.tobytes())
        for slab, side, first, indices, instances, base in draw_calls(draws)
        for record in draws.records[base : base + instances]
        for triangle in range(first, first + indices, 3)
    )
    assert singles == sorted((s, c, t, r) for s, c, f, n, r in expected for t in range(f, f + n, 3))


@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_opaque_and_see_through_are_parted(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    tables = _tables(rng, 40, 12, 5)
    arena = np.zeros(5, np.int32), np.zeros(5, np.int64), FacetTable(12), None
    ids = np.sort(rng.choice(40, count, replace=False)).astype(np.int64)
    parted, through = build_parted(ids, tables, *arena), tables.see_through[ids]
    for found, some in ((parted.opaque, ids[~through]), (parted.see_through, ids[through])):
        if found is None:
            assert not len(some)
            continue
        expected = build(some, tables, *arena)
        assert np.array_equal(found.commands, expected.commands)
        assert np.array_equal(found.records, expected.records)
        assert found.batches == expected.batches
    whole = build(ids, tables, *arena)
    assert (parted.triangles, parted.drawables, parted.turned) == (whole.triangles, whole.drawables, whole.turned)


def test_both_sides_of_what_can_be_seen_through_are_drawn(room: Store) -> None:
    drawables = room.drawables.copy()
    drawables["see_through"][::2] = True
    tables = draw_tables(drawables, room.geometry, room.instances, room.grid.step)
    assert (tables.side[::2] == BOTH_SIDES).all()
    assert (tables.side[1::2] != BOTH_SIDES).any()
    assert np.array_equal(tables.see_through, drawables["see_through"])


def _one_after_the_other(store: Store) -> tuple[np.ndarray, np.ndarray, FacetTable]:
    """An arena's tables: all packs in one slab, the later ones first; and their facets, in the order of the packs."""
    sizes = 3 * store.packs["triangles"].astype(np.int64)
    facets = FacetTable(len(store.geometry))
    for number in range(len(store.packs)):
        meshes = np.flatnonzero(store.geometry["pack"] == number)
        meshes = meshes[np.argsort(store.geometry["vertex_start"][meshes], kind="stable")]
        pack, rows = store.pack(number), store.geometry[meshes]
        counts = (rows[name].astype(np.int64) for name in ("vertices", "triangles"))
        _, *found = part_meshes(pack.positions, pack.triangles, *counts, store.one_sided[meshes])
        facets.add(number, meshes, PackFacets(*found))
    return np.zeros(len(store.packs), np.int32), np.cumsum(sizes[::-1])[::-1] - sizes, facets


def _drawn(draws: DrawList) -> set[tuple[bytes, int]]:
    """Every triangle drawn, by its first index, with the placement; and none of them is drawn twice."""
    found = [
        (record.tobytes(), triangle)
        for command in draws.commands
        for record in draws.records[command["base_instance"] :][: command["instances"]]
        for triangle in range(command["first_index"], command["first_index"] + command["indices"], 3)
    ]
    assert len(set(found)) == len(found) == draws.triangles
    return set(found)


def test_what_a_cell_sees_from_behind_is_left_out_and_nothing_else(room: Store) -> None:
    """Against the store's own word, triangle by triangle; instances that show different sides share what they can."""
    tables = draw_tables(room.drawables, room.geometry, room.instances, room.grid.step)
    arena = _one_after_the_other(room)
    left_out = 0
    for number in range(0, len(room.cells), 7):
        cell, ids = room.cells[number], room.vlod(number)
        draws = build(ids, tables, *arena, CellBox(cell["lo"], cell["hi"]))
        turned = room.facets(ids).turned_away(ids, cell["lo"], cell["hi"])
        first_of = np.append(0, np.cumsum(turned.triangles))
        expected = set()
        for place, drawable in enumerate(ids.tolist()):
            mesh = room.geometry[room.drawables["geometry"][drawable]]
            first = int(arena[1][mesh["pack"]]) + 3 * int(mesh["triangle_start"])
            begin = turned.starts[place]
            count = (np.append(turned.starts, len(turned.away))[1:] - turned.starts)[place]
            for facet in range(begin, begin + count):
                if not turned.away[facet]:
                    run = first + 3 * (np.arange(*first_of[facet : facet + 2]) - first_of[begin])
                    expected |= {(tables.record[drawable].tobytes(), index) for index in run.tolist()}
        assert _drawn(draws) == expected
        assert draws.turned == cell["turned_triangles"] == turned.triangle_counts.sum()
        assert draws.drawables == (turned.triangle_counts < room.drawables["triangles"][ids]).sum()
        left_out += draws.turned
    assert left_out > 0
    assert len(_drawn(build(ids, tables, *arena, None))) == room.drawables["triangles"][ids].sum()


def test_facets_survive_growth_and_removal() -> None:
    rng = np.random.default_rng(3)
    table = FacetTable(120)
    packs = {}
    for number in range(60):
        counts = rng.integers(0, 90, 2)
        triangles = rng.integers(1, 99, counts.sum())
        packs[number] = PackFacets(counts, triangles, np.repeat(triangles[:, None], CONE, axis=1).astype(np.float64))
    for number, facets in packs.items():
        table.add(number, np.array([number, 60 + number]), facets)
    for number in range(0, 60, 3):
        table.remove(number)
        assert (table.first[[number, 60 + number]] == -1).all()
    for number in range(0, 60, 3):
        table.add(number, np.array([number, 60 + number]), packs[number])
    for number, facets in packs.items():
        meshes = np.array([number, 60 + number])
        rows = np.concatenate([table.first[mesh] + np.arange(table.count[mesh]) for mesh in meshes])
        assert np.array_equal(table.count[meshes], facets.counts)
        assert np.array_equal(table.triangles[rows], facets.triangles)
        assert np.array_equal(table.cones[rows], facets.cones)


def test_instances_of_a_mesh_are_one_command(room: Store) -> None:
    tables = draw_tables(room.drawables, room.geometry, room.instances, room.grid.step)
    chairs = np.flatnonzero((room.drawables["instance"] >= 0) & (room.drawables["level"] == 0))
    draws = build(chairs, tables, *_one_after_the_other(room), None)
    assert sorted(draws.commands["instances"].tolist()) == [1, 5]  # the mirrored one is drawn apart
    assert {batch.side for batch in draws.batches} == {FRONT_ONLY, BACK_ONLY}


def test_two_sided_drawables_are_not_culled(room: Store) -> None:
    drawables = room.drawables.copy()
    drawables["one_sided"] = False
    assert set(draw_tables(drawables, room.geometry, room.instances, room.grid.step).side.tolist()) == {BOTH_SIDES}


def test_a_drawable_whose_pack_is_absent_is_refused(room: Store) -> None:
    tables = draw_tables(room.drawables, room.geometry, room.instances, room.grid.step)
    _, first_index, facets = _one_after_the_other(room)
    with pytest.raises(ValueError, match="not in the arena"):
        build(np.array([0]), tables, np.full(len(room.packs), -1, np.int32), first_index, facets, None)


def test_neighbouring_meshes_are_one_run() -> None:
    commands = np.zeros(4, COMMAND)
    commands["first_index"] = [0, 6, 9, 30]
    commands["indices"] = [6, 3, 12, 3]
    assert merged_runs(commands).tolist() == [[0, 21], [30, 3]]
    assert merged_runs(commands[:0]).tolist() == []
