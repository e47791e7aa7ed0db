"""How a file's nodes stand and what they make of their meshes: transforms, morph weights, skins.

glTF 2.0, sections 3.5.2 and 3.5.3 (transforms), 3.7.2.2 (morph targets) and 3.7.3 (skins). Everything is taken as it
rests. An animation's first frame counts only where the file gives no rest: for the place of a node that has neither a
matrix nor a translation, rotation or scale, and for morph weights that neither the node nor its mesh gives; the first
animation that moves them counts, with its first key frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jobs.importing.formats.gltf.accessors import Accessors, at
from jobs.importing.formats.gltf.header import Json
from jobs.importing.reading.source_scene import compose
from storage.meshes.placement import IDENTITY

_PLACES = {"translation": 3, "rotation": 4, "scale": 3}

#: What stands for a transform that cannot be read: whatever it places is left out and counted.
NOWHERE = np.full((3, 4), np.nan)

#: A matrix whose last row is farther from (0, 0, 0, 1) is no placement.
_PROJECTIVE = 1e-6

#: Vertices that are skinned at once.
_CHUNK = 1 << 16


@dataclass(eq=False)
class Poses:
    """The nodes of a file at rest."""

    accessors: Accessors
    nodes: list[Json] = field(init=False)
    _parents: dict[int, int] = field(init=False)
    _firsts: dict[tuple[int, str], Json] = field(init=False)  # samplers by node and what they move
    _worlds: dict[int, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.nodes = self.accessors.header.get("nodes", [])
        self._parents = {}
        for number, node in enumerate(self.nodes):
            for child in node.get("children", ()):
                self._parents.setdefault(at(child), number)
        self._firsts = {}
        for animation in self.accessors.header.get("animations", ()):
            for channel in animation["channels"]:
                target = channel["target"]
                if "node" in target and self._has_no_rest(target["node"], str(target["path"])):
                    sampler = animation["samplers"][at(channel["sampler"])]
                    self._firsts.setdefault((target["node"], target["path"]), sampler)

    def _has_no_rest(self, number: int, path: str) -> bool:
        node = self.nodes[at(number)]
        if path in _PLACES:
            return "matrix" not in node and not any(key in node for key in _PLACES)
        mesh = self.accessors.header["meshes"][at(node["mesh"])] if "mesh" in node else {}
        return path == "weights" and "weights" not in node and "weights" not in mesh

    def _first(self, number: int, path: str, width: int) -> list[float] | None:
        """The first key frame of what moves a node: `width` numbers."""
        sampler = self._firsts.get((number, path))
        if sampler is None:
            return None
        values = self.accessors.floats(sampler["output"]).reshape(-1)
        start = width if sampler.get("interpolation") == "CUBICSPLINE" else 0  # behind its tangent
        found = values[start : start + width]
        return found.tolist() if len(found) == width else None

    def local(self, number: int) -> np.ndarray:
        """A node's own (3, 4) matrix: IDENTITY itself if it has none, NOWHERE if what it has cannot be read."""
        node = self.nodes[at(number)]
        places = {path: node[path] for path in _PLACES if path in node}
        if self._firsts and not places:
            firsts = {path: self._first(number, path, width) for path, width in _PLACES.items()}
            places = {path: first for path, first in firsts.items() if first is not None}
        try:
            if "matrix" in node:
                return _of_matrix(np.array(node["matrix"], np.float64).reshape(4, 4).T)
            return _of_places(places) if places else IDENTITY
        except (TypeError, ValueError, OverflowError):
            return NOWHERE

    def world(self, number: int) -> np.ndarray:
        """A node's (3, 4) matrix, with those of all nodes above it."""
        path = []
        above: int | None = number
        while above is not None and above not in self._worlds:
            path.append(above)
            above = None if len(path) > len(self.nodes) else self._parents.get(above)
        if len(path) > len(self.nodes):  # it is its own ancestor
            return NOWHERE
        for node in reversed(path):
            parent = self._parents.get(node)
            self._worlds[node] = under(None if parent is None else self._worlds[parent], self.local(node))
        return self._worlds[number]

    def weights(self, number: int) -> tuple[float, ...]:
        """The weights of the morph targets of a node's mesh; none if it stays as it is."""
        node = self.nodes[number]
        mesh = self.accessors.header["meshes"][at(node["mesh"])]
        targets = max((len(primitive.get("targets", ())) for primitive in mesh["primitives"]), default=0)
        if not targets:
            return ()
        given = node.get("weights", mesh.get("weights"))
        if given is None:
            given = self._first(number, "weights", targets) or ()
        weights = tuple(float(weight) for weight in given)[:targets]
        return weights if any(weights) else ()

    def joints(self, skin: int) -> np.ndarray:
        """The (k, 3, 4) matrices that take a skin's vertices to where its joints stand."""
        entry = self.accessors.header["skins"][at(skin)]
        stand = [self.world(at(joint)) for joint in entry["joints"]]
        if "inverseBindMatrices" not in entry:
            return np.stack(stand)
        columns = self.accessors.floats(entry["inverseBindMatrices"])[: len(stand)].reshape(-1, 4, 4)
        inverse = np.swapaxes(columns, 1, 2)
        return np.stack([compose(joint, bind[:3]) for joint, bind in zip(stand, inverse, strict=True)])


def under(parent: np.ndarray | None, local: np.ndarray) -> np.ndarray:
    """The (3, 4) matrix that applies `local`, then the parent's."""
    if parent is None or parent is IDENTITY:
        return local
    return parent if local is IDENTITY else compose(parent, local)


def _of_matrix(matrix: np.ndarray) -> np.ndarray:
    """The placement in a (4, 4) matrix."""
    *lowest, whole = matrix[3].tolist()
    if not (whole > 0 and all(abs(value) <= _PROJECTIVE * whole for value in lowest)):
        return NOWHERE
    return matrix[:3] if whole == 1 else matrix[:3] / whole


def _of_places(places: dict[str, Any]) -> np.ndarray:
    """The matrix of a translation, rotation and scale."""
    x, y, z, w = (float(value) for value in places.get("rotation", (0, 0, 0, 1)))
    norm = math.sqrt(x * x + y * y + z * z + w * w) or 1.0
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    scale = np.array(places.get("scale", (1, 1, 1)), np.float64).reshape(3)
    shift = np.array(places.get("translation", (0, 0, 0)), np.float64).reshape(3)
    return np.column_stack([rotation * scale, shift])


def skinned(
    positions: np.ndarray, normals: np.ndarray, joints: np.ndarray, weights: np.ndarray, matrices: np.ndarray
) -> np.ndarray:
    """Move vertices to where their joints stand, in place; returns which of them their joints mirror (n,) bool.

    positions (n, 3) float64; normals (n, 3) float32; joints (n, k) int64 into the matrices (j, 3, 4), weights (n, k).
    Vertices without any weight follow their first joint. A joint out of range makes a position that is not finite.
    """
    mirrored = np.zeros(len(positions), bool)
    total = weights.sum(axis=1)
    loose = ~(total > 0)
    shares = np.where(loose[:, None], np.arange(weights.shape[1]) == 0, weights / np.where(loose, 1.0, total)[:, None])
    for start in range(0, len(positions), _CHUNK):
        rows = slice(start, start + _CHUNK)
        matrix = np.zeros((len(positions[rows]), 3, 4))
        for column in range(joints.shape[1]):
            number, share = joints[rows, column], shares[rows, column]
            known = (number >= 0) & (number < len(matrices))
            moved = matrices[np.where(known, number, 0)] * share[:, None, None]
            moved[~known & (share != 0)] = np.nan
            moved[share == 0] = 0.0  # a joint that does not count may stand nowhere
            matrix += moved
        (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(matrix[:, :, :3], 0, 2)
        cofactors = np.array(
            [
                [e * i - f * h, f * g - d * i, d * h - e * g],
                [c * h - b * i, a * i - c * g, b * g - a * h],
                [b * f - c * e, c * d - a * f, a * e - b * d],
            ]
        )
        determinant = (a * cofactors[0, 0] + b * cofactors[0, 1]) + c * cofactors[0, 2]
        mirrored[rows] = determinant < 0
        x, y, z = positions[rows].T
        turned = [(row[0] * x + row[1] * y) + row[2] * z + row[3] for row in np.moveaxis(matrix, 0, 2)]
        positions[rows] = np.stack(turned, axis=1)
        x, y, z = normals[rows].astype(np.float64).T
        sign = np.where(determinant < 0, -1.0, 1.0)
        turned = [((row[0] * x + row[1] * y) + row[2] * z) * sign for row in cofactors]
        length = np.sqrt((turned[0] ** 2 + turned[1] ** 2) + turned[2] ** 2)
        normals[rows] = (np.stack(turned, axis=1) / np.where(length > 0, length, 1.0)[:, None]).astype(np.float32)
    return mirrored
