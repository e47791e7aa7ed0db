"""Triangles in images: every pixel that one touches is as deep as it, and what counts as covered is met."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.visibility.images.cube_faces import Face, Pixels
from jobs.visibility.images.raster import LANES, draw_triangles

R = 40
FARTHEST = 1e4


@st.composite
def corners(draw: st.DrawFn) -> np.ndarray:
    """(3, 3) in cell coordinates, seen on face 4: of any size, thin, short on one side, or reaching behind the eye."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kind = draw(st.sampled_from(["any", "small", "needle", "line", "behind", "grid"]))
    depth = rng.uniform(1, 30, 3)
    size = draw(st.sampled_from([1e-7, 1e-3, 0.5, 3.0, 10.0, 60.0, 1e4]))
    image = rng.uniform(0, R, 2) + rng.uniform(-size, size, (3, 2))
    if kind == "small":
        image = rng.uniform(0, R, 2) + rng.uniform(-1, 1, (3, 2))
    elif kind == "needle":
        image[2] = image[1] + rng.normal(size=2) * draw(st.sampled_from([0.0, 1e-14, 1e-9, 1e-3]))
    elif kind == "line":
        image[2] = image[0] + rng.uniform(-1, 2) * (image[1] - image[0])
    elif kind == "grid":
        image = np.round(2 * image) / 2
        depth = np.round(depth)
    seen = (image / (R / 2) - 1) * depth[:, None]
    if kind == "behind":
        depth[rng.integers(0, 3)] *= -1
    return np.column_stack([seen, depth])


FACE, WHOLE = Face(4, R, FARTHEST), Pixels(0, R - 1, 0, R - 1)


def drawn(q: np.ndarray, pixels: Pixels = WHOLE) -> tuple[np.ndarray, np.ndarray]:
    """(r, r) one over the depths and the limits that drawing the corners q (3, 3) leaves."""
    inverse, limit = np.full((R, R + LANES), np.inf, np.float32), np.zeros((R, R + LANES), np.float32)
    limit[:, ::7] = -1
    triangles, chosen = np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32)
    draw_triangles(q, triangles, chosen, FACE, pixels, np.empty((4, 2)), True, inverse, limit)
    return inverse[:, :R], limit[:, :R]


@settings(max_examples=500, deadline=None)
@given(corners(), st.integers(0, 2**32 - 1))
def test_every_point_of_a_triangle_is_in_a_pixel_as_deep_as_it(q: np.ndarray, seed: int) -> None:
    inverse, _ = drawn(q)
    rng = np.random.default_rng(seed)
    parts = rng.dirichlet(rng.choice([0.05, 1.0], 3), 4000)
    points = parts @ q
    points = points[points[:, 2] > 1.0]
    image = (points[:, :2] / points[:, 2:] + 1) * (R / 2)
    inside = ((image >= 0) & (image < R)).all(axis=1)
    i, j = image[inside].astype(int).T
    assert (inverse[j, i] * points[inside, 2] <= 1 + 1e-6).all()


@settings(max_examples=500, deadline=None)
@given(corners())
def test_what_is_touched_or_covered_is_met_but_for_rounding(q: np.ndarray) -> None:
    if q[:, 2].min() < 0.5:
        return
    inverse, limit = drawn(q)
    image = (q[:, :2] / q[:, 2:] + 1) * (R / 2)
    v, u = np.mgrid[0:R, 0:R] + 0.5
    centres = np.stack([u, v], axis=-1)
    lo, hi = image.min(axis=0) - 1e-3, image.max(axis=0) + 1e-3
    touched = np.isfinite(inverse)
    assert (((centres + 0.5 >= lo) & (centres - 0.5 <= hi)).all(axis=2) | ~touched).all()
    covered = limit == FARTHEST
    assert (limit[:, ::7] == -1).all()
    assert (((centres >= lo) & (centres <= hi)).all(axis=2) | ~covered).all()
    area = np.linalg.det([image[1] - image[0], image[2] - image[0]])
    for k in range(3):
        a, b = image[k], image[(k + 1) % 3]
        length = np.abs(b - a).sum()
        if length < 1e-3 or np.abs(image).max() > 1e3:
            continue
        inward = np.array([a[1] - b[1], b[0] - a[0]]) * np.sign(area) / length
        value = (centres - a) @ inward
        if abs(area) > 1e-6:
            assert (value[touched] >= -0.5 - 1e-3).all()
            assert (value[covered] >= -1e-3).all()


@settings(max_examples=300, deadline=None)
@given(corners())
def test_centres_well_inside_are_covered(q: np.ndarray) -> None:
    if q[:, 2].min() < 0.5:
        return
    inverse, limit = drawn(q)
    image = (q[:, :2] / q[:, 2:] + 1) * (R / 2)
    v, u = np.mgrid[0:R, 0:R] + 0.5
    centres = np.stack([u, v], axis=-1)
    area = np.linalg.det([image[1] - image[0], image[2] - image[0]])
    inside = np.full((R, R), abs(area) > 1e-6)
    for k in range(3):
        a, b = image[k], image[(k + 1) % 3]
        inward = np.array([a[1] - b[1], b[0] - a[0]]) * np.sign(area)
        inside &= (centres - a) @ inward > 1e-3 * np.abs(b - a).sum()
    assert np.isfinite(inverse[inside]).all()
    assert (limit[inside] != 0).all()


@settings(max_examples=200, deadline=None)
@given(corners(), st.tuples(*[st.integers(0, R - 1)] * 4))
def test_a_window_shows_what_the_whole_image_shows(q: np.ndarray, sides: tuple[int, int, int, int]) -> None:
    i0, i1 = sorted(sides[:2])
    j0, j1 = sorted(sides[2:])
    inverse, _ = drawn(q)
    part, part_limit = drawn(q, Pixels(i0, i1, j0, j1))
    whole = inverse[j0 : j1 + 1, i0 : i1 + 1]
    here = part[j0 : j1 + 1, i0 : i1 + 1]
    both = np.isfinite(whole) & np.isfinite(here)
    assert (np.isfinite(whole) != np.isfinite(here)).sum() <= 4  # edges that pass within rounding of a pixel
    np.testing.assert_allclose(here[both], whole[both], rtol=1e-3)
    assert (part_limit[:j0] <= 0).all()
    assert (part_limit[j1 + 1 :] <= 0).all()
