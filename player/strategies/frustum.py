"""Culling at run time: the hierarchy is walked from its root, past nodes whose boxes the view frustum does not touch,
down to those of which a level suffices for the eye.

Needs nothing precomputed but the levels: it is also what is drawn where no cell was computed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from player.camera.view import Boxes, Vector, View, boxes_in_frustum
from player.shown_model import ShownModel
from player.strategies.strategy import Choice
from storage.model.cut import Wanted, box_distance, choose_cut

#: The surroundings are chosen anew when the eye has moved by this part of the model's diagonal.
_AHEAD_STEP = 0.01


class Frustum:
    """View-frustum culling with level of detail by distance."""

    def __init__(self, model: ShownModel, *, pixel_error: float, wait: bool = True) -> None:  # noqa: ARG002
        self.pixel_error = pixel_error
        self._model = model
        self._ahead_from: Vector | None = None

    def choose(self, view: View) -> Choice:
        """The drawables in the frustum."""
        cell = int(self._model.store.cell_at(view.position[None])[0])
        boxes = self._model.node_boxes

        def wanted(nodes: NDArray[np.int64]) -> NDArray[np.bool_]:
            return boxes_in_frustum(view, Boxes(boxes.centre[nodes], boxes.half[nodes]))

        return Choice(self._cut(view.position, wanted), cell, computed=False)

    def ahead(self, view: View, motion: Vector) -> NDArray[np.int64] | None:
        """The whole surroundings of where the eye will be, the nearest first."""
        known = self._ahead_from
        if known is not None and np.abs(view.position - known).max() < _AHEAD_STEP * self._model.extent:
            return None
        self._ahead_from = view.position
        eye = view.position + motion
        ids = self._cut(eye, None)
        rows = self._model.store.drawables[ids]
        distance = box_distance(eye, eye, rows["lo"], rows["hi"])
        return ids[np.argsort(distance, kind="stable")]

    def close(self) -> None:
        """Nothing runs."""

    def _cut(self, eye: Vector, wanted: Wanted | None) -> NDArray[np.int64]:
        store = self._model.store
        angle = store.manifest.pixel_angle
        return choose_cut(store.nodes, store.drawables, eye, eye, angle, self.pixel_error, wanted)
