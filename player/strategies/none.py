"""No culling, no levels: everything at full detail. What all other strategies are compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from player.camera.view import Vector, View
from player.scene import Scene
from player.strategies.strategy import Choice


class NoCulling:
    """Draws the finest level of every leaf, always."""

    name = "none"

    def __init__(self, scene: Scene, *, pixel_error: float) -> None:
        self.pixel_error = pixel_error  # has no effect here
        self._scene = scene
        self._everything = scene.first_drawable[scene.leaves]

    def choose(self, view: View) -> Choice:
        """The whole model."""
        cell = int(self._scene.store.cell_at(view.position[None])[0])
        return Choice(self._everything, cell, computed=False)

    def ahead(self, view: View, motion: Vector) -> NDArray[np.int64] | None:  # noqa: ARG002
        """Nothing more: the whole model is drawn already."""
        return None

    def close(self) -> None:
        """Nothing runs."""
