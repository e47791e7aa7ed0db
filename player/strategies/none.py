"""No culling, no levels: everything at full detail. What all other strategies are compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from player.camera.view import Vector, View
from player.shown_model import ShownModel
from player.strategies.strategy import Choice


class NoCulling:
    """Draws the finest level of every leaf, always."""

    def __init__(self, model: ShownModel, *, pixel_error: float, wait: bool = True) -> None:  # noqa: ARG002
        self.pixel_error = pixel_error  # has no effect here
        self._model = model
        self._everything = model.first_drawable[model.leaves]

    def choose(self, view: View) -> Choice:
        """The whole model."""
        cell = int(self._model.store.cell_at(view.position[None])[0])
        return Choice(self._everything, cell, computed=False)

    def ahead(self, view: View, motion: Vector) -> NDArray[np.int64] | None:  # noqa: ARG002
        """Nothing more: the whole model is drawn already."""
        return None

    def close(self) -> None:
        """Nothing runs."""
