"""Ranges of a parameter: the part of a range in which a linear function is within a bound.

Ranges are pairs of float64, both ends included; a range is empty where its first end is above its second. An empty
range may be narrowed further, and stays empty.
"""

from __future__ import annotations

from storage.base.kernels import kernel

#: Places from 0 to 1, such as those along an edge or a sweep, are rounded outward by this much.
ALONG = 1e-12


@kernel(inline="always")
def not_above(first: float, last: float, value: float, slope: float) -> tuple[float, float]:
    """The part of [first, last] where value + s slope <= 0."""
    if slope > 0.0:
        last = min(last, -value / slope)
    elif slope < 0.0:
        first = max(first, -value / slope)
    elif value > 0.0:
        last = first - 1.0
    return first, last


@kernel(inline="always")
def not_below(first: float, last: float, value: float, slope: float) -> tuple[float, float]:
    """The part of [first, last] where value + s slope >= 0."""
    return not_above(first, last, -value, -slope)


@kernel(inline="always")
def below(t0: float, t1: float, a: float, b: float, bound: float) -> tuple[float, float]:
    """The part of [t0, t1] where a + t (b - a) <= bound, rounded outward by ALONG."""
    slope = b - a
    if slope > 0.0:
        t1 = min(t1, (bound - a) / slope + ALONG)
    elif slope < 0.0:
        t0 = max(t0, (bound - a) / slope - ALONG)
    elif a > bound:
        t1 = t0 - 1.0
    return t0, t1
