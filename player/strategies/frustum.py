"""Culling at run time: the nodes whose boxes touch the view frustum, each at the level that suffices for the eye.

Needs nothing precomputed but the levels: it is also what is drawn where no cell was computed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from player.scene import Scene
from player.strategies.strategy import Choice
from player.view import Vector, View, boxes_in_frustum
from storage.detail import box_distance, choose_levels

#: The surroundings are chosen anew when the eye has moved by this part of the model's diagonal.
_AHEAD_STEP = 0.01


class Frustum:
    """View-frustum culling with level of detail by distance."""

    name = "frustum"

    def __init__(self, scene: Scene, *, pixel_error: float) -> None:
        self.pixel_error = pixel_error
        self._scene = scene
        self._ahead_from: Vector | None = None

    def choose(self, view: View) -> Choice:
        """The drawables in the frustum."""
        cell = int(self._scene.store.cell_at(view.position[None])[0])
        inside = boxes_in_frustum(view, self._scene.node_boxes)
        return Choice(self._cut(view.position, inside), cell, computed=False)

    def ahead(self, view: View, motion: Vector) -> NDArray[np.int64] | None:
        """The whole surroundings of where the eye will be, the nearest first."""
        known = self._ahead_from
        if known is not None and np.abs(view.position - known).max() < _AHEAD_STEP * self._scene.extent:
            return None
        self._ahead_from = view.position
        eye = view.position + motion
        ids = self._cut(eye, np.ones(len(self._scene.levels), np.bool_))
        distance = box_distance(eye, eye, self._scene.drawable_lo[ids], self._scene.drawable_hi[ids])
        return ids[np.argsort(distance, kind="stable")]

    def close(self) -> None:
        """Nothing runs."""

    def _cut(self, eye: Vector, which: NDArray[np.bool_]) -> NDArray[np.int64]:
        store = self._scene.store
        return choose_levels(
            store.nodes[which], store.drawables, eye, eye, store.manifest.pixel_angle, self.pixel_error
        )
