"""The triangles of drawables, as the engine takes them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from jobs.visibility.settings import EngineSettings
from jobs.visibility.surfaces.soup import Soup, build_soup
from storage.geometry_reader import Geometry


def gather(store: Geometry, ids: np.ndarray, settings: EngineSettings) -> Soup:
    """The triangles of drawables (d,), sorted ids."""
    rows = store.drawables[ids]
    surfaces = store.surfaces(ids)
    return build_soup(
        ids, rows["one_sided"], rows["see_through"], surfaces.points, surfaces.triangles, surfaces.triangle_counts,
        settings.cluster_size, settings.seal / store.grid.step,
    )  # fmt: skip


def used(store: Geometry, cuts: Iterable[np.ndarray]) -> np.ndarray:
    """Ids (n,) int64, sorted, of all drawables that occur in any of the cuts."""
    found = np.zeros(len(store.drawables), np.bool_)
    for cut in cuts:
        found[cut] = True
    return np.flatnonzero(found)
