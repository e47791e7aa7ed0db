"""One level coarser: edge collapses by fast-simplification, with open borders held in place.

The collapses are those of fast-simplification (edge collapses by quadric error, in passes with a rising threshold).
Around it:
- the mesh is scaled so that its mean edge is 1, where the library's thresholds, absolute numbers, are fine enough;
- along open edges, and along folds where a sheet turns back on itself, the library sees no reason not to eat into a
  flat surface: a small triangle at right angles is added on each such edge, whose plane holds the edge in place;
- locked vertices (borders to other pieces) get a loose triangle each, which makes the library take them for border
  vertices even where the border's edges have several triangles; borders are then preserved altogether;
- the collapses are replayed, so each triangle that is left is known by its original, and the added ones are taken out.

Based on: M. Garland, P. S. Heckbert, Surface Simplification Using Quadric Error Metrics, SIGGRAPH 1997 (quadrics, and
planes at right angles along borders).
"""

from __future__ import annotations

from threading import Lock

import fast_simplification
import numpy as np

from jobs.detail.collapse_input import cleaned, scaled_with_rims, survivors
from storage.tables import GRID_LIMIT

_LIBRARY = Lock()


def coarser(
    points: np.ndarray, triangles: np.ndarray, twin: np.ndarray, locked: np.ndarray, target: int, closed: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Simplify grid points (n, 3) int32, triangles (m, 3) int32, to about `target` triangles, on the same grid.

    twin (3 m,): the paired half-edges. locked: indices of vertices that must stay, int32; where there are any, all open
    borders stay. closed: the surface has no border but the locked one.

    fast-simplification keeps the mesh in globals between the steps of one call. It sets all of them anew in each call,
    so nothing of an earlier one shows; but calls from several threads must wait for each other.
    """
    whole, faces, centre, scale, staying = scaled_with_rims(points, triangles, twin, locked, len(locked) == 0)
    added = len(faces) - len(triangles)
    with _LIBRARY:
        new_points, new_faces, collapses = fast_simplification.simplify(
            whole, faces, target_count=target + staying, return_collapses=True, preserve_border=len(locked) > 0
        )
    left = survivors(faces, collapses, len(whole))
    own = new_faces[left >= added]
    # positions that its linear systems have sent off to nowhere are caught here; the error then tells what they did
    snapped = np.rint(np.nan_to_num(new_points) / scale + centre)
    return cleaned(np.clip(snapped, -GRID_LIMIT, GRID_LIMIT).astype(np.int32), own, closed)
