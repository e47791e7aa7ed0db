"""Limits of pixels: no line of sight past an unsafe edge ends in a pixel that claims to hide its end."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.visibility.images.cube_faces import Face, Pixels
from jobs.visibility.images.silhouettes import lower_limits

R = 64


WHOLE = Pixels(0, R - 1, 0, R - 1)


def limits_of(ends: np.ndarray, face: int, pixels: Pixels = WHOLE, farthest: float = np.inf) -> np.ndarray:
    """The limits (r, r) of pixels of a face that one unsafe edge from ends[0] to ends[1] leaves; none is deeper."""
    limit = np.zeros((R, R), np.float32)
    limit[pixels.j0 : pixels.j1 + 1, pixels.i0 : pixels.i1 + 1] = farthest
    lower_limits(
        ends, np.array([[0, 1]], np.int32), Face(face, R, farthest), pixels, np.empty((4, 4)),
        np.empty((R, 2), np.int32), np.full((R, R), np.inf, np.float32), limit,
    )  # fmt: skip
    return limit


@st.composite
def edges(draw: st.DrawFn) -> tuple[np.ndarray, int, int]:
    """Two ends in cell coordinates, often running away from the cell; a face; a seed."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    reach = draw(st.sampled_from([2.0, 8.0, 60.0, 2000.0]))
    first = rng.uniform(-1, 1, 3) * rng.choice([2.0, reach])
    kind = draw(st.sampled_from(["any", "short", "radial", "flat"]))
    if kind == "any":
        last = rng.uniform(-reach, reach, 3)
    elif kind == "short":
        last = first + rng.normal(size=3) * 0.1
    elif kind == "radial":
        last = first * rng.uniform(1, 30) + rng.normal(size=3)
    else:
        last = first.copy()
        last[rng.integers(0, 3)] = rng.uniform(-reach, reach)
    return np.stack([first, last]), draw(st.integers(0, 5)), int(rng.integers(2**32))


@settings(max_examples=400, deadline=None)
@given(edges(), st.sampled_from([8.0, 100.0, np.inf]))
def test_lines_of_sight_past_an_edge_end_beyond_the_limits(edge: tuple[np.ndarray, int, int], farthest: float) -> None:
    ends, face, seed = edge
    limit = limits_of(ends, face, farthest=farthest)
    rng = np.random.default_rng(seed)
    n = 2000
    eye = rng.uniform(-1, 1, (n, 3))
    corner = rng.random(n) < 0.5
    eye[corner] = np.sign(eye[corner])
    t = np.where(rng.random(n) < 0.2, rng.integers(0, 2, n), rng.random(n))
    passed = ends[0] + t[:, None] * (ends[1] - ends[0])
    along = 1 + np.exp(rng.uniform(-8, 6, n))
    seen = eye + along[:, None] * (passed - eye)
    axis = face // 2
    sign = -1.0 if face % 2 else 1.0
    z = seen[:, axis] * sign
    u, v = seen[:, (axis + 1) % 3], seen[:, (axis + 2) % 3]
    inside = (z > 1) & (np.abs(u) <= z) & (np.abs(v) <= z) & (passed[:, axis] * sign < z) & (z < farthest)
    i = np.clip(np.floor((u[inside] / z[inside] + 1) * R / 2), 0, R - 1).astype(int)
    j = np.clip(np.floor((v[inside] / z[inside] + 1) * R / 2), 0, R - 1).astype(int)
    assert (limit[j, i] <= z[inside]).all()


def test_a_short_edge_leaves_what_is_far_from_it_and_limits_what_is_near() -> None:
    # at depth 10 an edge of the height of the cell, seen against depths behind it
    limit = limits_of(np.array([[10.0, 0.0, -1.0], [10.0, 0.0, 1.0]]), 0)
    assert np.isinf(limit[5]).all()  # far from it in the image
    middle = R // 2
    assert 10 * 0.99 < limit[middle, middle] <= 10
    row = limit[middle, middle:]
    finite = np.isfinite(row)
    assert (np.diff(row[finite]) > 0).all()  # the farther from the edge, the deeper
    assert finite.sum() < 6
    assert np.isinf(row[6:]).all()


def test_pixels_outside_of_the_window_are_left_alone() -> None:
    limit = limits_of(np.array([[10.0, -5.0, 0.0], [10.0, 5.0, 0.3]]), 0, Pixels(10, 40, 20, 50))
    assert (limit[:20] == 0).all()
    assert (limit[:, :10] == 0).all()
    assert (limit[20:51, 10:41] > 0).any()
