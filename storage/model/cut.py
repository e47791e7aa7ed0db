"""Which nodes stand for the model as seen from a view cell, and at which level.

The builder, `Store.cut` and the player all call `choose_cut`, so that they agree to the last bit.

Based on: Chhugani et al., vLOD: High-Fidelity Walkthrough of Large Virtual Environments, IEEE TVCG 11(1), 2005,
section 4 (the error of a level is seen from the nearest point of the cell).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.base.errors import ParameterError
from storage.model.descent import descend
from storage.model.tree import children, roots


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


#: From this allowed error on, as a part of the distance, what is near is not bound by it any more: see `choose_cut`.
#: About 7 degrees, or 279 pixels of the default screen.
UNBOUNDED = 0.125

#: Says of nodes, by their indices (k,) int64, which are wanted (k,) bool: the others are left out with all below them.
Wanted = Callable[[NDArray[np.int64]], NDArray[np.bool_]]


def choose_cut(
    nodes: np.ndarray,
    drawables: np.ndarray,
    lo: ArrayLike,
    hi: ArrayLike,
    pixel_angle: float,
    pixel_error: float,
    wanted: Wanted | None = None,
) -> NDArray[np.int64]:
    """The drawables that stand for the whole model as seen from the box lo, hi (3,): sorted ids (n,) int64.

    nodes, drawables: a store's NODE and DRAWABLE arrays; lo, hi: in model units; pixel_angle: see `pixel_angle`;
    pixel_error: allowed error in pixels.
    From the root down, a node that has a level with error <= pixel_error * pixel_angle * (r - error) stands for all
    below it, at the coarsest such level; r is the distance between the two boxes: then what is drawn lies within that
    many pixels of where it belongs, from everywhere in the box. Leaves that have no level that good stand for
    themselves at their finest. Float64, the same bits on every machine. Work and memory follow the result's size.
    So what touches the box is at its finest, however large the allowed error. A cell that must be coarser still (see
    `jobs.cells.budget`) allows more than UNBOUNDED = allowed / distance: then whatever lies anywhere, in the box too,
    may be off by the part of the box's diagonal by which UNBOUNDED is exceeded. With enough pixels the roots' coarsest
    levels are the cut.

    Based on: C. Erikson, D. Manocha, W. V. Baxter, HLODs for Faster Display of Large Static and Dynamic Environments,
    I3D 2001; W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, section 5.1.2.
    """
    box = np.array([lo, hi], np.float64)
    allowed = float(pixel_error) * float(pixel_angle)
    anywhere = error_anywhere(lo, hi, allowed)
    if wanted is None:
        return np.sort(descend(nodes, drawables, roots(nodes), True, box, allowed, anywhere)[0])
    chosen = [np.zeros(0, np.int64)]
    front = roots(nodes)
    while len(front):
        ids, front = descend(nodes, drawables, front[wanted(front)], False, box, allowed, anywhere)
        chosen.append(ids)
        front = children(nodes, front)
    return np.sort(np.concatenate(chosen))


def error_anywhere(lo: ArrayLike, hi: ArrayLike, allowed: float) -> float:
    """The error, in model units, that is allowed as seen from the box lo, hi (3,) however near: see `choose_cut`.

    allowed: error over distance. 0 up to UNBOUNDED.
    """
    x, y, z = (np.asarray(hi, np.float64) - np.asarray(lo, np.float64)).tolist()
    return max(0.0, allowed - UNBOUNDED) * math.sqrt((x * x + y * y) + z * z)


def coarsest_triangles(nodes: np.ndarray, drawables: np.ndarray) -> int:
    """Triangles of the coarsest cut there is: the roots' coarsest levels."""
    rows = nodes[roots(nodes)]
    last = rows["first_drawable"].astype(np.int64) + rows["levels"] - 1
    return int(drawables["triangles"][last].sum(dtype=np.int64))


def possible_drawables(
    nodes: np.ndarray,
    drawables: np.ndarray,
    lo: ArrayLike,
    hi: ArrayLike,
    edges: ArrayLike,
    pixel_angle: float,
    pixel_error: float,
) -> NDArray[np.int64]:
    """All drawables that `choose_cut` may give for any box that lies in lo, hi (3,): sorted ids (n,) int64.

    edges: (3,) the least extents of these boxes, in model units. A superset of what boxes of that size give, by one
    walk instead of one for each box: a node is nowhere nearer to such a box than to the whole, and farther by no more
    than the diagonal of what the whole exceeds it by.
    """
    allowed = float(pixel_error) * float(pixel_angle)
    low, high, least = (np.asarray(value, np.float64) for value in (lo, hi, edges))
    spread = float(np.linalg.norm(high - low - least))
    errors = drawables["error"]
    found = [np.zeros(0, np.int64)]
    front = roots(nodes)
    while len(front):
        rows = nodes[front]
        first, levels = rows["first_drawable"].astype(np.int64), rows["levels"].astype(np.int64)
        near = box_distance(low, high, rows["lo"], rows["hi"])
        far = (near + spread) * (1 + 1e-9)
        fits_near, fits_far = (np.full(len(front), -1, np.int64) for _ in range(2))
        for level in range(int(levels.max(initial=0))):
            having = np.flatnonzero(levels > level)
            error = errors[first[having] + level].astype(np.float64)
            for fits, reach, anywhere in (
                (fits_near, near * (1 - 1e-9), error_anywhere(0 * least, least, allowed)),
                (fits_far, far, error_anywhere(low, high, allowed)),
            ):
                fits[having[(error <= allowed * (reach[having] - error)) | (error <= anywhere)]] = level
        leaf = rows["end"] == front + 1
        coarsest = np.where(leaf, np.maximum(fits_far, 0), fits_far)
        finest = np.maximum(fits_near, 0)
        found += [(first + k)[(finest <= k) & (k <= coarsest)] for k in range(int(coarsest.max(initial=-1)) + 1)]
        front = children(nodes, front[(fits_near < 0) & ~leaf])
    return np.sort(np.concatenate(found))


def cut_within(nodes: np.ndarray, drawables: np.ndarray, error: float) -> NDArray[np.int64]:
    """The coarsest drawables that stand for the whole model with at most `error`: sorted ids (n,) int64.

    error: in model units. Leaves that have no level that good stand for themselves at their finest.
    """
    nothing_by_distance = math.nan
    return np.sort(
        descend(nodes, drawables, roots(nodes), True, np.zeros((2, 3)), nothing_by_distance, float(error))[0]
    )
