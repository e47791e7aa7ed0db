"""One primitive: its triangles, morphed, skinned and coloured.

glTF 2.0, section 3.7.2: lists, strips and fans of triangles; morph targets move vertices before joints do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jobs.importing.formats.gltf.accessors import Accessors, at
from jobs.importing.formats.gltf.draco import DracoDecoder
from jobs.importing.formats.gltf.header import DRACO, Json
from jobs.importing.formats.gltf.poses import skinned
from jobs.importing.formats.gltf.surfaces import paint
from jobs.importing.formats.gltf.textures import Textures
from jobs.importing.reading.defects import Defect
from storage.base.errors import ModelError

TRIANGLES, STRIP, FAN = 4, 5, 6


class Pose(NamedTuple):
    """What a node makes of a mesh, beside placing it."""

    weights: tuple[float, ...]  # of the morph targets; none if none counts
    skin: int | None


UNPOSED = Pose((), None)


class Piece(NamedTuple):
    """A primitive that was read."""

    positions: np.ndarray  # (n, 3) float64
    triangles: np.ndarray  # (m, 3) int64, not checked
    normals: np.ndarray  # (n, 3) float32
    colours: np.ndarray  # (n, 4) uint8


@dataclass(eq=False)
class Primitives:
    """Reads the primitives of a file."""

    accessors: Accessors
    textures: Textures
    decoder: DracoDecoder

    def read(
        self,
        name: str,
        primitive: Json,
        weights: tuple[float, ...],
        joints: np.ndarray | None,
        defects: dict[Defect, int],
    ) -> Piece:
        """A primitive of the mesh `name`; `joints` (k, 3, 4): of its skin. Defects are counted."""
        arrays = self._arrays(primitive, weights, defects)
        positions = arrays.floats("POSITION")
        triangles = arrays.triangles()
        normals = np.zeros(positions.shape, np.float32)
        if "NORMAL" in arrays:
            normals = arrays.floats("NORMAL").astype(np.float32)
        if positions.shape[1] != 3:
            raise ModelError(f"{self.accessors.file}: mesh {name!r} has positions without x, y and z; export it again")
        if normals.shape != positions.shape:
            defects[Defect.BROKEN] = defects.get(Defect.BROKEN, 0) + 1
            normals = np.zeros(positions.shape, np.float32)
        if joints is not None and "JOINTS_0" in arrays and "WEIGHTS_0" in arrays:
            numbers, shares = arrays.sets("JOINTS_"), arrays.sets("WEIGHTS_")
            mirrored = skinned(positions, normals, numbers.astype(np.int64), np.nan_to_num(shares), joints)
            first = triangles[:, 0]
            inside = (first >= 0) & (first < len(mirrored))
            turned = np.flatnonzero(inside)[mirrored[first[inside]]]
            triangles[turned] = triangles[turned][:, [0, 2, 1]]
        number = primitive.get("material")
        material = None if number is None else self.accessors.header["materials"][at(number)]
        painted = paint(self.textures, arrays, material, triangles, len(positions), defects)
        if painted.vertices is not None:
            positions, normals = positions[painted.vertices], normals[painted.vertices]
        return Piece(positions, painted.triangles, normals, painted.colours)

    def _arrays(self, primitive: Json, weights: tuple[float, ...], defects: dict[Defect, int]) -> Arrays:
        attributes: Mapping[str, int] = primitive["attributes"]
        extension = primitive.get("extensions", {}).get(DRACO)
        if extension is None or self._is_there(primitive):
            return Arrays(self.accessors, primitive, weights, {}, None, defects)
        wanted = {name: number for name, number in extension["attributes"].items() if name in attributes}
        vertices = self.accessors.count(attributes["POSITION"])
        corners = self.accessors.count(primitive["indices"]) if "indices" in primitive else vertices
        stream = self.accessors.whole_view(extension["bufferView"])
        triangles, values = self.decoder.decode(stream, list(wanted.values()), vertices, corners // 3)
        decoded = {
            name: self.accessors.as_floats(attributes[name], array) for name, array in zip(wanted, values, strict=True)
        }
        return Arrays(self.accessors, primitive, weights, decoded, triangles, defects)

    def _is_there(self, primitive: Json) -> bool:
        """Whether a compressed primitive's data is in the file uncompressed as well."""
        needed = [*primitive["attributes"].values(), *([primitive["indices"]] if "indices" in primitive else [])]
        return all(self.accessors.has_data(number) for number in needed)


@dataclass(frozen=True, eq=False)
class Arrays:
    """A primitive's arrays, under its morph targets."""

    accessors: Accessors
    primitive: Json
    weights: tuple[float, ...]
    decoded: Mapping[str, np.ndarray]  # those that were compressed
    decoded_triangles: np.ndarray | None
    defects: dict[Defect, int]

    def __contains__(self, name: object) -> bool:
        return name in self.primitive["attributes"]

    def floats(self, name: str) -> np.ndarray:
        """An attribute's values (n, width) float64, and what the morph targets add."""
        number = self.primitive["attributes"][name]
        values = self.decoded[name] if name in self.decoded else self.accessors.floats(number)
        for weight, target in zip(self.weights, self.primitive.get("targets", ()), strict=False):
            if weight and name in target:
                added = self.accessors.floats(target[name])
                if len(added) != len(values) or added.shape[1] > values.shape[1]:
                    self.defects[Defect.BROKEN] = self.defects.get(Defect.BROKEN, 0) + 1
                    continue
                values = values.copy()
                values[:, : added.shape[1]] += added * weight
        return values

    def sets(self, prefix: str) -> np.ndarray:
        """All sets of an attribute beside each other: JOINTS_0, JOINTS_1, ..."""
        found, number = [], 0
        while f"{prefix}{number}" in self:
            found.append(self.floats(f"{prefix}{number}"))
            number += 1
        return np.concatenate(found, axis=1)

    def triangles(self) -> np.ndarray:
        """The triangles (m, 3) int64, not checked."""
        if self.decoded_triangles is not None:
            return self.decoded_triangles.copy()
        if "indices" in self.primitive:
            corners = self.accessors.integers(self.primitive["indices"])
        else:
            corners = np.arange(self.accessors.count(self.primitive["attributes"]["POSITION"]))
        return triangles_of(corners, self.primitive.get("mode", TRIANGLES))


def triangles_of(corners: np.ndarray, mode: int) -> np.ndarray:
    """Triangles (m, 3) of a list, strip or fan. The faces without area that stitch strips together are left out."""
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    number = np.arange(max(len(corners) - 2, 0))
    if mode == FAN:
        return corners[np.stack([np.zeros_like(number), number + 1, number + 2], axis=1)]
    odd = number % 2
    strip = corners[np.stack([number, number + 1 + odd, number + 2 - odd], axis=1)]
    a, b, c = strip.T
    return strip[(a != b) & (b != c) & (c != a)]


def has_triangles(primitive: Json) -> bool:
    """Whether a primitive is made of triangles, and says where they lie."""
    return primitive.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN) and "POSITION" in primitive.get("attributes", {})


def is_skinned(primitive: Json) -> bool:
    """Whether a primitive's vertices say which joints they follow."""
    return {"JOINTS_0", "WEIGHTS_0"} <= primitive.get("attributes", {}).keys()
