"""The alpha of a texture over whole triangles: least, mean, greatest.

A triangle hides what is behind it only if nothing of it can be seen through, so it is not enough to look at its
corners: all texels count that its image in the texture touches. The texture's alpha is kept in a pyramid (of each
square of 2^k texels: least, greatest, sum), and a triangle's image walks down it only where a square is cut by its
border or may still hold a smaller or greater value: large triangles cost hardly more than small ones.

Based on: Williams 1983, Pyramidal parametrics; Akenine-Moller 2001, Fast 3D triangle-box overlap testing (in two
dimensions).
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from storage.base.kernels import allocating_kernel, kernel


class Wrap(IntEnum):
    """What a texture shows beside its image, along one axis."""

    REPEAT = 0
    CLAMP = 1  # its border, for ever
    MIRROR = 2  # it repeats, every other time turned over


#: Texels of which less than this is touched, in texels, do not count: coordinates are rounded.
_TOUCH = 1 / 64

#: Texture coordinates beyond this, in texels, do not say any more which texels are meant.
_FAR = 2.0**31

#: A triangle whose image spans more tiles than this stands for its bounding rectangle.
_TILES = 16

#: A mean is taken of squares this part of the image's width, or smaller.
_FINENESS = 1 / 16


class AlphaOver(NamedTuple):
    """The alpha of a texture over some triangles, as bytes: 0 is invisible, 255 opaque."""

    least: np.ndarray  # (m,) uint8: no texel that the triangle touches has less
    mean: np.ndarray  # (m,) float64, 0 ... 255: about the mean by area
    greatest: np.ndarray  # (m,) uint8: none has more


class TextureAlpha:
    """An image's alpha, to be asked for whole triangles."""

    def __init__(self, alpha: np.ndarray) -> None:
        """`alpha`: (h, w) uint8; row 0 is the image's top."""
        self._alpha = np.ascontiguousarray(alpha, np.uint8)
        self._least, self._greatest = int(self._alpha.min()), int(self._alpha.max())
        self._levels = _pyramid(self._alpha) if self._least < self._greatest else None

    @property
    def opaque(self) -> bool:
        """Whether no texel can be seen through."""
        return self._least == 255

    def over(
        self, places: np.ndarray, triangles: np.ndarray, wrap: tuple[Wrap, Wrap] = (Wrap.REPEAT, Wrap.REPEAT)
    ) -> AlphaOver:
        """Over triangles (m, 3), which index texture coordinates `places` (n, 2) and must be in range.

        (0, 0) is the image's top left corner, (1, 1) its bottom right, as for `Texture.sample`; `wrap` is how the image
        goes on across and down. Coordinates that are not finite count as 0.
        """
        if self._levels is None:
            same = np.full(len(triangles), self._least, np.uint8)
            return AlphaOver(same, same.astype(np.float64), same)
        height, width = self._alpha.shape
        texels = np.nan_to_num(np.asarray(places, np.float64), nan=0.0, posinf=0.0, neginf=0.0) * [width, height]
        return AlphaOver(
            *_over(self._alpha, *self._levels, texels, np.asarray(triangles, np.int64), int(wrap[0]), int(wrap[1]))
        )


def _pyramid(alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Least (c,) uint8, greatest (c,) uint8 and sum (c,) int64 of all squares of 2, 4, 8, ... texels, level by level,
    row by row; and where each level begins (levels + 1,) int64. The last level is one square.
    """
    least, greatest, total = [], [], []
    starts = [0]
    low, high, sums = alpha, alpha, alpha.astype(np.int64)
    while low.size > 1:
        low, high, sums = _halved(low, np.minimum), _halved(high, np.maximum), _halved(sums, np.add)
        least.append(low.reshape(-1))
        greatest.append(high.reshape(-1))
        total.append(sums.reshape(-1))
        starts.append(starts[-1] + low.size)
    return np.concatenate(least), np.concatenate(greatest), np.concatenate(total), np.array(starts, np.int64)


def _halved(values: np.ndarray, combine: np.ufunc) -> np.ndarray:
    """Of each square of two by two values (h, w) what `combine` makes of it; of what is left at the borders too."""
    for axis in range(2):
        first, second = (values[start::2] if axis == 0 else values[:, start::2] for start in range(2))
        values = first.copy()
        pairs = values[: len(second), : second.shape[1]]
        combine(pairs, second, out=pairs)
    return values


@kernel()
def _edges(x: np.ndarray, y: np.ndarray, lines: np.ndarray) -> int:
    """Lines (3, 3) float64 (a, b, c) along a triangle's edges, a x + b y + c the distance inwards; how many there are:
    edges without length have none.
    """
    area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    sign = -1.0 if area < 0.0 else 1.0
    count = 0
    for k in range(3):
        n = (k + 1) % 3
        a, b = sign * (y[k] - y[n]), sign * (x[n] - x[k])
        length = np.sqrt(a * a + b * b)
        if length > _TOUCH * _TOUCH:
            lines[count, 0], lines[count, 1] = a / length, b / length
            lines[count, 2] = -(lines[count, 0] * x[k] + lines[count, 1] * y[k])
            count += 1
    return count


@kernel()
def _tiles(lo: float, hi: float, size: int) -> tuple[int, int]:
    """The first and the last tile of `size` texels that an interval touches."""
    first = int(np.floor((lo + _TOUCH) / size))
    return first, max(first, int(np.ceil((hi - _TOUCH) / size)) - 1)


@kernel()
def _shortened(lo: float, hi: float, size: int, wrap: int) -> tuple[float, float]:
    """An interval of a rectangle's side, moved to where it shows the same texels, and no longer than it needs to be."""
    if wrap == 1:
        lo = min(max(lo, 0.0), size - 4 * _TOUCH)
        return lo, min(max(hi, lo + 4 * _TOUCH), float(size))
    if hi - lo >= (size if wrap == 0 else 2 * size):
        return 0.0, float(size)
    period = size * 2 if wrap == 2 else size
    shift = np.floor(lo / period) * period
    return lo - shift, hi - shift


@allocating_kernel()
def _over(
    alpha: np.ndarray,
    least: np.ndarray,
    greatest: np.ndarray,
    total: np.ndarray,
    starts: np.ndarray,
    places: np.ndarray,
    triangles: np.ndarray,
    wrap_u: int,
    wrap_v: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """See `TextureAlpha.over`; places (n, 2) float64 in texels, the pyramid as `_pyramid` gives it."""
    height, width = alpha.shape
    top = len(starts) - 1
    found_least = np.empty(len(triangles), np.uint8)
    found_mean = np.empty(len(triangles))
    found_greatest = np.empty(len(triangles), np.uint8)
    stack = np.empty((4 * (top + 1), 3), np.int64)
    x, y, u, v = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    lines = np.empty((3, 3))
    for t in range(len(triangles)):
        for k in range(3):
            x[k], y[k] = places[triangles[t, k], 0], places[triangles[t, k], 1]
        x0, x1 = min(x[0], x[1], x[2]), max(x[0], x[1], x[2])
        y0, y1 = min(y[0], y[1], y[2]), max(y[0], y[1], y[2])
        if max(-x0, x1, -y0, y1) > _FAR:
            found_least[t], found_greatest[t] = least[starts[top] - 1], greatest[starts[top] - 1]
            found_mean[t] = total[starts[top] - 1] / alpha.size
            continue
        box = x1 - x0 < 4 * _TOUCH or y1 - y0 < 4 * _TOUCH
        box = box or (wrap_u == 1 and (x0 < 0.0 or x1 > width)) or (wrap_v == 1 and (y0 < 0.0 or y1 > height))
        if not box:
            (i0, i1), (j0, j1) = _tiles(x0, x1, width), _tiles(y0, y1, height)
            box = (i1 - i0 + 1) * (j1 - j0 + 1) > _TILES
        if box:
            x0, x1 = _shortened(x0, max(x1, x0 + 4 * _TOUCH), width, wrap_u)
            y0, y1 = _shortened(y0, max(y1, y0 + 4 * _TOUCH), height, wrap_v)
            (i0, i1), (j0, j1) = _tiles(x0, x1, width), _tiles(y0, y1, height)
        fine = max(x1 - x0, y1 - y0) * _FINENESS
        low, high, sums, weight = 255, 0, 0.0, 0.0
        for j in range(j0, j1 + 1):
            over_v = wrap_v == 2 and j % 2 != 0
            for i in range(i0, i1 + 1):
                over_u = wrap_u == 2 and i % 2 != 0
                # the shape in this tile's own texels
                for k in range(3):
                    u[k] = (i + 1) * width - x[k] if over_u else x[k] - i * width
                    v[k] = (j + 1) * height - y[k] if over_v else y[k] - j * height
                u0 = (i + 1) * width - x1 if over_u else x0 - i * width
                v0 = (j + 1) * height - y1 if over_v else y0 - j * height
                u1, v1 = u0 + (x1 - x0), v0 + (y1 - y0)
                edges = 0 if box else _edges(u, v, lines)
                stack[0, 0], stack[0, 1], stack[0, 2] = top, 0, 0
                depth = 1
                while depth:
                    depth -= 1
                    level, row, column = stack[depth, 0], stack[depth, 1], stack[depth, 2]
                    side = 1 << level
                    left, right = column * side, min((column + 1) * side, width)
                    upper, lower = row * side, min((row + 1) * side, height)
                    if left >= u1 - _TOUCH or right <= u0 + _TOUCH or upper >= v1 - _TOUCH or lower <= v0 + _TOUCH:
                        continue
                    inside = left >= u0 - _TOUCH and right <= u1 + _TOUCH
                    inside = inside and upper >= v0 - _TOUCH and lower <= v1 + _TOUCH
                    outside = False
                    share = (min(right, u1) - max(left, u0)) / (right - left)
                    share *= (min(lower, v1) - max(upper, v0)) / (lower - upper)
                    for k in range(edges):
                        a, b, c = lines[k, 0], lines[k, 1], lines[k, 2]
                        most = a * (right if a > 0 else left) + b * (lower if b > 0 else upper) + c
                        fewest = a * (left if a > 0 else right) + b * (upper if b > 0 else lower) + c
                        outside = outside or most <= _TOUCH
                        inside = inside and fewest >= -_TOUCH
                        share = min(share, most / (most - fewest))
                    if outside:
                        continue
                    if level == 0:
                        lo = hi = int(alpha[row, column])
                        part = float(lo)
                    else:
                        at = starts[level - 1] + row * ((width + side - 1) // side) + column
                        lo, hi, part = int(least[at]), int(greatest[at]), float(total[at])
                    settled = lo >= low and hi <= high and side <= fine
                    if inside or level == 0 or settled:
                        share = 1.0 if inside else max(share, _TOUCH)
                        if inside or level == 0:
                            low, high = min(low, lo), max(high, hi)
                        sums += share * part
                        weight += share * (right - left) * (lower - upper)
                        continue
                    half = side // 2
                    for below in range(2):
                        for beside in range(2):
                            if (2 * column + beside) * half < width and (2 * row + below) * half < height:
                                stack[depth, 0] = level - 1
                                stack[depth, 1], stack[depth, 2] = 2 * row + below, 2 * column + beside
                                depth += 1
        if weight == 0.0:  # no more than the borders of texels are touched: what is in the middle counts
            i, j = int((x[0] + x[1] + x[2]) / 3) % width, int((y[0] + y[1] + y[2]) / 3) % height
            low = high = int(alpha[j, i])
            sums, weight = float(low), 1.0
        found_least[t], found_greatest[t] = low, high
        found_mean[t] = min(max(sums / weight, float(low)), float(high))
    return found_least, found_mean, found_greatest
