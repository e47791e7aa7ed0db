"""What drawables cover of a picture, by rays: an oracle for cracks and holes that shares no code with the build.

Backs of one-sided drawables are not seen, as in the player, so a crack in the front of a closed solid shows the sky and
not the solid's inside. Rays go through the centres of pixels, and close past the drawables' borders, where cracks are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from jobs.checking.oracle import Oracle
from player.camera.view import View
from storage.geometry_reader import Geometry

#: Embree's single precision lets rays slip between triangles that meet along an edge. A miss counts only if in double
#: precision, too, the ray passes every triangle by more than this part of the triangle.
SLACK = 1e-6
#: Rays past borders miss them by these parts of a pixel: from, to.
BESIDE = (1e-3, 0.1)


class Shown(NamedTuple):
    """Drawables ready for rays."""

    triangles: np.ndarray  # (m, 3, 3) float32, model units
    owner: np.ndarray  # (m,) int64: the drawable
    one_sided: np.ndarray  # (m,) bool
    oracle: Oracle


def shown(geometry: Geometry, drawables: np.ndarray, *, fronts_only: bool = False) -> Shown:
    """The surfaces of drawables (d,), sorted ids; fronts_only: no backs count, as the model is closed."""
    surfaces = geometry.surfaces(drawables)
    points = (surfaces.points * np.float64(geometry.grid.step)).astype(np.float32)
    owner = np.repeat(drawables, geometry.drawables["triangles"][drawables].astype(np.int64))
    return of_triangles(points[surfaces.triangles], owner, geometry.drawables["one_sided"][owner] | fronts_only)


def of_triangles(triangles: np.ndarray, owner: np.ndarray, one_sided: np.ndarray) -> Shown:
    """The same of triangles (m, 3, 3)."""
    return Shown(triangles, owner, one_sided, Oracle(triangles, owner, one_sided))


class Faults(NamedTuple):
    """Where a cut's picture differs from the finest model's by more than it may."""

    holes: int  # rays through the background where the finest model covers all around
    overhangs: int  # pixels that the cut covers where the finest model covers nothing around
    looked_at: int  # pixels that the finest model covers with all around them


def faults(finest: Shown, cut: Shown, view: View, pixels: float, *, seams: float = 0.0, aimed: int = 4000) -> Faults:
    """Compares a cut with the finest model as seen in a view.

    pixels: the allowed error; what lies within that and one more from the finest model's outlines is left out. seams:
    distance in pixels from what is covered up to which background is let pass: where two solids touch, each may retreat
    by the allowed error; 0: nothing passes, however narrow. aimed: rays past borders.
    """
    size = (view.height, view.width)
    directions = _through_pixels(view)
    whole = _covered(finest, view, directions).reshape(size)
    drawn = _covered(cut, view, directions)
    margin = np.ceil(pixels) + 1
    inside = distance_transform_edt(np.pad(whole, 1))[1:-1, 1:-1] > margin
    outside = (distance_transform_edt(~whole) > margin) if whole.any() else ~whole
    suspects = directions[(inside & (distance_transform_edt(~drawn.reshape(size)) > seams)).reshape(-1)]
    if not seams:
        past = _past_borders(cut, view, aimed)
        row, column = _pixel(view, past)
        within = (row >= 0) & (row < view.height) & (column >= 0) & (column < view.width)
        past = past[within][inside[row[within], column[within]]]
        suspects = np.concatenate([suspects, past[~_covered(cut, view, past)]])
    return Faults(_missing(cut, view, suspects), int((outside.reshape(-1) & drawn).sum()), int(inside.sum()))


def _half(view: View) -> float:
    return float(np.tan(np.radians(view.field_of_view) / 2))


def _through_pixels(view: View) -> np.ndarray:
    """Directions (height * width, 3) float32 through the pixels' centres."""
    x = ((np.arange(view.width) + 0.5) / view.width * 2 - 1) * _half(view) * view.width / view.height
    y = (1 - (np.arange(view.height) + 0.5) / view.height * 2) * _half(view)
    camera = np.stack([*np.meshgrid(x, y), -np.ones((view.height, view.width))], axis=-1).reshape(-1, 3)
    return (camera @ view.rotation.T).astype(np.float32)


def _pixel(view: View, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (k,) of directions (k, 3); -1 for those behind."""
    camera = directions.astype(np.float64) @ view.rotation
    ahead = camera[:, 2] < 0
    at = camera[:, :2] / np.where(ahead, -camera[:, 2], 1.0)[:, None] / _half(view)
    column = np.floor((at[:, 0] * view.height / view.width + 1) / 2 * view.width)
    row = np.floor((1 - at[:, 1]) / 2 * view.height)
    return np.where(ahead, row, -1).astype(np.int64), np.where(ahead, column, -1).astype(np.int64)


def _past_borders(what: Shown, view: View, count: int) -> np.ndarray:
    """Directions (count, 3) float32 close past points on edges that have one triangle of their drawable only."""
    ids = np.unique(what.triangles.reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(-1, 3)
    edges = np.sort(np.concatenate([ids[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    ends = np.concatenate([what.triangles[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.float64)
    keyed = np.column_stack([np.tile(what.owner, 3), edges])
    _, first, counts = np.unique(keyed, axis=0, return_index=True, return_counts=True)
    borders = ends[first[counts == 1]]
    if not len(borders):
        return np.zeros((0, 3), np.float32)
    rng = np.random.default_rng(0)
    chosen = borders[rng.integers(0, len(borders), count)]
    where = rng.random((count, 1))
    directions = chosen[:, 0] * (1 - where) + chosen[:, 1] * where - view.position
    pixel = 2 * _half(view) / view.height * np.linalg.norm(directions, axis=1, keepdims=True)
    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    directions += away * pixel * np.exp(rng.uniform(*np.log(BESIDE), (count, 1)))
    return directions.astype(np.float32)


def _covered(what: Shown, view: View, directions: np.ndarray) -> np.ndarray:
    """Which rays (n,) bool hit something."""
    origins = np.tile(view.position.astype(np.float32), (len(directions), 1))
    return what.oracle.cast(origins, directions)[0] >= 0


def _missing(what: Shown, view: View, directions: np.ndarray) -> int:
    """How many of the rays miss everything in double precision, too."""
    corners = what.triangles.astype(np.float64) - view.position.astype(np.float32).astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    planes = [np.cross(corners[:, k], corners[:, (k + 1) % 3]) for k in range(3)]
    seen_from = -(normals * corners[:, 0]).sum(axis=1)  # positive: the eye is in front
    missed = 0
    for direction in directions.astype(np.float64):
        sides = np.stack([plane @ direction for plane in planes])
        sides *= -np.sign(seen_from)  # positive inside the edge, whichever side is seen
        inside = (sides >= -SLACK * np.abs(sides).sum(axis=0)).all(axis=0) & (sides.sum(axis=0) > 0)
        missed += not (inside & ((seen_from > 0) | ~what.one_sided)).any()
    return missed
