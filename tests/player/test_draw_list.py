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
    DrawTables,
    build,
    draw_tables,
    merged_runs,
)
from player.renderer.surfaces import draw_calls
from storage.store import Store


def _tables(rng: np.random.Generator, drawables: int, meshes: int, packs: int) -> DrawTables:
    geometry = rng.integers(0, meshes, drawables)
    record = np.zeros(drawables, RECORD)
    record["placement"] = np.where(rng.random(drawables) < 0.5, 0, rng.integers(1, 9, drawables))
    record["tint"] = rng.integers(0, 2, (drawables, 1)) * (1, 2, 3, 255)
    return DrawTables(
        geometry=geometry,
        record=record,
        side=rng.integers(0, 3, drawables).astype(np.uint8),
        triangles=rng.integers(1, 9, drawables),
        pack=rng.integers(0, packs, meshes),
        first_index=rng.integers(0, 50, meshes) * 3,
        indices=rng.integers(1, 9, meshes) * 3,
    )


@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_every_drawable_is_drawn_once_with_its_placement_and_tint(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    tables = _tables(rng, 40, 12, 5)
    slab_of = rng.integers(0, 2, 5).astype(np.int32)
    first_index = rng.integers(0, 100, 5) * 3
    ids = np.sort(rng.choice(40, count, replace=False)).astype(np.int64)
    draws = build(ids, tables, slab_of, first_index)
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
    assert draws.triangles == tables.triangles[ids].sum()
    singles = sorted(
        (slab, side, triangle, record.tobytes())
        for slab, side, first, indices, instances, base in draw_calls(draws)
        for record in draws.records[base : base + instances]
        for triangle in range(first, first + indices, 3)
    )
    assert singles == sorted((s, c, t, r) for s, c, f, n, r in expected for t in range(f, f + n, 3))


def test_instances_of_a_mesh_are_one_command(room: Store) -> None:
    tables = draw_tables(room.drawables, room.geometry, room.instances)
    chairs = np.flatnonzero((room.drawables["instance"] >= 0) & (room.drawables["level"] == 0))
    draws = build(chairs, tables, np.zeros(len(room.packs), np.int32), np.zeros(len(room.packs), np.int64))
    assert sorted(draws.commands["instances"].tolist()) == [1, 5]  # the mirrored one is drawn apart
    assert {batch.side for batch in draws.batches} == {FRONT_ONLY, BACK_ONLY}


def test_two_sided_drawables_are_not_culled(room: Store) -> None:
    drawables = room.drawables.copy()
    drawables["one_sided"] = False
    assert set(draw_tables(drawables, room.geometry, room.instances).side.tolist()) == {BOTH_SIDES}


def test_a_drawable_whose_pack_is_absent_is_refused(room: Store) -> None:
    tables = draw_tables(room.drawables, room.geometry, room.instances)
    with pytest.raises(ValueError, match="not in the arena"):
        build(np.array([0]), tables, np.full(len(room.packs), -1, np.int32), np.zeros(len(room.packs), np.int64))


def test_neighbouring_meshes_are_one_run() -> None:
    commands = np.zeros(4, COMMAND)
    commands["first_index"] = [0, 6, 9, 30]
    commands["indices"] = [6, 3, 12, 3]
    assert merged_runs(commands).tolist() == [[0, 21], [30, 3]]
    assert merged_runs(commands[:0]).tolist() == []
