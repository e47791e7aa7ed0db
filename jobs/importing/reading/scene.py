"""What a reader hands over: meshes as the file has them, where they are placed, and the file's frame.

Nothing is repaired yet: indices may be out of range, positions may be NaN. Colours are sRGB already.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any, overload

import numpy as np


class Defect(StrEnum):
    """What can be wrong with a model and is repaired, removed or left out; the value is what a report calls it."""

    INDEX = "faces with an index out of range"
    NOT_FINITE = "faces with a position that is not finite"
    NO_AREA = "faces without area"
    DUPLICATE = "duplicate faces"
    REVERSED = "duplicate faces of opposite winding"
    EMPTY = "empty meshes"
    SINGULAR = "parts flattened by their transform"
    MISPLACED = "parts with a transform that is not finite"
    NO_TEXTURE = "missing textures"
    NO_LIBRARY = "missing material libraries"
    NO_MATERIAL = "unknown materials"
    COLOUR = "colours that are not finite"
    NORMAL = "normals without direction"
    NOT_TRIANGLES = "points, lines and other primitives without triangles"
    POLYGON = "faces with fewer than three corners"
    BROKEN = "broken elements"
    UNSUPPORTED = "unsupported features"


class Tally:
    """Counts of defects by part name."""

    def __init__(self) -> None:
        self._counts: dict[Defect, dict[str, int]] = {}

    def add(self, defect: Defect, part: str, count: int = 1) -> None:
        """Count a defect. A count of zero leaves no trace."""
        if count:
            parts = self._counts.setdefault(defect, {})
            parts[part] = parts.get(part, 0) + count

    def update(self, other: Tally, prefix: str) -> None:
        """Add another tally's counts, its part names prefixed."""
        for defect, parts in other._counts.items():
            for part, count in parts.items():
                self.add(defect, prefix + part, count)

    def report(self) -> dict[str, dict[str, Any]]:
        """{defect: {"total": n, "parts": {name: n}}}, in the order of `Defect`, part names sorted."""
        return {
            str(defect): {
                "total": sum(self._counts[defect].values()),
                "parts": dict(sorted(self._counts[defect].items())),
            }
            for defect in Defect
            if defect in self._counts
        }


@dataclass(eq=False)
class SourceMesh:
    """A mesh as its file has it. Polygons are fans of triangles from their first corner, in the file's order."""

    name: str
    positions: np.ndarray  # (n, 3) float64
    triangles: np.ndarray  # (m, 3) int64, not checked
    normals: np.ndarray | None = None  # (n, 3) any float
    colours: np.ndarray | None = None  # (n, 4) uint8 sRGB and alpha
    defects: dict[Defect, int] = field(default_factory=dict)  # found while reading, counted for every placement


@dataclass(frozen=True, eq=False)
class SourceNode:
    """A mesh's placement in the file's frame."""

    mesh: int
    name: str
    matrix: np.ndarray  # (3, 4) float64


@dataclass(eq=False)
class SourceScene:
    """Everything in one model file."""

    file: Path
    meshes: Sequence[SourceMesh]  # may be read only as they are asked for, one by one
    nodes: list[SourceNode]
    unit_in_metres: float | None = None  # None: the format does not say
    up: str | None = None  # None: the format does not say
    usual_up: str = "z"  # what files of this format mostly mean where they do not say
    tally: Tally = field(default_factory=Tally)  # defects of the file as a whole


@dataclass(frozen=True, eq=False)
class UnreadMeshes(Sequence[SourceMesh]):
    """Meshes that are read whenever one is asked for; none is kept."""

    size: int
    read: Callable[[int], SourceMesh]  # reads the mesh of a number, 0 ... size - 1

    def __len__(self) -> int:
        return self.size

    @overload
    def __getitem__(self, index: int) -> SourceMesh: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[SourceMesh]: ...

    def __getitem__(self, index: int | slice) -> SourceMesh | Sequence[SourceMesh]:
        if isinstance(index, slice):
            return [self.read(at) for at in range(self.size)[index]]
        return self.read(range(self.size)[index])


def fan(counts: np.ndarray) -> np.ndarray:
    """Corner numbers (m, 3) of the triangles that fan polygons out; polygons of `counts` corners lie one after another.

    Polygons with fewer than three corners give no triangle.
    """
    counts = np.asarray(counts, np.int64)
    starts = np.cumsum(counts) - counts
    triangles = np.maximum(counts - 2, 0)
    first = np.repeat(starts, triangles)
    number = np.arange(len(first), dtype=np.int64) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([first, first + number + 1, first + number + 2], axis=1)


def compose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The (3, 4) matrix that applies `b`, then `a`. Written out, so its bits depend on no linear-algebra library."""
    rotation = np.stack([(a[:, 0] * b[0, j] + a[:, 1] * b[1, j]) + a[:, 2] * b[2, j] for j in range(3)], axis=1)
    shift = ((a[:, 0] * b[0, 3] + a[:, 1] * b[1, 3]) + a[:, 2] * b[2, 3]) + a[:, 3]
    return np.column_stack([rotation, shift])
