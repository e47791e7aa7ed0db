"""Which triangles can be seen through, by a material's alpha mode: the alpha of their corners says so.

A triangle can be seen through if and only if a corner of it has an alpha below 255. Textures are not drawn, so a
triangle whose texture has holes or is thin anywhere on it bears its mean alpha at all three corners, which are vertices
of its own then.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from jobs.importing.reading.faces.corners import unify
from jobs.importing.reading.texture_alpha import AlphaOver


class AlphaMode(Enum):
    """What alpha means."""

    OPAQUE = "nothing: it is ignored"
    MASK = "what has less than a cutoff is not there, the rest is opaque"
    BLEND = "how much of what is behind a surface is hidden by it"


#: The alpha of what can be seen through but is there: never nothing, never opaque.
FAINTEST, DENSEST = 1, 254


class SeenThrough(NamedTuple):
    """Vertices and triangles of a mesh whose alpha is settled."""

    vertices: np.ndarray  # (k,) int64: the vertex that each vertex was
    triangles: np.ndarray  # (m, 3) int64: of those vertices; -1 where a triangle's index is out of range
    alpha: np.ndarray  # (k,) uint8


def see_through(
    triangles: np.ndarray, alpha: np.ndarray, mode: AlphaMode, cutoff: float, texture: AlphaOver | None
) -> SeenThrough:
    """The alpha of a mesh's vertices.

    triangles (m, 3) int64, of which indices may be out of range; alpha (n,) float64: of vertices, times the material's,
    without the texture's; cutoff: what `AlphaMode.MASK` keeps has this alpha or more; texture: over each of the m
    triangles (see `TextureAlpha.over`; whatever where an index is out of range), None without one. What is no number
    in alpha counts as 1.

    Alpha that rounds to 255 is opaque. Triangles of which nothing is to be seen, because they are below the cutoff or
    invisible everywhere, have an alpha of 0 at all corners: `jobs.importing.repair` leaves them out and counts them.
    """
    alpha = np.clip(np.nan_to_num(np.asarray(alpha, np.float64), nan=1.0), 0.0, 1.0)
    solid = texture is None or bool((texture.least == 255).all())
    drawn = mode is not AlphaMode.MASK or cutoff <= 1
    if mode is AlphaMode.OPAQUE or not len(alpha) or (solid and drawn and bool((alpha == 1).all())):
        return SeenThrough(np.arange(len(alpha)), triangles, np.full(len(alpha), 255, np.uint8))
    if mode is AlphaMode.BLEND and solid:
        return SeenThrough(np.arange(len(alpha)), triangles, _byte(alpha, 255))
    valid: np.ndarray = np.all((triangles >= 0) & (triangles < len(alpha)), axis=1)
    corners = alpha[np.where(valid[:, None], triangles, 0)]
    least, mean, greatest = corners.min(axis=1), corners.mean(axis=1), corners.max(axis=1)
    if texture is not None:
        least, greatest = least * (texture.least / 255), greatest * (texture.greatest / 255)
        mean = mean * (texture.mean / 255)
    if mode is AlphaMode.MASK:
        opaque, absent = least >= cutoff, greatest < cutoff
    else:
        opaque, absent = np.rint(least * 255) == 255, greatest == 0
    faces = np.where(opaque, np.uint8(255), np.where(absent, np.uint8(0), _byte(np.maximum(mean, 1e-9), DENSEST)))
    if valid.all() and len(faces) and (faces == faces[0]).all():
        return SeenThrough(np.arange(len(alpha)), triangles, np.full(len(alpha), faces[0], np.uint8))
    flat = np.where(valid[:, None], triangles, -1).reshape(-1)
    of_corners = np.repeat(faces, 3)
    kept, vertex = unify(np.stack([flat, of_corners.astype(np.int64)], axis=1))
    return SeenThrough(np.maximum(flat[kept], 0), np.where(valid[:, None], vertex.reshape(-1, 3), -1), of_corners[kept])


def _byte(alpha: np.ndarray, most: int) -> np.ndarray:
    """Alpha, 0 to 1, as bytes up to `most`; only what is exactly 0 becomes 0."""
    return np.where(alpha == 0, 0, np.clip(np.rint(alpha * 255), FAINTEST, most)).astype(np.uint8)
