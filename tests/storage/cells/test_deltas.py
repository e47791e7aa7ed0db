from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from storage.cells.deltas import Delta, apply, apply_chain, difference
from storage.cells.octree import neighbours
from storage.cells.spanning_forest import LONGEST_CHAIN, spanning_forest
from tests.storage.cells.naive_forest import naive_forest
from tests.storage.strategies import id_sets, leaf_sets

SETS = id_sets(largest=80)


@given(SETS, SETS)
def test_a_difference_leads_from_one_set_to_the_other_and_back(a: np.ndarray, b: np.ndarray) -> None:
    delta = difference(a, b)
    assert set(delta.added) == set(b) - set(a)
    assert set(delta.dropped) == set(a) - set(b)
    assert np.array_equal(apply(a, delta), b)
    assert np.array_equal(apply(b, delta.reversed()), a)


@given(st.lists(SETS, min_size=1, max_size=6))
def test_a_chain_of_deltas_is_applied_at_once(chain: list[np.ndarray]) -> None:
    lists = [chain[0]]
    for before, after in pairwise(chain):
        lists += difference(before, after)
    assert np.array_equal(apply_chain(lists), chain[-1])


def test_changes_that_do_not_fit_are_refused() -> None:
    ids, none = np.array([1, 2], np.uint32), np.zeros(0, np.uint32)
    with pytest.raises(ValueError, match="drops"):
        apply(ids, Delta(none, np.array([3], np.uint32)))
    with pytest.raises(ValueError, match="adds"):
        apply(ids, Delta(np.array([2], np.uint32), none))


def _steps(parents: np.ndarray, cell: int) -> int:
    steps = 0
    while parents[cell] >= 0:
        cell, steps = int(parents[cell]), steps + 1
        assert steps <= len(parents)
    return steps


@given(leaf_sets(splits=6), st.integers(1, 4))
def test_a_forest_reaches_all_cells_in_few_steps(keys: np.ndarray, longest: int) -> None:
    pairs, _ = neighbours(keys)
    parents = spanning_forest(len(keys), pairs, longest)
    faces = {tuple(pair) for pair in pairs.tolist()}
    for cell, above in enumerate(parents.tolist()):
        assert above == -1 or (min(cell, above), max(cell, above)) in faces
        assert _steps(parents, cell) <= longest


@given(leaf_sets(splits=6))
def test_with_long_chains_each_connected_part_has_one_root(keys: np.ndarray) -> None:
    pairs, _ = neighbours(keys)
    parents = spanning_forest(len(keys), pairs, len(keys))
    beside: dict[int, list[int]] = {cell: [] for cell in range(len(keys))}
    for a, b in pairs.tolist():
        beside[a].append(b)
        beside[b].append(a)
    seen: set[int] = set()
    islands = 0
    for cell in beside:
        if cell not in seen:
            islands += 1
            queue = deque([cell])
            while queue:
                at = queue.popleft()
                if at not in seen:
                    seen.add(at)
                    queue.extend(beside[at])
    assert (parents < 0).sum() == islands


def test_a_long_row_has_several_roots() -> None:
    count = 200
    pairs = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    parents = spanning_forest(count, pairs)
    assert max(_steps(parents, cell) for cell in range(count)) <= LONGEST_CHAIN
    assert (parents < 0).sum() <= 2 * count / LONGEST_CHAIN


@st.composite
def graphs(draw: st.DrawFn) -> tuple[int, np.ndarray]:
    """Cells and pairs of them: blocks of a grid, rows and rings, and any pairs at all; several parts, some lonely."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(["any", "ring", "block"]))
    count = draw(st.integers(0, 150))
    if kind == "any" and count:
        pairs = random.integers(0, count, (draw(st.integers(0, 3 * count)), 2))
    elif kind == "ring" and count:
        pairs = np.stack([np.arange(count), np.roll(np.arange(count), 1)], axis=1)
    else:
        shape = draw(st.tuples(st.integers(1, 12), st.integers(1, 12), st.integers(1, 4)))
        numbers = np.arange(np.prod(shape)).reshape(shape)
        count = numbers.size
        along = [(numbers.take(range(n - 1), a), numbers.take(range(1, n), a)) for a, n in enumerate(shape)]
        pairs = np.concatenate([np.stack([low.ravel(), high.ravel()], axis=1) for low, high in along])
    if draw(st.booleans()):
        pairs = random.permutation(count)[pairs]
    return count, pairs[random.random(len(pairs)) < draw(st.sampled_from([0.7, 0.95, 1.0]))]


@settings(max_examples=300)
@given(graphs(), st.integers(1, 20))
def test_the_forest_is_that_of_plain_sweeps(graph: tuple[int, np.ndarray], longest: int) -> None:
    """Which decides the bytes of cell shards."""
    assert np.array_equal(spanning_forest(*graph, longest), naive_forest(*graph, longest))


def test_the_forest_does_not_depend_on_the_order_of_pairs() -> None:
    pairs, _ = neighbours(np.arange(64, 128, dtype=np.uint64))
    shuffled = np.random.default_rng(0).permutation(pairs)
    assert np.array_equal(spanning_forest(64, pairs), spanning_forest(64, shuffled))
