"""The tree over objects, its fragments, and the hierarchy as a whole."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.objects.fragments import plan_fragments
from jobs.objects.hierarchy import MERGED_TRIANGLES, PLACED_PIECE, build_hierarchy
from jobs.objects.object_options import Clustering, ObjectOptions
from jobs.objects.tree import OBJECT_WEIGHT, build_tree


def objects(seed: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    lo = np.round(rng.uniform(0, 10, (count, 3)) * [1, 1, rng.integers(0, 2)], rng.integers(0, 3))
    return lo, lo + rng.uniform(0, 1, (count, 3)), rng.integers(1, 3000, count)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 80))
def test_every_object_is_a_leaf_and_boxes_hold_what_is_below(seed: int, count: int) -> None:
    lo, hi, triangles = objects(seed, count)
    tree = build_tree(lo, hi, triangles)
    assert len(tree.end) == 2 * count - 1
    assert sorted(tree.leaf[tree.leaf >= 0].tolist()) == list(range(count))
    weight = triangles + OBJECT_WEIGHT
    for node in range(len(tree.end)):
        own = tree.leaf[node : tree.end[node]]
        own = own[own >= 0]
        assert np.array_equal(tree.lo[node], lo[own].min(axis=0))
        assert np.array_equal(tree.hi[node], hi[own].max(axis=0))
        assert tree.end[node] - node == 2 * len(own) - 1
        if tree.leaf[node] < 0:
            left = tree.leaf[node + 1 : tree.end[node + 1]]
            below = weight[left[left >= 0]].sum()
            assert abs(2 * below - weight[own].sum()) <= 2 * weight[own].max()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 80), st.sampled_from([500, 5000, 100_000]))
def test_fragments_cover_the_tree(seed: int, count: int, most: int) -> None:
    tree = build_tree(*objects(seed, count))
    triangles = np.where(tree.leaf >= 0, 0, 0)
    triangles[tree.leaf >= 0] = objects(seed, count)[2][tree.leaf[tree.leaf >= 0]]
    fragments = plan_fragments(tree.end, np.zeros(1, np.int64), triangles, most)
    assert fragments[-1].root == 0
    done: set[int] = set()
    nodes: list[int] = []
    for fragment in fragments:
        assert set(fragment.stops) <= done
        todo = [fragment.root]
        own = []
        while todo:
            node = todo.pop()
            if node != fragment.root and node in fragment.stops:
                continue
            own.append(node)
            if tree.leaf[node] < 0:
                todo += [node + 1, int(tree.end[node + 1])]
        assert not done & set(own)
        nodes += own
        done.add(fragment.root)
        if len(own) > 3:
            assert fragment.triangles <= max(most, 3 * 3000)
    assert sorted(nodes) == list(range(len(tree.end)))


def test_small_instanced_pieces_are_merged_and_large_ones_shared() -> None:
    placed = np.zeros(40, PLACED_PIECE)
    placed["piece"] = np.repeat([0, 1], 20)
    placed["part"] = np.arange(40)
    placed["triangles"] = np.repeat([MERGED_TRIANGLES, MERGED_TRIANGLES + 1], 20)
    placed["instanced"] = True
    placed["lo"] = np.arange(40)[:, None] * [0.1, 0, 0]
    placed["hi"] = placed["lo"] + 0.05
    options = ObjectOptions(clustering=Clustering(volume=1.0))
    made = build_hierarchy(placed, options, np.zeros(3), np.full(3, 4.0))
    sizes = np.diff(made.start)
    assert sorted(made.members.tolist()) == list(range(40))
    assert made.shared.sum() == 20
    assert (sizes[made.shared] == 1).all()
    assert (made.members[made.start[:-1][made.shared]] >= 20).all()
    assert sizes[~made.shared].tolist() == [20]


def test_clusters_that_became_too_much_are_divided() -> None:
    placed = np.zeros(100, PLACED_PIECE)
    placed["triangles"] = 500
    placed["lo"] = np.arange(100)[:, None] * [0.1, 0, 0]
    placed["hi"] = placed["lo"] + 0.1
    made = build_hierarchy(placed, ObjectOptions(clustering=Clustering(volume=1.0)), np.zeros(3), np.full(3, 10.0))
    assert made.clusters == 1
    assert (500 * np.diff(made.start) <= 10_000).all()
    for first, last in zip(made.start[:-1], made.start[1:], strict=True):
        own = np.sort(made.members[first:last])
        assert own.tolist() == list(range(own[0], own[0] + len(own)))


def placed_boxes(seed: int, count: int) -> np.ndarray:
    """Placed pieces: small ones near each other, large ones, instanced ones; some can be seen through."""
    rng = np.random.default_rng(seed)
    placed = np.zeros(count, PLACED_PIECE)
    placed["piece"] = placed["part"] = np.arange(count)
    placed["triangles"] = rng.integers(1, 4000, count)
    placed["lo"] = rng.uniform(0, 9, (count, 3))
    placed["hi"] = placed["lo"] + rng.uniform(0, 1, (count, 3)) ** 3
    placed["instanced"] = rng.random(count) < 0.2
    placed["see_through"] = rng.random(count) < rng.choice([0.0, 0.1, 0.5, 1.0])
    placed["outward"] = (rng.random(count) < 0.5) & ~placed["see_through"]
    return placed


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 120), st.sampled_from([500, 5000, 100_000]))
def test_each_kind_has_the_tree_that_it_has_alone(seed: int, count: int, most: int) -> None:
    placed = placed_boxes(seed, count)
    options, box = ObjectOptions(clustering=Clustering(volume=0.05)), (np.zeros(3), np.full(3, 10.0))
    made = build_hierarchy(placed, options, *box)
    assert sorted(made.members.tolist()) == list(range(count))
    kinds = [own for own in (np.flatnonzero(~placed["see_through"]), np.flatnonzero(placed["see_through"])) if len(own)]
    assert len(made.roots) == len(kinds)
    ends = [*made.roots[1:].tolist(), len(made.tree.end)]
    objects = pieces = clusters = 0
    for own, root, end in zip(kinds, made.roots.tolist(), ends, strict=True):
        alone = build_hierarchy(placed[own], options, *box)
        assert made.tree.end[root] == end
        assert (made.tree.end[root:end] - root).tolist() == alone.tree.end.tolist()
        leaf = made.tree.leaf[root:end]
        assert np.where(leaf >= 0, leaf - objects, -1).tolist() == alone.tree.leaf.tolist()
        assert made.tree.lo[root:end].tolist() == alone.tree.lo.tolist()
        assert made.tree.hi[root:end].tolist() == alone.tree.hi.tolist()
        last = objects + len(alone.shared)
        assert (made.start[objects : last + 1] - pieces).tolist() == alone.start.tolist()
        assert made.members[pieces : pieces + len(own)].tolist() == own[alone.members].tolist()
        assert made.shared[objects:last].tolist() == alone.shared.tolist()
        objects, pieces, clusters = last, pieces + len(own), clusters + alone.clusters
    assert clusters == made.clusters
    triangles = np.zeros(len(made.tree.end), np.int64)
    triangles[made.tree.leaf >= 0] = np.add.reduceat(
        placed["triangles"][made.members].astype(np.int64), made.start[:-1]
    )
    fragments = plan_fragments(made.tree.end, made.roots, triangles, most)
    tops = set(made.roots.tolist())
    assert {fragment.root for fragment in fragments} - {stop for f in fragments for stop in f.stops} == tops
    for fragment in fragments:
        assert not tops & set(fragment.stops)
