"""Meshes of formats that know one kind of alpha only: how much of what is behind is hidden."""

from __future__ import annotations

import numpy as np

from jobs.importing.reading.see_through import AlphaMode, see_through
from jobs.importing.reading.source_scene import SourceMesh
from jobs.importing.reading.texture_alpha import AlphaOver, TextureAlpha, Wrap


class Alphas:
    """The alpha of textures over a mesh's triangles: opaque wherever there is none."""

    def __init__(self, triangles: int) -> None:
        """Of that many triangles, all opaque at first."""
        self._over = AlphaOver(
            np.full(triangles, 255, np.uint8), np.full(triangles, 255.0), np.full(triangles, 255, np.uint8)
        )
        self._given = False

    def take(
        self,
        which: np.ndarray,
        image: TextureAlpha,
        places: np.ndarray,
        triangles: np.ndarray,
        wrap: tuple[Wrap, Wrap] = (Wrap.REPEAT, Wrap.REPEAT),
    ) -> None:
        """Some triangles, `which` (m,) bool, show `image` at `places` (n, 2), indexed by the mesh's `triangles`."""
        if image.opaque or not which.any():
            return
        found = image.over(places, triangles[which], wrap)
        for all_of_them, some in zip(self._over, found, strict=True):
            all_of_them[which] = some
        self._given = True

    def blend(self, mesh: SourceMesh) -> None:
        """Settle the alpha of a mesh with colours, whose own alpha counts times the textures'."""
        if mesh.colours is None:
            return
        found = see_through(
            mesh.triangles, mesh.colours[:, 3] / 255, AlphaMode.BLEND, 0.0, self._over if self._given else None
        )
        colours = mesh.colours[found.vertices]
        colours[:, 3] = found.alpha
        mesh.positions, mesh.triangles, mesh.colours = mesh.positions[found.vertices], found.triangles, colours
        if mesh.normals is not None:
            mesh.normals = mesh.normals[found.vertices]
