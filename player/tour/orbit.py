"""A turn around a model: for a single machine in the void, say, where there are no rooms to walk through."""

from __future__ import annotations

import math

import numpy as np

from player.camera.path import CameraPath
from player.camera.view import looking, up_vector, yaw_pitch_direction
from player.shown_model import ShownModel
from player.tour.survey import Survey
from player.tour.tour import FRAMES_PER_SECOND


def turn_around(model: ShownModel, known: Survey, *, frames: int, seed: int) -> CameraPath:  # noqa: ARG001
    """A turn of `frames` poses around the model, looking at its middle from a little above."""
    up_name = model.store.manifest.model.up
    up = up_vector(up_name)
    centre = (model.lo + model.hi) / 2
    start = np.random.default_rng(seed).random() * 2 * math.pi
    turn = min(2 * math.pi, frames * 0.05)
    positions, orientations = [], []
    for part in np.linspace(0, 1, frames):
        direction = yaw_pitch_direction(start + turn * float(part), 0.35, up_name)
        positions.append(centre + direction * 0.9 * model.extent)
        orientations.append(looking(-direction, up))
    return CameraPath(np.arange(frames) / FRAMES_PER_SECOND, np.array(positions), np.array(orientations))
