"""What a culling strategy is: it answers which drawables to draw for a view, and which may be needed soon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from player.camera.view import Vector, View
from player.renderer.facet_table import CellBox
from player.shown_model import ShownModel
from storage.base.errors import StoreError


@dataclass(frozen=True, eq=False)
class Choice:
    """The answer for one view."""

    drawables: NDArray[np.int64]  # sorted ids
    cell: int  # the view cell that holds the eye, -1 where none was computed
    computed: bool  # the drawables come from the cell's vLOD
    within: CellBox | None = None  # the cell's box, where what it sees only from behind may be left out
    approximate: bool = False  # carried over to another pixel error than the store was built for: something may lack
    missing: StoreError | None = None  # why the cell's vLOD could not be read, where something else is drawn instead


class Strategy(Protocol):
    """Which drawables for this view? One file each in this folder; all comparable on one recorded path."""

    pixel_error: float  # allowed error in pixels of the screen that the store was built for; may be changed at any time

    def choose(self, view: View) -> Choice:
        """The drawables for `view`."""
        ...

    def ahead(self, view: View, motion: Vector) -> NDArray[np.int64] | None:
        """Drawables that may be needed soon, the most urgent first; None where nothing has changed since the last call.

        motion: displacement (3,) of the eye since the last frame, in model units.
        """
        ...

    def close(self) -> None:
        """Stops what runs in the background."""
        ...


class MakeStrategy(Protocol):
    """How a strategy of player.strategies.STRATEGIES is made."""

    def __call__(self, model: ShownModel, *, pixel_error: float, wait: bool) -> Strategy:
        """wait: what it reads is waited for, as long as it can be read; otherwise no call may wait for the store."""
        ...
