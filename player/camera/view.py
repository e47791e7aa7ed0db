"""Where one looks from: position, orientation, lens; the projection and the view frustum.

Conventions, as in glTF: quaternions are (x, y, z, w) and turn camera axes into model axes; the camera looks along its
-z, its x points right and its y up. Depth is reversed (1 at the near plane, 0 infinitely far) where the
context can do it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from storage.base.errors import ParameterError

Vector = NDArray[np.float64]

AXES = {"x": 0, "y": 1, "z": 2}


def up_vector(up: str) -> Vector:
    """Unit vector (3,) of the up axis "x", "y" or "z"."""
    vector = np.zeros(3)
    vector[AXES[up]] = 1
    return vector


def normalised(vector: ArrayLike) -> Vector:
    """`vector` (..., n) divided by its length; a zero vector stays zero."""
    array = np.asarray(vector, np.float64)
    length = np.sqrt((array * array).sum(axis=-1, keepdims=True))
    return array / np.where(length > 0, length, 1)


def rotation_matrix(quaternion: ArrayLike) -> NDArray[np.float64]:
    """Rotation (3, 3) of a quaternion (x, y, z, w); its columns are the turned axes."""
    x, y, z, w = normalised(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: NDArray[np.float64]) -> Vector:
    """Unit quaternion (x, y, z, w), w >= 0, of a rotation matrix (3, 3)."""
    m = rotation
    four = np.array(
        [
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
            1 + m[0, 0] + m[1, 1] + m[2, 2],
        ]
    )
    largest = int(np.argmax(four))  # divides by the largest component: never by a small one
    products = np.array(
        [
            [four[0], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[0, 1] + m[1, 0], four[1], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], four[2], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], four[3]],
        ]
    )[largest]
    quaternion = normalised(products)
    return -quaternion if quaternion[3] < 0 else quaternion


def looking(direction: ArrayLike, up: ArrayLike) -> Vector:
    """Orientation (4,) of a camera that looks along `direction` (3,) with its head towards `up` (3,).

    Looking straight along `up` keeps some right-hand axis: any one, but always the same.
    """
    back = -normalised(direction)
    right = np.cross(np.asarray(up, np.float64), back)
    if float(np.abs(right).max()) < 1e-9:
        right = np.cross(np.roll(np.asarray(up, np.float64), 1), back)
    right = normalised(right)
    return quaternion_of(np.stack([right, np.cross(back, right), back], axis=1))


def yaw_pitch_direction(yaw: float, pitch: float, up: str) -> Vector:
    """Unit direction (3,) at `yaw` around the up axis and `pitch` above the horizon, both in radians.

    The horizontal axes are the two that follow `up` in cyclic order: yaw 0 looks along the first of them.
    """
    axis = AXES[up]
    direction = np.zeros(3)
    direction[axis] = math.sin(pitch)
    direction[(axis + 1) % 3] = math.cos(pitch) * math.cos(yaw)
    direction[(axis + 2) % 3] = math.cos(pitch) * math.sin(yaw)
    return direction


def direction_yaw_pitch(direction: ArrayLike, up: str) -> tuple[float, float]:
    """Yaw and pitch in radians of a direction (3,); the inverse of `yaw_pitch_direction`."""
    d = normalised(direction)
    axis = AXES[up]
    return (
        math.atan2(float(d[(axis + 2) % 3]), float(d[(axis + 1) % 3])),
        math.asin(min(1.0, max(-1.0, float(d[axis])))),
    )


@dataclass(frozen=True, eq=False)
class View:
    """One view of the model."""

    position: Vector  # eye (3,) in model units
    orientation: Vector  # unit quaternion (4,) x, y, z, w: camera to model
    field_of_view: float  # vertical, in degrees
    width: int  # in pixels
    height: int  # in pixels
    near: float  # distance of the near plane in model units
    far: float  # distance that everything lies within, in model units; matters only where depth is not reversed

    def __post_init__(self) -> None:
        if not (0 < self.field_of_view < 180):
            raise ParameterError(
                f"the field of view must be between 0 and 180 degrees, not {self.field_of_view}: try --field-of-view 60"
            )
        if self.width < 1 or self.height < 1:
            raise ParameterError(f"the picture must have at least one pixel, not {self.width}x{self.height}")

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation (3, 3) from camera to model axes; columns: right, up, back."""
        return rotation_matrix(self.orientation)

    @property
    def forward(self) -> Vector:
        """Unit direction (3,) in which the camera looks."""
        return -self.rotation[:, 2]

    def projection(self, reversed_depth: bool) -> NDArray[np.float64]:
        """Clip coordinates (4, 4) of camera coordinates, for column vectors.

        reversed_depth: depth near/distance in [0, 1], infinitely far plane; otherwise OpenGL's -1 (near) to 1 (far).
        """
        focal = 1 / math.tan(math.radians(self.field_of_view) / 2)
        matrix = np.zeros((4, 4))
        matrix[0, 0] = focal * self.height / self.width
        matrix[1, 1] = focal
        matrix[3, 2] = -1
        if reversed_depth:
            matrix[2, 3] = self.near
        else:
            matrix[2, 2] = (self.far + self.near) / (self.near - self.far)
            matrix[2, 3] = 2 * self.far * self.near / (self.near - self.far)
        return matrix

    def side_planes(self) -> NDArray[np.float64]:
        """Inward unit normals (5, 3) of the half spaces through the eye that hold the frustum.

        Four sides and the plane across the line of sight; all pass through the eye, so whatever lies between the eye
        and the near plane counts as inside: that errs towards drawing.
        """
        half = math.tan(math.radians(self.field_of_view) / 2)
        wide = half * self.width / self.height
        camera = np.array([[-1, 0, -wide], [1, 0, -wide], [0, -1, -half], [0, 1, -half], [0, 0, -1]])
        return normalised(camera) @ self.rotation.T


class Boxes(NamedTuple):
    """Axis-parallel boxes, laid out for the frustum test."""

    centre: NDArray[np.float64]  # (n, 3) model units
    half: NDArray[np.float64]  # (n, 3) half of each edge


def boxes_between(lo: NDArray[np.float32], hi: NDArray[np.float32]) -> Boxes:
    """The boxes from lo (n, 3) to hi (n, 3)."""
    low, high = lo.astype(np.float64), hi.astype(np.float64)
    return Boxes((low + high) / 2, (high - low) / 2)


def boxes_in_frustum(view: View, boxes: Boxes) -> NDArray[np.bool_]:
    """Which boxes touch the view frustum: (n,) bool. Errs only towards True.

    A box is out only if it lies wholly behind one of the planes, with a margin of 1e-6 of its distance for rounding.
    """
    normals = view.side_planes().T
    centre = boxes.centre - view.position
    reach = centre @ normals + boxes.half @ np.abs(normals)  # of the corner farthest inwards, for each plane
    margin = 1e-6 * (np.abs(centre).sum(axis=1) + boxes.half.sum(axis=1))
    inside: NDArray[np.bool_] = reach.min(axis=1) >= -margin
    return inside
