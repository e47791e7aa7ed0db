"""The alpha of a texture over triangles, against every texel looked at one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.importing.reading.texture_alpha import TextureAlpha, Wrap


def clipped(polygon, axis, bound, sign):
    """A polygon's part on one side of a line across an axis (Sutherland and Hodgman)."""
    kept = []
    for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        inside = [sign * (point[axis] - bound) >= 0 for point in (a, b)]
        if inside[0]:
            kept.append(a)
        if inside[0] != inside[1]:
            share = (bound - a[axis]) / (b[axis] - a[axis])
            kept.append(tuple(a[k] + share * (b[k] - a[k]) for k in range(2)))
    return kept


def area(polygon):
    x, y = np.array(polygon or [(0, 0)]).T
    return abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def texel_of(number, size, wrap):
    if wrap is Wrap.CLAMP:
        return min(max(number, 0), size - 1)
    if wrap is Wrap.MIRROR and number // size % 2:
        return size - 1 - number % size
    return number % size


def by_texel(alpha, corners, wrap):
    """{alpha: area that it has in a triangle's image}, corners (3, 2) in texels."""
    found = {}
    low, high = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int)
    for j in range(low[1], high[1]):
        for i in range(low[0], high[0]):
            polygon = [tuple(corner) for corner in corners.tolist()]
            for axis, bound, sign in ((0, i, 1), (0, i + 1, -1), (1, j, 1), (1, j + 1, -1)):
                polygon = clipped(polygon, axis, bound, sign)
            value = alpha[texel_of(j, alpha.shape[0], wrap[1]), texel_of(i, alpha.shape[1], wrap[0])]
            found[int(value)] = found.get(int(value), 0.0) + area(polygon)
    return found


@given(
    st.integers(0, 10_000),
    st.integers(1, 13),
    st.integers(1, 13),
    st.sampled_from([0.3, 1.0, 2.5]),
    st.sampled_from(Wrap),
    st.sampled_from(Wrap),
)
@settings(deadline=None, max_examples=100)
def test_least_and_greatest_are_those_of_the_texels_touched(seed, width, height, spread, across, down):
    random = np.random.default_rng(seed)
    alpha = np.where(random.random((height, width)) < 0.2, 255, random.integers(0, 250, (height, width)))
    places = random.uniform(-spread, spread, (30, 2)) + 0.5
    triangles = np.arange(30).reshape(-1, 3)
    found = TextureAlpha(alpha.astype(np.uint8)).over(places, triangles, (across, down))
    for number, corners in enumerate(places[triangles] * [width, height]):
        areas = by_texel(alpha, corners, (across, down))
        surely = [value for value, touched in areas.items() if touched > 0.2]
        exact = (corners >= 0).all() and (corners <= [width, height]).all()
        if surely:  # nothing that is there is overlooked
            assert found.least[number] <= min(surely)
            assert found.greatest[number] >= max(surely)
        if exact and surely:  # and nothing that is not there is found
            assert found.least[number] in areas
            assert found.greatest[number] in areas
            mean = sum(value * touched for value, touched in areas.items()) / sum(areas.values())
            assert abs(found.mean[number] - mean) < 80
        assert found.least[number] <= found.mean[number] <= found.greatest[number]


def test_a_mean_over_many_texels_is_close():
    random = np.random.default_rng(5)
    alpha = (random.random((300, 200)) * 255).astype(np.uint8)
    alpha[:150] //= 4
    places = random.random((60, 2))
    triangles = np.arange(60).reshape(-1, 3)
    found = TextureAlpha(alpha).over(places, triangles)
    y, x = (np.indices(alpha.shape) + 0.5) / np.array([300, 200]).reshape(2, 1, 1)
    for number, (a, b, c) in enumerate(places[triangles]):
        sides = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
        inside = np.all([side > 0 for side in sides], axis=0) | np.all([side < 0 for side in sides], axis=0)
        if inside.sum() > 200:
            assert abs(found.mean[number] - alpha[inside].mean()) < 8


def test_one_hole_anywhere_is_found_and_one_beside_is_not():
    alpha = np.full((64, 64), 255, np.uint8)
    alpha[10, 40] = 7
    whole = TextureAlpha(alpha)
    places = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0.6, 0.5], [0.8, 0.5], [0.6, 0.9], [40 / 64, 0], [40 / 64, 1]])
    found = whole.over(places, np.array([[0, 1, 2], [1, 3, 2], [4, 5, 6], [0, 7, 8]]))
    assert found.least.tolist() == [7, 255, 255, 255]
    assert found.greatest.tolist() == [255] * 4


def test_a_corner_on_the_border_of_an_atlas_does_not_touch_what_is_beyond():
    """Coordinates of 32 bits: 1/3 of 96 texels is 32.000001."""
    alpha = np.zeros((96, 96), np.uint8)
    alpha[:, :32] = 255
    third = float(np.float32(1 / 3))
    places = np.array([[0, 0], [third, 0], [0, 1], [third, 1]])
    found = TextureAlpha(alpha).over(places, np.array([[0, 1, 2], [1, 3, 2]]))
    assert found.least.tolist() == [255, 255]


@pytest.mark.parametrize(
    ("places", "wrap", "least", "greatest"),
    [
        ([[0, 0], [1, 0], [0, 1]], (Wrap.REPEAT, Wrap.REPEAT), 0, 255),
        ([[0.1, 0.1], [0.4, 0.1], [0.1, 0.4]], (Wrap.REPEAT, Wrap.REPEAT), 255, 255),
        ([[1.1, 0.1], [1.4, 0.1], [1.1, 0.4]], (Wrap.REPEAT, Wrap.REPEAT), 255, 255),
        ([[1.1, 0.1], [1.4, 0.1], [1.1, 0.4]], (Wrap.MIRROR, Wrap.REPEAT), 0, 0),
        ([[-0.4, 0.1], [-0.1, 0.1], [-0.1, 0.4]], (Wrap.MIRROR, Wrap.REPEAT), 255, 255),
        ([[5.1, 0.1], [9.4, 0.1], [5.1, 0.4]], (Wrap.CLAMP, Wrap.REPEAT), 0, 0),
        ([[-5, 0.1], [-9, 0.1], [-5, 0.4]], (Wrap.CLAMP, Wrap.CLAMP), 255, 255),
        ([[0.25, 0.2]] * 3, (Wrap.REPEAT, Wrap.REPEAT), 255, 255),
        ([[0.75, 0.2]] * 3, (Wrap.REPEAT, Wrap.REPEAT), 0, 0),
        ([[1, 0], [1, 1], [1, 0.5]], (Wrap.CLAMP, Wrap.CLAMP), 0, 0),
        ([[1, 0], [1, 1], [1, 0.5]], (Wrap.REPEAT, Wrap.REPEAT), 255, 255),
        ([[0.1, 0.1], [0.2, 0.2], [0.9, 0.9]], (Wrap.REPEAT, Wrap.REPEAT), 0, 255),
        ([[0, 0], [900, 0], [0, 0.5]], (Wrap.REPEAT, Wrap.REPEAT), 0, 255),
        ([[0.1, 0], [0.1, 900], [0.3, 0]], (Wrap.REPEAT, Wrap.REPEAT), 255, 255),
        ([[1e30, 0], [-1e30, 0], [0, 1e30]], (Wrap.MIRROR, Wrap.CLAMP), 0, 255),
        ([[np.nan, np.inf], [0.2, 0], [0, 0.2]], (Wrap.REPEAT, Wrap.REPEAT), 255, 255),
    ],
)
def test_images_go_on_as_their_wrap_modes_say(places, wrap, least, greatest):
    alpha = np.zeros((8, 8), np.uint8)
    alpha[:, :4] = 255
    found = TextureAlpha(alpha).over(np.array(places, np.float64), np.array([[0, 1, 2]]), wrap)
    assert (found.least[0], found.greatest[0]) == (least, greatest)


def test_a_texture_of_one_alpha_costs_nothing():
    found = TextureAlpha(np.full((4096, 4096), 255, np.uint8)).over(np.zeros((3, 2)), np.array([[0, 1, 2]] * 5))
    assert found.least.tolist() == [255] * 5
    assert found.mean.tolist() == [255.0] * 5
