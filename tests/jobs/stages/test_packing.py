"""Meshes in the packs of a finished store: the same meshes as the levels' tasks wrote, in another sequence."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from jobs.ordering.packing import PACK_FROM, PACK_MOST, SHARD_FROM, SHARD_MOST, pack_starts, shard_starts
from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from jobs.running.workplace import Workplace
from jobs.stages import tables
from jobs.stages.packing import order
from jobs.stages.packing.order import marks_of_meshes, sequence_of_meshes
from jobs.stages.support.written_geometry import open_drafted
from storage import open_store
from storage.geometry_reader import Geometry
from storage.geometry_writer import mesh_bytes
from storage.store import Store

PARAMETERS = BuildParameters(triangles_per_cell=3000, max_depth=2, quality="draft")


class Built(NamedTuple):
    """A finished store, the geometry as it was before, and where all lies."""

    store: Store
    drafted: Geometry
    root: Path


@pytest.fixture(scope="module")
def both(small_plant, tmp_path_factory):
    folder = tmp_path_factory.mktemp("packs")
    build([small_plant], folder / "store", PARAMETERS, SerialExecutor())
    place = Workplace(folder / "store" / "work", folder / "store")
    (key,) = (path.name for path in (place.work / tables.STAGE.name).iterdir())
    store = open_store(folder / "store")
    return Built(store, open_drafted(place, tables.STAGE.name, key), folder / "store")


def test_every_mesh_is_the_same_in_its_new_place(both):
    store, drafted, _ = both
    assert len(store.geometry) == len(drafted.geometry)
    for number in range(len(store.geometry)):
        new, old = store.packed_mesh(number), drafted.packed_mesh(number)
        for name, one, other in zip(old._fields, new, old, strict=True):
            if name == "source_faces" and other is None:  # it may now share a pack with one that has some
                assert one is None or not one.any()
            else:
                assert np.array_equal(one, other), (number, name)
    for mine, theirs in ((store.nodes, drafted.nodes), (store.drawables, drafted.drawables)):
        assert np.array_equal(mine, theirs)
    assert store.part_names == drafted.part_names


def test_only_what_the_manifest_names_lies_in_the_store(both):
    store, _, root = both
    named = {shard.name for _, shard in store.manifest.shards()}
    assert {path.name for path in (root / "shards").iterdir()} == named


def test_what_is_seen_comes_first_and_fills_its_packs(both):
    store, drafted, _ = both
    seen = np.zeros(len(store.drawables), np.bool_)
    for cell in np.flatnonzero(store.cells["computed"]):
        seen[store.vlod(cell)] = True
    wanted = np.zeros(len(store.geometry), np.bool_)
    wanted[store.drawables["geometry"][seen]] = True
    place = np.lexsort((store.geometry["vertex_start"], store.geometry["pack"]))
    assert wanted[place[: wanted.sum()]].all()

    def read(geometry) -> int:
        sizes = mesh_bytes(geometry.packs["vertices"], geometry.packs["triangles"])
        needed = [
            np.unique(geometry.geometry["pack"][geometry.drawables["geometry"][store.vlod(cell)]])
            for cell in np.flatnonzero(store.cells["computed"])
        ]
        return sum(int(sizes[packs].sum()) for packs in needed)

    assert read(store) < 0.9 * read(drafted)


def test_a_mesh_of_several_drawables_stands_where_the_first_of_them_does(both):
    _, drafted, _ = both
    seen = np.zeros(len(drafted.drawables), np.bool_)
    seen[[5, 9, 2]] = True
    tour = np.concatenate([[9, 5], np.setdiff1d(np.arange(len(seen)), [9, 5])])
    sequence = sequence_of_meshes(drafted, tour, seen)
    assert sorted(sequence.tolist()) == list(range(len(drafted.geometry)))
    expected = list(dict.fromkeys(drafted.drawables["geometry"][[9, 5, 2]].tolist()))
    assert sequence[: len(expected)].tolist() == expected
    rest = drafted.geometry["pack"][sequence[len(expected) :]].astype(np.int64)
    assert (np.diff(rest) >= 0).all()


def test_marks_follow_from_the_mesh_alone(both):
    store, drafted, _ = both
    marks = marks_of_meshes(drafted)
    assert np.array_equal(marks_of_meshes(store), marks)
    assert len(np.unique(marks)) > 0.9 * len(marks)


def test_packs_and_shards_keep_within_their_bounds():
    random = np.random.default_rng(0)
    sizes = random.integers(100, 20_000, 20_000)
    marks = random.integers(0, 2**63, 20_000).astype(np.uint64)
    starts = pack_starts(sizes, marks)
    assert starts[0] == 0
    assert starts[-1] == len(sizes)
    filled = np.add.reduceat(sizes, starts[:-1])
    assert (filled[:-1] >= PACK_FROM).all()
    assert (filled < PACK_MOST + sizes.max()).all()
    first = shard_starts(marks[starts[:-1]])
    assert first[0] == 0
    assert first[-1] == len(starts) - 1
    assert (np.diff(first)[:-1] >= SHARD_FROM).all()
    assert (np.diff(first) <= SHARD_MOST).all()
    assert pack_starts(sizes[:0], marks[:0]).tolist() == [0]


def test_packs_become_the_same_again_behind_a_change():
    random = np.random.default_rng(1)
    sizes = random.integers(100, 20_000, 20_000)
    marks = random.integers(0, 2**63, 20_000).astype(np.uint64)
    before = pack_starts(sizes, marks)
    after = pack_starts(np.insert(sizes, 500, [900, 4000]), np.insert(marks, 500, np.array([7, 9], np.uint64)))
    kept = np.intersect1d(before[before > 500] + 2, after)
    assert len(kept) > 0.98 * (before > 500).sum()
    shards_before = before[shard_starts(marks[before[:-1]])[:-1]]
    marks_after = np.insert(marks, 500, np.array([7, 9], np.uint64))
    shards_after = after[shard_starts(marks_after[after[:-1]])[:-1]]
    assert len(np.intersect1d(shards_before + 2, shards_after)) > 0.5 * len(shards_before)


def test_the_sequence_is_kept_with_the_work(both):
    store, _, root = both
    (folder,) = (root / "work" / order.STAGE.name).iterdir()
    sequence = np.load(folder / order.SEQUENCE)
    place = np.lexsort((store.geometry["vertex_start"], store.geometry["pack"]))
    assert np.array_equal(sequence, place)
