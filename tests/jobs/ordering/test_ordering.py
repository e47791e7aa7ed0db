"""Orders of drawables: permutations, the same however the work is shared out, and close to the best there is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.ordering import tour as tour_module
from jobs.ordering.columns import Columns, columns_of_changes
from jobs.ordering.distances import distance, runs, steps
from jobs.ordering.fragments import Fragments
from jobs.ordering.identical import representatives
from jobs.ordering.improvement import improved
from jobs.ordering.insertion import inserted
from jobs.ordering.nearest import Nearest
from jobs.ordering.signatures import mixed
from jobs.ordering.tour import TourOptions, tour

WAYS = (
    TourOptions(),
    TourOptions(improve=False),
    TourOptions(neighbours="sampled"),
    TourOptions(neighbours="sampled", improve=False),
)


def columns_of(dense: np.ndarray) -> Columns:
    """Columns of a matrix (rows, columns) of truth values."""
    return Columns.made(dense.sum(axis=0), np.nonzero(dense.T)[1], len(dense))


def dense_runs(dense: np.ndarray, order: Sequence[int]) -> int:
    """Runs of ones in all rows of a matrix (rows, columns) whose columns stand in an order: counted one by one."""
    return sum(
        int(np.count_nonzero(np.diff(np.concatenate([[0], row[list(order)]])) == 1)) for row in dense.astype(int)
    )


matrices = st.integers(0, 2**32 - 1).map(
    lambda seed: (
        np.random.default_rng(seed).random(
            (np.random.default_rng(seed).integers(1, 30), np.random.default_rng(seed).integers(1, 60))
        )
        < 0.3
    )
)


def rooms(count: int, seed: int = 0, rows: int = 200) -> np.ndarray:
    """A matrix like those of a building: each column holds an interval of rows, with a few flaws."""
    random = np.random.default_rng(seed)
    begin, length = random.integers(0, rows, count), random.integers(3, 40, count)
    at = np.arange(rows)[:, None]
    return ((at >= begin) & (at < begin + length)) ^ (random.random((rows, count)) < 0.01)


@given(matrices, st.sampled_from(WAYS))
@settings(max_examples=60, deadline=None)
def test_every_drawable_has_one_place(dense: np.ndarray, options: TourOptions) -> None:
    order = tour(columns_of(dense), options)
    assert sorted(order.tolist()) == list(range(dense.shape[1]))


@given(matrices)
@settings(max_examples=40, deadline=None)
def test_runs_are_those_of_the_rows(dense: np.ndarray) -> None:
    order = np.random.default_rng(1).permutation(dense.shape[1])
    assert runs(columns_of(dense), order) == dense_runs(dense, order)


@given(matrices)
@settings(max_examples=40, deadline=None)
def test_a_distance_is_the_symmetric_difference_or_at_least_the_limit(dense: np.ndarray) -> None:
    columns = columns_of(dense)
    for one in range(min(dense.shape[1], 5)):
        for other in range(dense.shape[1]):
            truth = int((dense[:, one] != dense[:, other]).sum())
            assert distance(columns.offsets, columns.rows, one, other, 1 << 40) == truth
            for limit in (1, 3, truth, truth + 1):
                found = distance(columns.offsets, columns.rows, one, other, limit)
                assert found == truth if truth < limit else found >= limit


def test_small_tours_are_near_the_best_of_all() -> None:
    excess = []
    for seed in range(12):
        dense = rooms(7, seed, rows=60)
        columns = columns_of(dense)
        best = min(dense_runs(dense, order) for order in permutations(range(7)))
        found = runs(columns, tour(columns))
        assert found >= best
        excess.append(found / best - 1)
    assert np.mean(excess) < 0.03
    assert max(excess) < 0.12


def test_what_is_alike_comes_together() -> None:
    dense = rooms(600)
    columns = columns_of(dense)
    random = runs(columns, np.random.default_rng(0).permutation(600))
    found = {(options.neighbours, options.improve): runs(columns, tour(columns, options)) for options in WAYS}
    assert found["minhash", True] < 0.5 * random
    assert found["minhash", True] <= found["minhash", False]  # an improvement never makes it longer
    assert found["sampled", True] <= found["sampled", False]
    assert found["minhash", True] < found["sampled", False]


def test_columns_that_are_the_same_stand_side_by_side() -> None:
    dense = np.repeat(rooms(80), 3, axis=1)[:, np.random.default_rng(3).permutation(240)]
    columns = columns_of(dense)
    order = tour(columns)
    stands_for = representatives(columns)[order]
    assert np.count_nonzero(np.diff(stands_for)) == len(np.unique(stands_for)) - 1
    for column, first in enumerate(representatives(columns)):
        assert first <= column
        assert (dense[:, column] == dense[:, first]).all()


def test_what_never_changes_comes_last() -> None:
    dense = rooms(50)
    dense[:, ::3] = False
    order = tour(columns_of(dense))
    still = ~dense.any(axis=0)
    assert still[order[-still.sum() :]].all()


@pytest.mark.parametrize(
    "dense", [np.zeros((4, 0), bool), np.zeros((0, 5), bool), np.ones((1, 1), bool), np.ones((3, 9), bool)]
)
def test_degenerate_matrices(dense: np.ndarray) -> None:
    order = tour(columns_of(dense))
    assert sorted(order.tolist()) == list(range(dense.shape[1]))
    again = inserted(columns_of(dense), np.arange(dense.shape[1] // 2))
    assert sorted(again.tolist()) == list(range(dense.shape[1]))


def backwards(work: Callable[[Any], Any], blocks: Sequence[Any]) -> list[Any]:
    """Blocks done in the opposite sequence."""
    return [work(block) for block in reversed(blocks)][::-1]


def test_the_same_order_whoever_does_the_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = columns_of(rooms(1500))
    monkeypatch.setattr(tour_module, "BLOCK", 97)
    monkeypatch.setattr(tour_module, "STRETCH", 256)
    order = tour(columns)
    assert np.array_equal(tour(columns, blockwise=backwards), order)
    with ThreadPoolExecutor(4) as pool:
        assert np.array_equal(tour(columns, blockwise=pool.map), order)
    monkeypatch.setattr(tour_module, "BLOCK", 1000)  # how many are looked at together changes nothing
    assert np.array_equal(tour(columns), order)


def test_improving_a_block_keeps_its_columns_and_never_lengthens_it() -> None:
    columns = columns_of(rooms(120))
    random = np.random.default_rng(5)
    apart = np.array(
        [[distance(columns.offsets, columns.rows, a, b, 1 << 40) for b in range(120)] for a in range(120)], np.int32
    )
    np.fill_diagonal(apart, np.iinfo(np.int32).max)
    order = np.argsort(apart, axis=1, kind="stable")[:, :10]
    near = Nearest(order.astype(np.int32), np.take_along_axis(apart, order, axis=1))
    for begin in (0, 30):
        stretch = np.concatenate([[columns.count if begin == 0 else 7], random.permutation(np.arange(30, 90)), [95]])
        found = improved(columns, near, stretch)
        assert sorted(found.tolist()) == sorted(stretch[1:-1].tolist())
        framed = np.concatenate([stretch[:1], found, stretch[-1:]])
        before = steps(columns.offsets, columns.rows, stretch).sum()
        assert steps(columns.offsets, columns.rows, framed).sum() < 0.7 * before


def test_fragments_close_no_ring_and_leave_two_edges_a_column() -> None:
    fragments = Fragments.single(6)
    members = np.arange(6)
    near = np.array([[1, 2], [2, 0], [0, 1], [4, -1], [3, -1], [-1, -1]], np.int32)  # a triangle, an edge, one alone
    fragments.join(members, near, np.array([[1, 1], [1, 1], [1, 1], [2, 9], [2, 9], [9, 9]], np.int32))
    assert (np.sort(fragments.links[[0, 1, 2]], axis=1) >= 0).sum() == 4  # two edges of the triangle's three
    assert len(np.unique(fragments.groups(members))) == 3


@given(matrices, st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_insertion_keeps_the_sequence_of_those_that_have_one(dense: np.ndarray, seed: int) -> None:
    random = np.random.default_rng(seed)
    count = dense.shape[1]
    former = random.permutation(count)[: random.integers(0, count + 1)]
    order = inserted(columns_of(dense), former)
    assert sorted(order.tolist()) == list(range(count))
    place = np.argsort(order)
    assert (np.diff(place[former]) > 0).all()


def test_insertion_puts_what_is_new_beside_what_is_like_it() -> None:
    dense = rooms(600)
    columns = columns_of(dense)
    whole = tour(columns)
    kept = whole[np.random.default_rng(2).random(600) < 0.9]
    order = inserted(columns, kept)
    appended = np.concatenate([kept, np.setdiff1d(whole, kept)])
    assert runs(columns, order) < 1.06 * runs(columns, whole)
    assert runs(columns, order) < 0.9 * runs(columns, appended)


def test_columns_of_changes() -> None:
    sets = [np.array([0, 2, 5]), np.array([2, 3]), np.zeros(0, np.int64)]
    changes = columns_of_changes(sets, np.array([[0, 1], [1, 2]]), 6)
    assert changes.height == 4
    rows = [changes.rows[changes.offsets[i] : changes.offsets[i + 1]].tolist() for i in range(7)]
    assert rows == [[1], [], [3], [0, 3], [], [1], []]  # the last one is the empty column


def test_random_numbers_are_the_same_on_every_machine() -> None:
    assert mixed(np.arange(3, dtype=np.uint64)).tolist() == [
        0xE220A8397B1DCDAF,
        0x6E789E6AA1B965F4,
        0x06C45D188009454F,
    ]  # SplitMix64 of seed 0
