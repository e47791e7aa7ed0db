"""Ranges hold exactly the places where a linear function is within its bound."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from jobs.visibility.surfaces.ranges import below, not_above, not_below

#: Numbers whose sums, products and quotients by powers of two are exact.
NUMBERS = st.integers(-64, 64).map(float)
SLOPES = st.sampled_from([0.0, *(sign * 2.0**k for k in range(-4, 5) for sign in (1, -1))])
FLOATS = st.floats(-1e6, 1e6)
PLACES = st.integers(-64, 64).map(lambda n: n / 16)


@given(PLACES, PLACES, NUMBERS, SLOPES, PLACES)
def test_a_place_is_kept_where_the_function_is_within_the_bound(first, last, value, slope, place):
    inside = first <= place <= last
    least, most = not_above(first, last, value, slope)
    assert (least <= place <= most) == (inside and value + place * slope <= 0.0)
    least, most = not_below(first, last, value, slope)
    assert (least <= place <= most) == (inside and value + place * slope >= 0.0)


@given(FLOATS, FLOATS, FLOATS, st.floats(0.0, 1.0))
def test_rounded_outward_no_place_is_lost(a, b, bound, place):
    least, most = below(0.0, 1.0, a, b, bound)
    if Fraction(a) + Fraction(place) * (Fraction(b) - Fraction(a)) <= Fraction(bound):
        assert least <= place <= most


@given(NUMBERS, SLOPES, NUMBERS, PLACES)
def test_rounded_outward_no_far_place_is_kept(a, slope, bound, place):
    least, most = below(0.0, 1.0, a, a + slope, bound)
    assert (least <= place <= most) == (0.0 <= place <= 1.0 and a + place * slope <= bound)
