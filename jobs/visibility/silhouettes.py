"""The pixels that silhouettes spoil: up to which depth band each pixel of a core stays hidden behind its set.

Unsafe edges are inflated for each band (see `cube_faces`), and the inflated images are drawn into the core's window:
a sweep of a rectangle, row by row. They grow from band to band, so a row is gone over once, ring by ring.

Based on: X. Décoret, G. Debunne, F. Sillion: Erosion Based Visibility Preprocessing, Eurographics Symposium on
Rendering 2003, for the erosion; see `occluders` for what the limits are used for.
"""

from __future__ import annotations

import numpy as np

from jobs.visibility.cube_faces import inflate_edge
from storage.kernels import kernel

#: The numbers that describe a sweep to `_span`: where its rectangle begins, how that changes along the sweep, the
#: inverses of how its ends in v change (0 where they do not), and its extent in v.
_U0, _U1, _V0, _V1, _DU0, _DU1, _PER_V0, _PER_V1, _LEAST, _MOST = range(10)
SPAN_NUMBERS = 10
#: Positions along a sweep are rounded outward by this much. (Rounding in v is covered by cube_faces.SLACK.)
_ALONG = 1e-12


@kernel()
def find_limits(
    q: np.ndarray,
    unsafe: np.ndarray,
    n_unsafe: int,
    face: int,
    resolution: int,
    bands: np.ndarray,
    first_band: int,
    window: tuple[int, int, int, int],
    sweep: np.ndarray,
    spans: np.ndarray,
    rows: np.ndarray,
    limit: np.ndarray,
) -> bool:
    """Lower `limit` in the window to the first band >= first_band in which an unsafe edge spoils the pixel.

    Args:
        q: (n, 3) float64 cell coordinates; unsafe: (n_unsafe or more, 2) int32 vertices of edges.
        bands: (b,) float64 increasing depths; window: (i0, i1, j0, j1) pixels, both ends included.
        sweep: (4, 4) float64, spans: (b, 2, SPAN_NUMBERS) float64, rows: (r, 2) int32 scratch.
        limit: (r, r) uint8: where it is 0 pixels are of no interest, elsewhere in the window it is b.

    Returns:
        False where nothing is left in any band: inflation grows with depth, so what is spoilt in the first band is
        spoilt in all.
    """
    i0, i1, j0, j1 = window
    alive = _find_rows(limit, first_band, i0, i1, j0, j1, rows)
    for k in range(n_unsafe):
        if alive == 0:
            return False
        alive -= _paint(
            q, unsafe[k, 0], unsafe[k, 1], face, resolution, bands, first_band, first_band + 1,
            i0, i1, j0, j1, sweep, spans, rows, limit,
        )  # fmt: skip
    if alive == 0:
        return False
    _find_rows(limit, first_band, i0, i1, j0, j1, rows)
    for k in range(n_unsafe):
        _paint(
            q, unsafe[k, 0], unsafe[k, 1], face, resolution, bands, first_band + 1, bands.shape[0],
            i0, i1, j0, j1, sweep, spans, rows, limit,
        )  # fmt: skip
    return True


@kernel()
def _find_rows(limit: np.ndarray, band: int, i0: int, i1: int, j0: int, j1: int, rows: np.ndarray) -> int:
    """Fill `rows` with the first and the last pixel of each row whose limit is above a band; returns how many are."""
    count = 0
    for j in range(j0, j1 + 1):
        first, last = i1 + 1, i0 - 1
        for i in range(i0, i1 + 1):
            if limit[j, i] > band:
                first = min(first, i)
                last = i
                count += 1
        rows[j, 0], rows[j, 1] = first, last
    return count


@kernel()
def _paint(
    q: np.ndarray,
    a: int,
    b: int,
    face: int,
    resolution: int,
    bands: np.ndarray,
    begin: int,
    end: int,
    i0: int,
    i1: int,
    j0: int,
    j1: int,
    sweep: np.ndarray,
    spans: np.ndarray,
    rows: np.ndarray,
    limit: np.ndarray,
) -> int:
    """Lower `limit` to the first band of begin ... end - 1 for which edge a-b, inflated, touches a pixel in `rows`.

    Where rounding would let a row's extent shrink from one band to the next, the extents' union counts.
    Returns how many pixels were lowered.
    """
    # the sweeps of the bands that reach the window, from the widest on; what misses it in one misses it in those before
    begin_0, begin_1 = end, end
    for band in range(end - 1, begin - 1, -1):
        n = inflate_edge(q, a, b, face, resolution, bands[band], sweep)
        reaches = False
        if n >= 1 and begin_0 == band + 1 and _prepare(sweep, 0, spans, band, i0, i1, j0, j1):
            begin_0 = band
            reaches = True
        if n == 2 and begin_1 == band + 1 and _prepare(sweep, 1, spans, band, i0, i1, j0, j1):
            begin_1 = band
            reaches = True
        if not reaches:
            break
    lowered = 0
    for k in range(2):
        first_band = begin_0 if k == 0 else begin_1
        if first_band == end:
            continue
        row0 = int(np.floor(max(spans[end - 1, k, _LEAST], j0)))
        row1 = int(np.floor(min(spans[end - 1, k, _MOST], j1)))
        for j in range(row0, row1 + 1):
            least, most = rows[j, 0], rows[j, 1]
            done_first, done_last = most + 1, least - 1  # pixels gone over: none
            for band in range(first_band, end):
                if done_first <= least and done_last >= most:
                    break
                left, right = _span(spans, band, k, j)
                if left > right or left >= most + 1 or right < least:
                    continue
                first = int(np.floor(left)) if left > least else least
                last = int(np.floor(right)) if right < most else most
                if done_first > done_last:
                    done_first, done_last = first, first - 1
                for i in range(first, done_first):
                    if limit[j, i] > band:
                        limit[j, i] = band
                        lowered += 1
                for i in range(done_last + 1, last + 1):
                    if limit[j, i] > band:
                        limit[j, i] = band
                        lowered += 1
                done_first, done_last = min(done_first, first), max(done_last, last)
    return lowered


@kernel(inline="always")
def _prepare(sweep: np.ndarray, k: int, spans: np.ndarray, band: int, i0: int, i1: int, j0: int, j1: int) -> bool:
    """Work out the numbers of sweep k of a band; False where it misses the window."""
    a, b = 2 * k, 2 * k + 1
    least, most = min(sweep[a, 2], sweep[b, 2]), max(sweep[a, 3], sweep[b, 3])
    if (
        least > j1 + 1 or most < j0
        or min(sweep[a, 0], sweep[b, 0]) > i1 + 1 or max(sweep[a, 1], sweep[b, 1]) < i0
    ):  # fmt: skip
        return False
    spans[band, k, _U0], spans[band, k, _U1] = sweep[a, 0], sweep[a, 1]
    spans[band, k, _V0], spans[band, k, _V1] = sweep[a, 2], sweep[a, 3]
    spans[band, k, _DU0], spans[band, k, _DU1] = sweep[b, 0] - sweep[a, 0], sweep[b, 1] - sweep[a, 1]
    rise0, rise1 = sweep[b, 2] - sweep[a, 2], sweep[b, 3] - sweep[a, 3]
    spans[band, k, _PER_V0] = 1.0 / rise0 if rise0 != 0.0 else 0.0
    spans[band, k, _PER_V1] = 1.0 / rise1 if rise1 != 0.0 else 0.0
    spans[band, k, _LEAST], spans[band, k, _MOST] = least, most
    return True


@kernel(inline="always")
def _span(spans: np.ndarray, band: int, k: int, j: int) -> tuple[float, float]:
    """The extent in u of sweep k of a band where j <= v <= j + 1; the first above the second where it misses.

    The rectangles of a sweep that meet the strip are those of a range of positions along it, as both ends of a
    rectangle in v change linearly. The hull's part in the strip is convex, so it touches every pixel between.
    """
    if j > spans[band, k, _MOST] or j + 1.0 < spans[band, k, _LEAST]:
        return 1.0, 0.0
    t0, t1 = 0.0, 1.0
    per = spans[band, k, _PER_V0]
    t = (j + 1.0 - spans[band, k, _V0]) * per
    if per > 0:
        t1 = min(t1, t + _ALONG)
    elif per < 0:
        t0 = max(t0, t - _ALONG)
    per = spans[band, k, _PER_V1]
    t = (j - spans[band, k, _V1]) * per
    if per > 0:
        t0 = max(t0, t - _ALONG)
    elif per < 0:
        t1 = min(t1, t + _ALONG)
    if t0 > t1:
        return 1.0, 0.0
    du0, du1 = spans[band, k, _DU0], spans[band, k, _DU1]
    return spans[band, k, _U0] + min(t0 * du0, t1 * du0), spans[band, k, _U1] + max(t0 * du1, t1 * du1)
