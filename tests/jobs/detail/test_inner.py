"""One inner node from what its children offer."""

from __future__ import annotations

import numpy as np

from jobs.detail.inner import Inner, make_inner
from jobs.detail.node import Locks, Offer
from tests.jobs.detail.shapes import sphere


def node_above(balls: list[np.ndarray], triangles: np.ndarray, locks: Locks) -> Inner:
    colours = np.full((3 * len(triangles), 4), 200, np.uint8)
    offers = [[Offer(points, triangles.astype(np.int32), colours, 0.5, 0.0, True, locks)] for points in balls]
    return make_inner(offers, 0, 1, 1.0, 0.7, True)


def test_locks_where_no_child_has_a_vertex_lock_nothing() -> None:
    """Vertices that come to lie there when edges collapse are none that other leaves share."""
    points, triangles = sphere(6)
    balls = [np.rint(points * 8).astype(np.int32) + shift for shift in ([0, 0, 0], [20, 0, 0])]
    everywhere = np.stack(np.meshgrid(*[np.arange(-9, 30)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    taken = {tuple(point) for ball in balls for point in ball.tolist()}
    free = np.array([place for place in everywhere.tolist() if tuple(place) not in taken], np.int32)
    away = np.full(len(free), 7)  # in a leaf that is elsewhere
    none = Locks(free[:0], away[:0], away[:0])
    locked, free_of_locks = (node_above(balls, triangles, locks) for locks in (Locks(free, away, away), none))
    assert len(locked.node.levels) > 1
    for one, other in zip(locked.node.levels, free_of_locks.node.levels, strict=True):
        assert (one.positions == other.positions).all()
        assert (one.normals == other.normals).all()
        assert (one.triangles == other.triangles).all()
    new = {tuple(place) for level in locked.node.levels for place in level.positions.tolist()} - taken
    assert new, "no vertex came to lie elsewhere"
