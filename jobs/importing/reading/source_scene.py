"""What a reader hands over: meshes as the file has them, where they are placed, and the file's frame.

Nothing is repaired yet: indices may be out of range, positions may be NaN. Colours are sRGB already.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import overload

import numpy as np

from jobs.importing.reading.defects import Defect, Tally


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


def compose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The (3, 4) matrix that applies `b`, then `a`. Written out, so its bits depend on no linear-algebra library."""
    matrix: np.ndarray = (a[:, :1] * b[0] + a[:, 1:2] * b[1]) + a[:, 2:3] * b[2]
    matrix[:, 3] += a[:, 3]
    return matrix
