"""Welding, components, closedness, and splitting."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jobs.objects.components import components, outward_closed
from jobs.objects.find import GridPieces, find_pieces
from jobs.objects.object_options import Limits
from jobs.objects.partition import divide, too_much
from jobs.objects.weld import NON_MANIFOLD, OPEN, degenerate_triangles, is_degenerate, twins, weld

BOX = np.array([[x, y, z] for x in (0, 8) for y in (0, 8) for z in (0, 8)], np.int32)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
BOX_TRIANGLES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))], np.int32)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 200), st.integers(1, 12))
def test_weld_numbers_distinct_positions_by_first_use(seed: int, n: int, spread: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(-spread, spread, (n, 3)).astype(np.int32) * np.int32(2**20)
    group = rng.integers(0, 2, n).astype(np.int32)
    ids, first = weld(points, group)
    seen: dict[tuple[int, ...], int] = {}
    for i in range(n):
        expected = seen.setdefault((*points[i].tolist(), int(group[i])), len(seen))
        assert ids[i] == expected
        assert ids[first[expected]] == expected
    assert len(first) == len(seen)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 120), st.integers(3, 150))
def test_components_agree_with_scipy(seed: int, m: int, n: int) -> None:
    triangles = np.random.default_rng(seed).integers(0, n, (m, 3)).astype(np.int32)
    label, count = components(triangles, n)
    a, b = np.concatenate([triangles[:, :2], triangles[:, 1:]]).T
    _, expected = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)
    pairs = set(zip(label.tolist(), expected[triangles[:, 0]].tolist(), strict=True))
    assert len(pairs) == count == len({p for p, _ in pairs}) == len({q for _, q in pairs})
    assert label[np.unique(label, return_index=True)[1]].tolist() == list(range(count))


def test_twins_pair_opposite_half_edges_only() -> None:
    twin = twins(BOX_TRIANGLES)
    assert (twin >= 0).all()
    assert (twin[twin] == np.arange(36)).all()
    fan = np.array([[0, 1, 2], [1, 0, 3], [1, 0, 4]], np.int32)
    assert twins(fan)[[0, 3, 6]].tolist() == [NON_MANIFOLD] * 3
    assert twins(fan)[1] == OPEN
    same_way = np.array([[0, 1, 2], [0, 1, 3]], np.int32)
    assert twins(same_way)[[0, 3]].tolist() == [NON_MANIFOLD] * 2


def test_degenerate_is_exact() -> None:
    far = 2**23
    points = np.array([[-far, -far, -far], [far, far, far], [0, 0, 0], [1, 0, 0]], np.int32)
    assert is_degenerate(points, 0, 1, 2)
    assert not is_degenerate(points, 0, 1, 3)
    assert degenerate_triangles(points, np.array([[0, 1, 2], [0, 1, 3], [2, 2, 3]], np.int32)).tolist() == [
        True,
        False,
        True,
    ]


def closed(points: np.ndarray, triangles: np.ndarray) -> bool:
    return bool(outward_closed(points, triangles, twins(triangles), np.array([0, len(triangles)]))[0])


def test_outward_closed() -> None:
    assert closed(BOX, BOX_TRIANGLES)
    assert not closed(BOX, BOX_TRIANGLES[:, ::-1].copy())
    assert not closed(BOX, BOX_TRIANGLES[1:])
    one_turned = BOX_TRIANGLES.copy()
    one_turned[0] = one_turned[0, ::-1]
    assert not closed(BOX, one_turned)
    # a box turned inside out that touches a larger proper one in a corner: positive volume, but not one-sided
    both = np.concatenate([BOX * 4, BOX + 32])
    triangles = np.concatenate([BOX_TRIANGLES, BOX_TRIANGLES[:, ::-1] + 8]).astype(np.int32)
    ids, first = weld(both.astype(np.int32), np.zeros(16, np.int32))
    assert len(first) == 15
    assert not closed(both[first].astype(np.int32), ids[triangles])


def pieces(points: np.ndarray, mesh: np.ndarray, triangles: np.ndarray, most: int, size: float = 1e9) -> GridPieces:
    meshes = int(mesh.max()) + 1
    limits = Limits(triangles=most, most=most, ratio=1e9)
    return find_pieces(points, mesh, triangles, meshes, limits, np.full(meshes, size))


def test_meshes_stay_apart_and_small_ones_whole() -> None:
    count = 50
    points = np.concatenate([BOX + np.int32(100 * i) for i in range(count)] + [BOX])
    mesh = np.repeat(np.arange(count + 1, dtype=np.int32) // count, 8)
    triangles = np.concatenate([BOX_TRIANGLES.astype(np.int64) + 8 * i for i in range(count + 1)])
    shuffled = np.random.default_rng(0).permutation(len(triangles))
    found = pieces(points, mesh, triangles[shuffled], 12 * count)
    assert np.diff(found.start).tolist() == [12 * count, 12]
    assert found.mesh.tolist() == [0, 1]
    assert found.outward.all()
    assert len(found.shared) == 0
    assert (points[triangles[shuffled][found.source]] == found.points[found.triangles]).all()


def test_components_are_not_cut_where_others_can_be_taken_away() -> None:
    count = 40
    points = np.concatenate([BOX + np.int32(20 * i) for i in range(count)])
    triangles = np.concatenate([BOX_TRIANGLES.astype(np.int64) + 8 * i for i in range(count)])
    found = pieces(points, np.zeros(len(points), np.int32), triangles, 100)
    assert np.diff(found.start).max() <= 100
    assert len(found.shared) == 0
    assert all(len(np.unique(found.component[a:b])) * 12 == b - a for a, b in pairwise(found.start))


def test_large_surfaces_are_split_along_edges() -> None:
    n = 40
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    points = np.stack([x.ravel() * 3, y.ravel() * 2, 0 * x.ravel()], axis=1).astype(np.int32)
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    points = np.concatenate([points, BOX + 1000])
    triangles = np.concatenate([triangles, BOX_TRIANGLES + n * n])
    found = pieces(points, np.zeros(len(points), np.int32), triangles, 500)
    assert np.diff(found.start).max() <= 500
    assert sorted(found.source.tolist()) == list(range(len(triangles)))
    lists: dict[int, set[int]] = {}
    for p in range(len(found.start) - 1):
        for v in np.unique(found.triangles[found.start[p] : found.start[p + 1]]).tolist():
            lists.setdefault(v, set()).add(p)
    expected = {v: sorted(own) for v, own in lists.items() if len(own) > 1}
    assert found.shared.tolist() == sorted(expected)
    starts = found.sharing_start
    for at, v in enumerate(found.shared.tolist()):
        assert found.sharing[starts[at] : starts[at + 1]].tolist() == expected[v]
    # half-edges pair across pieces
    piece = np.repeat(np.arange(len(found.start) - 1), np.diff(found.start))
    paired = np.flatnonzero(found.twin >= 0)
    assert (piece[paired // 3] != piece[found.twin[paired] // 3]).any()


def test_what_has_no_area_is_left_out_where_something_else_is_drawn() -> None:
    line = np.array([[0, 0, 0], [5, 5, 5], [9, 9, 9]], np.int32)
    a, b = BOX_TRIANGLES[3, :2]
    points = np.concatenate([BOX, line + 50, [(BOX[a] + BOX[b]) // 2]]).astype(np.int32)
    sliver = [[a, 11, b]]  # along a side of the box
    triangles = np.concatenate([BOX_TRIANGLES, [[8, 9, 10]], sliver]).astype(np.int64)
    found = pieces(points, np.zeros(len(points), np.int32), triangles, 100)
    assert sorted(found.source.tolist()) == list(range(13)), "the line is one step wide"
    assert not found.outward.any()
    assert found.flat_source.tolist() == [13]
    assert found.flat_component.tolist() == [found.component[found.source.tolist().index(0)]]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 200), st.integers(16, 60))
def test_divide_leaves_no_group_that_is_too_much(seed: int, k: int, few: int) -> None:
    rng = np.random.default_rng(seed)
    lo = rng.uniform(0, 9, (k, 3)) * [1, 1, rng.integers(0, 2)]
    hi = lo + rng.uniform(0, 1, (k, 3))
    weight = rng.integers(1, 30, k)
    limits = (few, 3.0, 2.5, 4 * few)
    order, start = divide(lo, hi, weight, limits)
    assert sorted(order.tolist()) == list(range(k))
    for first, last in pairwise(start):
        own = order[first:last]
        assert (np.diff(own) > 0).all()
        if len(own) > 1:
            assert not too_much(int(weight[own].sum()), lo[own].min(axis=0), hi[own].max(axis=0), limits)
