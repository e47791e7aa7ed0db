"""Meshes of formats that know one kind of alpha only: how much of what is behind is hidden."""

from __future__ import annotations

import numpy as np

from jobs.importing.reading.see_through import AlphaMode, see_through
from jobs.importing.reading.source_scene import SourceMesh
from jobs.importing.reading.texture_alpha import AlphaOver, TextureAlpha, Wrap


class Alphas:
    """The alpha of textures over a mesh's triangles: opaque wherever there is none."""

    def __init__(self) -> None:
        self._over: AlphaOver | None = None

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
        if self._over is None:
            opaque = np.full(len(triangles), 255, np.uint8)
            self._over = AlphaOver(opaque, opaque.astype(np.float64), opaque.copy())
        for all_of_them, some in zip(self._over, image.over(places, triangles[which], wrap), strict=True):
            all_of_them[which] = some

    def blend(self, mesh: SourceMesh) -> None:
        """Settle the alpha of a mesh with colours, whose own alpha counts times the textures'."""
        if self._over is None or mesh.colours is None:
            return
        found = see_through(mesh.triangles, mesh.colours[:, 3] / 255, AlphaMode.BLEND, 0.0, self._over)
        colours = mesh.colours[found.vertices]
        colours[:, 3] = found.alpha
        mesh.positions, mesh.triangles, mesh.colours = mesh.positions[found.vertices], found.triangles, colours
        if mesh.normals is not None:
            mesh.normals = mesh.normals[found.vertices]
