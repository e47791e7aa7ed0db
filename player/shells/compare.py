"""How two pictures of the same view differ: by brightness, and where one has a hole that the other has not.

Pictures are (height, width, 4) uint8; alpha is 255 where an opaque surface was drawn and 0 where none was. So holes are
looked for in what the pictures are without all that can be seen through, differences in the pictures as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

#: Channels that differ by more than this many levels of 255 count as different.
LEVELS = 16

#: Pictures pass if at most this part of each one's pixels differs,
ALLOWED_DIFFERING = 0.01
#: and if at most this part of the pixels that the full pictures cover, of all frames together, are holes.
ALLOWED_HOLES = 1e-6

_MAGNIFICATION = 8


@dataclass(frozen=True)
class Difference:
    """How a picture differs from the full one."""

    differing: float  # part of the pixels of which any channel differs by more than LEVELS
    differing_grey: float  # part of the pixels of which the brightness differs by more than LEVELS
    holes: int  # pixels with opaque surface in the full picture and only background in their 3x3 neighbourhood here
    covered: int  # pixels with opaque surface in the full picture


def passed(differences: Sequence[Difference]) -> bool:
    """Whether the pictures of a path pass: few enough holes in all of them, few enough pixels that differ in each.

    In fewer than a million covered pixels no hole is allowed.
    """
    lost = sum(found.holes for found in differences)
    covered = sum(found.covered for found in differences)
    return lost <= ALLOWED_HOLES * covered and all(found.differing <= ALLOWED_DIFFERING for found in differences)


def in_a_million(holes: int, covered: int) -> float:
    """Holes in a million covered pixels; 0 where nothing is covered, which leaves nothing to lose."""
    return 1e6 * holes / covered if covered else 0.0


def difference(picture: Picture, full: Picture) -> Difference:
    """Compares `picture` with the `full` one."""
    channels = np.abs(picture[..., :3].astype(np.int16) - full[..., :3].astype(np.int16))
    grey = np.abs(_grey(picture) - _grey(full))
    return Difference(
        differing=float((channels.max(axis=2) > LEVELS).mean()),
        differing_grey=float((grey > LEVELS).mean()),
        holes=int(holes(picture, full).sum()),
        covered=int((full[..., 3] > 0).sum()),
    )


def holes(picture: Picture, full: Picture) -> NDArray[np.bool_]:
    """Pixels (height, width) with opaque surface in `full`, and none in their 3x3 neighbourhood in `picture`."""
    surface = np.pad(picture[..., 3] > 0, 1)
    rows = surface[:-2] | surface[1:-1] | surface[2:]
    near = rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]
    return (full[..., 3] > 0) & ~near


def magnified(picture: Picture, full: Picture) -> NDArray[np.uint8]:
    """The difference (height, width, 3), eight times as strong, holes in red."""
    channels = np.abs(picture[..., :3].astype(np.int16) - full[..., :3].astype(np.int16))
    shown = np.minimum(channels * _MAGNIFICATION, 255).astype(np.uint8)
    shown[holes(picture, full)] = (255, 0, 0)
    return shown


def _grey(picture: Picture) -> NDArray[np.float32]:
    return picture[..., :3].astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
