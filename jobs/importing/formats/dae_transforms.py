"""The transforms of COLLADA nodes as matrices.

Based on: COLLADA, Digital Asset Schema Release 1.4.1, section "Transform": lookat, matrix, rotate, scale, skew,
translate; for skew also Pixar: The RenderMan Interface 3.2, RiSkew, which it names as its source.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np

from jobs.importing.reading.source_scene import compose
from jobs.importing.reading.text.numbers import floats_of
from storage.meshes.placement import IDENTITY

Element = ElementTree.Element

_TAGS = ("matrix", "translate", "rotate", "scale", "lookat", "skew")


def local_matrix(node: Element) -> np.ndarray | None:
    """The (3, 4) product of a node's transforms, IDENTITY itself where they change nothing; None if one of them cannot
    be read.
    """
    matrix = IDENTITY
    for element in node:
        if element.tag in _TAGS:
            own = _transform(element.tag, floats_of(element.text or ""))
            if own is None:
                return None
            matrix = placed(matrix, own)
    return matrix


def placed(parent: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """A matrix below its parent's, both (3, 4); an identity leaves the other as it is."""
    if np.array_equal(matrix, IDENTITY):
        return parent
    return matrix if parent is IDENTITY else compose(parent, matrix)


def _transform(tag: str, values: np.ndarray) -> np.ndarray | None:
    """The (3, 4) matrix of a transform element, None if it cannot be read."""
    if tag == "matrix":
        return values.reshape(4, 4)[:3] if len(values) == 16 else None
    size = {"translate": 3, "scale": 3, "rotate": 4, "skew": 7, "lookat": 9}[tag]
    if len(values) != size:
        return None
    if tag == "translate":
        return np.column_stack([np.eye(3), values])
    if tag == "scale":
        return np.column_stack([np.diag(values), np.zeros(3)])
    if not np.isfinite(values).all():
        return None
    if tag == "rotate":
        return _rotation(values)
    return _look_at(*values.reshape(3, 3)) if tag == "lookat" else _skew(float(values[0]), values[1:4], values[4:])


def _rotation(values: np.ndarray) -> np.ndarray:
    """About an axis (x, y, z) by degrees."""
    x, y, z, degrees = values.tolist()
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0:
        return IDENTITY
    x, y, z = x / length, y / length, z / length
    quarter = degrees / 90
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    if quarter == int(quarter):  # exact, so that boxes turned by quarters stay boxes
        cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
    rest = 1 - cosine
    return np.array(
        [
            [rest * x * x + cosine, rest * x * y - sine * z, rest * x * z + sine * y, 0.0],
            [rest * x * y + sine * z, rest * y * y + cosine, rest * y * z - sine * x, 0.0],
            [rest * x * z - sine * y, rest * y * z + sine * x, rest * z * z + cosine, 0.0],
        ]
    )


def _look_at(eye: np.ndarray, interest: np.ndarray, up: np.ndarray) -> np.ndarray | None:
    """Places what is at the origin at `eye`, its -z towards `interest`, its y in the plane of `up`."""
    ahead = _unit(interest - eye)
    side = None if ahead is None else _unit(_cross(ahead, up))
    if ahead is None or side is None:
        return None
    return np.column_stack([side, _cross(side, ahead), -ahead, eye])


def _skew(degrees: float, axis: np.ndarray, along: np.ndarray) -> np.ndarray | None:
    """Shifts points parallel to `along`, so that what lies on `axis` comes to lie at that angle from it."""
    axis_unit, shift = _unit(axis), _unit(along)
    if axis_unit is None or shift is None:
        return None
    cosine = float((axis_unit * shift).sum())
    upright = _unit(axis_unit - cosine * shift)  # what lies on `along` stays
    if upright is None or not -90 < degrees < 90:
        return None
    sine = math.sqrt(max(1 - cosine * cosine, 0.0))
    tangent = math.tan(math.radians(degrees))
    reach = sine - tangent * cosine
    if reach <= 0:  # the angle is not below that between the axes
        return None
    share = upright / float((upright * axis_unit).sum())
    return np.column_stack([np.eye(3) + tangent / reach * shift[:, None] * share[None, :], np.zeros(3)])


def _unit(vector: np.ndarray) -> np.ndarray | None:
    largest = float(np.abs(vector).max())
    if not 1e-9 < largest < math.inf:
        return None
    scaled = vector / largest
    return scaled / math.sqrt(float((scaled * scaled).sum()))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
