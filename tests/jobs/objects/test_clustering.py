"""Clustering: the near pairs and the forest, against definitions worked out pair by pair."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.objects.clustering import cluster, join_clusters, near_pairs
from jobs.objects.object_options import Clustering
from jobs.objects.tree import build_tree
from storage.base.errors import ParameterError


def boxes(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    lo = rng.uniform(0, 10, (count, 3)) * [1, 1, rng.integers(0, 2)]
    return lo, lo + rng.uniform(0, 1, (count, 3)) ** 3 * 4


def gap(lo: np.ndarray, hi: np.ndarray, i: int, j: int) -> float:
    return float(np.linalg.norm(np.maximum(np.maximum(lo[j] - hi[i], lo[i] - hi[j]), 0)))


def joint(lo: np.ndarray, hi: np.ndarray, group: list[int], thin: float) -> float:
    return float(np.maximum(hi[group].max(axis=0) - lo[group].min(axis=0), thin).prod())


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([1, 3, 60]))
def test_near_pairs_are_the_nearest_ones(seed: int, count: int, neighbours: int) -> None:
    lo, hi = boxes(seed, count)
    kind = np.random.default_rng(seed).integers(0, 2, count)
    tree = build_tree(lo, hi, np.ones(count, np.int64))
    pairs, length, _ = near_pairs(lo, hi, kind, tree, 2.0, neighbours, 0.1, 30.0)
    found = {(int(a), int(b)) for a, b in pairs}
    assert len(found) == len(pairs)
    for (a, b), d in zip(pairs.tolist(), length, strict=True):
        assert a < b
        assert d == pytest.approx(gap(lo, hi, a, b))
    wanted = set()
    for i in range(count):
        ranked = sorted(
            (gap(lo, hi, i, j) ** 2 + 1e-4 * float(((lo[i] + hi[i] - lo[j] - hi[j]) ** 2).sum()) / 4, j)
            for j in range(count)
            if j != i and kind[i] == kind[j] and gap(lo, hi, i, j) < 2 and joint(lo, hi, [i, j], 0.1) <= 30
        )
        wanted |= {(min(i, j), max(i, j)) for _, j in ranked[:neighbours]}
    assert found == wanted


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 50), st.sampled_from([0.0, 0.5, 5.0]))
def test_clusters_are_joined_as_the_paper_says(seed: int, count: int, cardinality: float) -> None:
    lo, hi = boxes(seed, count)
    edges = sorted((gap(lo, hi, i, j), i, j) for i in range(count) for j in range(i) if gap(lo, hi, i, j) < 2)
    pairs = np.array([(j, i) for _, i, j in edges], np.int64).reshape(-1, 2)
    length = np.array([d for d, _, _ in edges])
    found = join_clusters(lo, hi, pairs, length, cardinality, 0.1, 40.0)
    groups: list[tuple[list[int], float]] = [([i], 0.0) for i in range(count)]
    for d, i, j in edges:
        a = next(g for g in groups if i in g[0])
        b = next(g for g in groups if j in g[0])
        internal = min(a[1] + cardinality / len(a[0]), b[1] + cardinality / len(b[0]))
        if a is not b and d <= internal and joint(lo, hi, a[0] + b[0], 0.1) <= 40:
            groups = [g for g in groups if g is not a and g is not b] + [(sorted(a[0] + b[0]), d)]
    expected = np.empty(count, np.int64)
    for members, _ in groups:
        expected[members] = members[0]
    assert found.tolist() == expected.tolist()


def test_kinds_stay_apart_and_some_stay_alone() -> None:
    lo = np.zeros((6, 3)) + np.arange(6)[:, None] * [0.01, 0, 0]
    kind = np.array([0, 1, 0, 1, -1, -1])
    number = cluster(lo, lo + 0.1, kind, Clustering(volume=1.0), np.zeros(3), np.ones(3))
    assert number.tolist() == [0, 1, 0, 1, 2, 3]


def test_what_is_far_or_would_become_large_is_not_joined() -> None:
    lo = np.array([[0, 0, 0], [1, 0, 0], [5, 0, 0], [5.5, 0, 0]], float)
    hi = lo + np.array([0.2, 1, 1])
    kind = np.zeros(4, np.int64)
    bounds = np.zeros(3), np.full(3, 10.0)
    near = Clustering(distance=0.09, volume=0.1)
    assert cluster(lo, hi, kind, near, *bounds).tolist() == [0, 0, 1, 1]
    small = Clustering(distance=0.09, volume=0.001)
    assert cluster(lo, hi, kind, small, *bounds).tolist() == [0, 1, 2, 2]


def test_the_order_of_objects_changes_the_numbers_only() -> None:
    lo, hi = boxes(3, 400)
    kind = np.zeros(400, np.int64)
    bounds = np.zeros(3), np.full(3, 12.0)
    number = cluster(lo, hi, kind, Clustering(volume=0.02), *bounds)
    assert 20 < number.max() < 380
    shuffled = np.random.default_rng(0).permutation(400)
    other = cluster(lo[shuffled], hi[shuffled], kind, Clustering(volume=0.02), *bounds)
    pairs = set(zip(number[shuffled].tolist(), other.tolist(), strict=True))
    assert len(pairs) == number.max() + 1


@pytest.mark.parametrize("wrong", [{"distance": 0}, {"cardinality": -1}, {"volume": -1}, {"neighbours": 0}])
def test_senseless_parameters_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ParameterError, match="positive"):
        Clustering(**wrong)  # type: ignore[arg-type]
