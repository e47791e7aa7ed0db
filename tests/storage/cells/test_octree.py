import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage.cells import octree
from storage.cells.octree import LeafSet, Octree
from tests.storage.strategies import leaf_sets


@given(st.integers(0, octree.MAX_DEPTH), st.integers(0, 2**32 - 1))
def test_keys_hold_coordinates(depth: int, seed: int) -> None:
    cells = np.random.default_rng(seed).integers(0, 1 << depth, (20, 3))
    keys = octree.encode(cells, depth)
    back, depths = octree.decode(keys)
    assert np.array_equal(back, cells)
    assert (depths == depth).all()


def test_children_come_in_morton_order_and_know_their_parent() -> None:
    children = octree.children(1)
    assert children.tolist() == list(range(8, 16))
    assert all(octree.parent(int(key)) == 1 for key in children)
    cells, _ = octree.decode(children)
    assert cells.tolist() == [[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]
    assert octree.ancestor(int(octree.children(9)[3]), 1) == 9


@pytest.mark.parametrize("key", [0, 2, 7, 16, 2**63 + 2**62])
def test_what_is_no_key_is_refused(key: int) -> None:
    if key == 2**63 + 2**62:
        key >>= 1
    with pytest.raises(ValueError, match="is not an octree key"):
        octree.depths(np.array([key], np.uint64))


def test_limits() -> None:
    with pytest.raises(ValueError, match="no parent"):
        octree.parent(1)
    with pytest.raises(ValueError, match="deepest"):
        octree.children(1 << (3 * octree.MAX_DEPTH))
    with pytest.raises(ValueError, match="coordinates"):
        octree.encode([[0, 0, 4]], 2)
    with pytest.raises(ValueError, match="depths"):
        octree.encode([[0, 0, 0]], octree.MAX_DEPTH + 1)
    with pytest.raises(ValueError, match="ancestor"):
        octree.ancestor(8, 2)
    with pytest.raises(ValueError, match="positive size"):
        Octree((0, 0, 0), 0)


@given(leaf_sets())
def test_neighbours_are_those_that_share_a_face(keys: np.ndarray) -> None:
    pairs, axes = octree.neighbours(keys)
    lo, hi = Octree((0.1, -2.3, 7.7), 3.3).boxes(keys)
    expected = []
    for a in range(len(keys)):
        overlap = np.minimum(hi[a], hi) - np.maximum(lo[a], lo)
        touching = ((overlap == 0).sum(axis=1) == 1) & ((overlap > 0).sum(axis=1) == 2)
        expected += [(a, b, int(np.flatnonzero(overlap[b] == 0)[0])) for b in np.flatnonzero(touching) if b > a]
    assert [(*pair, axis) for pair, axis in zip(pairs.tolist(), axes.tolist(), strict=True)] == expected


@given(leaf_sets(), st.integers(0, 2**32 - 1))
def test_points_are_found_in_the_cell_whose_box_holds_them(keys: np.ndarray, seed: int) -> None:
    tree = Octree((0.1, -2.3, 7.7), 3.3)
    random = np.random.default_rng(seed)
    lo, hi = tree.boxes(keys)
    corners = np.concatenate([lo, hi, lo + (hi - lo) * random.random(lo.shape)])
    points = np.concatenate([corners, tree.lo + tree.size * random.uniform(-0.1, 1.1, (20, 3))])
    root_hi = tree.box(1)[1]
    inside = (points[:, None] >= lo) & ((points[:, None] < hi) | ((hi == root_hi) & (points[:, None] == root_hi)))
    expected = np.where(inside.all(axis=2).any(axis=1), inside.all(axis=2).argmax(axis=1), -1)
    assert np.array_equal(tree.locate(points, LeafSet(keys)), expected)


def test_faces_are_equal_at_every_depth() -> None:
    tree = Octree((0.1, 1e6 + 0.3, -7.77), 123.456)
    for depth in range(octree.MAX_DEPTH):
        assert np.array_equal(tree.faces([[1, 1, 1]], depth), tree.faces([[2, 2, 2]], depth + 1))


def test_overlapping_leaves_are_refused() -> None:
    for keys in ([1, 8], [8, 8], [8, 9, 64]):
        with pytest.raises(ValueError, match="overlap"):
            LeafSet(keys)


def test_around_holds_the_box() -> None:
    for lo, hi in (([0, 0, 0], [1, 2, 3]), ([1e6, 1e6, 1e6], [1e6 + 1, 1e6, 1e6]), ([0, 0, 0], [0, 0, 0])):
        low, high = Octree.around(lo, hi).box(1)
        assert (low <= lo).all()
        assert (high >= hi).all()


def test_no_leaves() -> None:
    pairs, axes = octree.neighbours(np.zeros(0, np.uint64))
    assert pairs.shape == (0, 2)
    assert axes.shape == (0,)
    assert Octree((0, 0, 0), 1).locate([[0.5, 0.5, 0.5]], LeafSet([])).tolist() == [-1]
