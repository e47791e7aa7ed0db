"""The automatic tour: the first of the kinds of tour, or the one that was asked for, that a model allows."""

from __future__ import annotations

from typing import Protocol

from player import tour
from player.camera.path import CameraPath
from player.errors import PathError
from player.offers import named
from player.shown_model import ShownModel
from player.tour.survey import Survey

#: Pictures a second of a tour that is played back.
FRAMES_PER_SECOND = 25.0


class MakeTour(Protocol):
    """A kind of tour: what yields poses along time for a model."""

    def __call__(self, model: ShownModel, known: Survey, *, frames: int, seed: int) -> CameraPath | None:
        """`frames` poses (two at least) at FRAMES_PER_SECOND; None where the model does not allow it.

        The same for the same store, frames and seed.
        """
        ...


def make_tour(model: ShownModel, known: Survey, *, frames: int, seed: int, kind: str | None = None) -> CameraPath:
    """A tour of `frames` poses at FRAMES_PER_SECOND; the same for the same store, frames, seed and kind.

    kind: the name of one of player.tour.TOURS; None: the first of them that the model allows. Raises PathError where it
    does not allow that kind.
    """
    for offer in tour.TOURS if kind is None else (named(tour.TOURS, kind, "tour"),):
        path = offer.load()(model, known, frames=max(frames, 2), seed=seed)
        if path is not None:
            return CameraPath(path.times[:frames], path.positions[:frames], path.orientations[:frames])
    raise PathError(f"this model allows no tour of the kind {kind}: leave --tour out, or give a --path")
