"""Which level of each node is fine enough for a view cell.

The builder, `Store.cut` and the player all call `choose_levels`, so that they agree to the last bit.

Based on: Chhugani et al., vLOD: High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005,
section 4 (the error of a level is seen from the nearest point of the cell).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.errors import ParameterError


def pixel_angle(screen_height: float, field_of_view_degrees: float, aspect: float = 16 / 9) -> float:
    """The largest displacement, per unit of distance, that stays below one pixel anywhere on the screen.

    screen_height: in pixels; field_of_view_degrees: vertical, of the whole screen; aspect: width over height.
    A flat screen spreads angles towards its corners: at angle theta from its axis, a displacement d at distance r moves
    the image by up to f d / (r cos(theta)^2) pixels, with f the focal length in pixels. The corners are the worst.
    Returns cos(theta)^2 / f, in model units per model unit of distance (about radians). Raises ParameterError.
    """
    if not (math.isfinite(screen_height) and screen_height > 0):
        raise ParameterError(f"the screen height must be positive, in pixels, not {screen_height}")
    if not (math.isfinite(field_of_view_degrees) and 0 < field_of_view_degrees < 180):
        raise ParameterError(f"the field of view must be between 0 and 180 degrees, not {field_of_view_degrees}")
    if not (math.isfinite(aspect) and aspect > 0):
        raise ParameterError(f"the aspect ratio must be positive, not {aspect}")
    half = math.tan(math.radians(field_of_view_degrees) / 2)
    focal_length = screen_height / 2 / half
    corner = half * half * (1 + aspect * aspect)  # tan(theta)^2 at the corner
    return 1 / ((1 + corner) * focal_length)


def box_distance(lo: ArrayLike, hi: ArrayLike, other_lo: ArrayLike, other_hi: ArrayLike) -> NDArray[np.float64]:
    """Distance (n,) float64 between one box (3,), (3,) and boxes (n, 3), (n, 3); 0 where they touch."""
    low, high = np.asarray(lo, np.float64), np.asarray(hi, np.float64)
    gap = np.maximum(np.asarray(other_lo, np.float64) - high, low - np.asarray(other_hi, np.float64))
    gap = np.maximum(gap, 0)
    x, y, z = gap[..., 0], gap[..., 1], gap[..., 2]
    return np.sqrt((x * x + y * y) + z * z)


def choose_levels(
    nodes: np.ndarray,
    drawables: np.ndarray,
    lo: ArrayLike,
    hi: ArrayLike,
    pixel_angle: float,
    pixel_error: float,
) -> NDArray[np.int64]:
    """The drawables that stand for `nodes` as seen from the box lo, hi (3,): one per node, sorted ids (n,) int64.

    nodes: NODE array, all or some of a store's; drawables: the store's whole DRAWABLE array; lo, hi: in model units;
    pixel_angle: see `pixel_angle`; pixel_error: allowed error in pixels.
    Takes the coarsest level of each node with error <= pixel_error * pixel_angle * (r - error), where r is the distance
    between the two boxes: then what is drawn lies within that many pixels of where it belongs, from everywhere in the
    box. Takes the finest where no level is that good. Float64, the same bits on every machine.
    """
    first = nodes["first_drawable"].astype(np.int64)
    levels = nodes["levels"].astype(np.int64)
    if not len(first):
        return first
    reach = box_distance(lo, hi, nodes["lo"], nodes["hi"])
    allowed = float(pixel_error) * float(pixel_angle)
    chosen = first.copy()
    errors = drawables["error"]
    for level in range(1, int(levels.max())):
        having = np.flatnonzero(levels > level)
        candidates = first[having] + level
        error = errors[candidates].astype(np.float64)
        good = error <= allowed * (reach[having] - error)
        chosen[having[good]] = candidates[good]
    return np.sort(chosen)
