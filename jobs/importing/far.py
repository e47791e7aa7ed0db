"""What lies absurdly far from nearly all of a model is left out: it would cost all else its precision.

Positions lie on one grid of 24 bits across the model's box, so a single triangle at 10^7, a survey point or a forgotten
block, makes a house a heap of cubes of a metre. Few triangles that lie so far out that without them the grid is finer
by `FINER` or more, with nothing between them and all else by a factor of `GAP`, are taken for that. A model whose bulk
is spread keeps everything.

Distances are the largest of the three axes', from the median of the triangles' middles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, overload

import numpy as np

from jobs.importing.keeping.saved import MeshView, Part
from jobs.importing.reading.defects import Defect, Tally
from storage.meshes.placement import transform_points

#: How much finer the grid must become: below that, steps are a hundred-thousandth of what stays, or finer.
FINER = 64.0

#: The farthest that stays and the nearest that goes are apart by this factor.
GAP = 16.0

#: At most this share of all triangles may go; of small models this many, but never more than that share.
_SHARE, _FEW, _LARGEST_SHARE = 1e-3, 12, 0.1

#: At most this many parts may go as a whole.
_MOST_PARTS = 16

#: Triangles of a mesh that are looked at before all are.
_SAMPLES = 16

#: The same in all, where a model has so many parts that fewer of each must do; and parts that are placed at once.
_MOST_SAMPLES, _BATCH = 1 << 16, 1 << 12

#: What more than this share of the triangles reach stays in any case.
_BULK = 1 - _LARGEST_SHARE


#: Which of a box's eight corners lie at its upper sides.
_CORNERS = np.array([[bool(i >> axis & 1) for axis in range(3)] for i in range(8)])


class Shape(NamedTuple):
    """A mesh as far as it must be known to see whether anything may lie far out."""

    lo: np.ndarray  # (3,) float64 of its box
    hi: np.ndarray  # (3,) float64
    middles: np.ndarray  # (k, 3) float64 of some triangles
    triangles: int


class Near(NamedTuple):
    """What stays of a model."""

    meshes: Sequence[MeshView]
    parts: list[Part]


def shape_of(mesh: MeshView) -> Shape:
    """The shape of a mesh with a triangle or more."""
    count = len(mesh.triangles)
    some = np.arange(min(count, _SAMPLES)) * count // min(count, _SAMPLES)
    middles = mesh.positions[mesh.triangles[some]].mean(axis=1)
    return Shape(mesh.positions.min(axis=0), mesh.positions.max(axis=0), middles, count)


def without_far(meshes: Sequence[MeshView], parts: list[Part], shapes: Sequence[Shape], tally: Tally) -> Near:
    """What stays of some meshes and the parts that place them; what goes is counted in `tally`.

    `shapes` are the meshes'. They are read only if their shapes show that something may go. A mesh that is placed
    several times loses the triangles that are far out wherever it is placed.
    """
    middles, weights = _middles(parts, shapes)
    centre = np.array([_quantile(middles[:, axis], weights, 0.5) for axis in range(3)])
    bulk = _quantile(np.abs(middles - centre).max(axis=1), weights, _BULK)
    reach = _reach(parts, shapes, centre)
    if float(reach.max()) < FINER * bulk:
        return Near(meshes, parts)

    def distances(number: int) -> np.ndarray:
        """Of all triangles of a part, (m,): their farthest corners'."""
        mesh = meshes[parts[number].mesh]
        away = np.abs(transform_points(parts[number].matrix, mesh.positions) - centre).max(axis=1)
        return away[mesh.triangles].max(axis=1)

    count = sum(shapes[part.mesh].triangles for part in parts)
    farthest = np.full(max(int(count * _SHARE), min(_FEW, int(count * _LARGEST_SHARE))) + 1, bulk)
    for number in np.argsort(-reach, kind="stable").tolist():
        if reach[number] <= farthest[0]:
            break
        farthest = np.sort(np.concatenate([farthest, distances(number)]))[-len(farthest) :]
    limit = _limit(farthest[::-1])
    far = {number: distances(number) > limit for number in np.flatnonzero(reach > limit).tolist()}
    gone = {number for number, away in far.items() if away.all()}
    if len(gone) > _MOST_PARTS:
        return Near(meshes, parts)
    kept: dict[int, np.ndarray] = {}
    for number, part in enumerate(parts):
        if number not in gone:
            near = ~far.get(number, np.zeros(shapes[part.mesh].triangles, bool))
            kept[part.mesh] = kept[part.mesh] | near if part.mesh in kept else near
    for number, part in enumerate(parts):
        if number in gone:
            tally.add(Defect.FAR, part.name)
        else:
            tally.add(Defect.FAR_FACES, part.name, int(np.count_nonzero(~kept[part.mesh])))
    trimmed = {mesh: keep for mesh, keep in kept.items() if not keep.all()}
    stay = [part for number, part in enumerate(parts) if number not in gone]
    return Near(_Trimmed(meshes, trimmed) if trimmed else meshes, stay)


def _middles(parts: list[Part], shapes: Sequence[Shape]) -> tuple[np.ndarray, np.ndarray]:
    """Middles (n, 3) of some triangles of each part where they are placed, and how many triangles each stands for."""
    each = max(min(_SAMPLES, _MOST_SAMPLES // len(parts)), 1)
    middles = np.empty((len(parts), each, 3))
    for start in range(0, len(parts), _BATCH):
        some = parts[start : start + _BATCH]
        own = [shapes[part.mesh].middles for part in some]
        points = np.stack([found[np.arange(each) * len(found) // each] for found in own])
        middles[start : start + _BATCH] = transform_points(np.stack([part.matrix for part in some])[:, None], points)
    counts = np.array([shapes[part.mesh].triangles for part in parts], np.float64)
    return middles.reshape(-1, 3), np.repeat(counts / each, each)


def _reach(parts: list[Part], shapes: Sequence[Shape], centre: np.ndarray) -> np.ndarray:
    """The distance (parts,) of each part's farthest box corner from `centre`."""
    reach = np.empty(len(parts))
    for start in range(0, len(parts), _BATCH):
        some = parts[start : start + _BATCH]
        lo, hi = (np.stack([shapes[part.mesh][side] for part in some]) for side in range(2))
        corners = np.where(_CORNERS, hi[:, None], lo[:, None])
        placed = transform_points(np.stack([part.matrix for part in some])[:, None], corners)
        reach[start : start + _BATCH] = np.abs(placed - centre).max(axis=(1, 2))
    return reach


def _limit(farthest: np.ndarray) -> float:
    """The distance beyond which triangles go, of the largest distances in decreasing order: all but the last may go.

    Infinity where none does.
    """
    nearer = farthest[1:]
    apart = farthest[:-1] / np.maximum(nearer, max(float(farthest[0]), 1.0) * 1e-30)
    allowed = (apart >= GAP) & (farthest[0] >= FINER * nearer)
    return float(nearer[np.argmax(np.where(allowed, apart, 0.0))]) if allowed.any() else np.inf


def _quantile(values: np.ndarray, weights: np.ndarray, share: float) -> float:
    """The least value that this share of the weights does not exceed."""
    order = np.argsort(values, kind="stable")
    sums = np.cumsum(weights[order])
    return float(values[order[min(int(np.searchsorted(sums, share * sums[-1])), len(order) - 1)]])


@dataclass(frozen=True, eq=False)
class _Trimmed(Sequence[MeshView]):
    """Meshes of which some have lost triangles."""

    meshes: Sequence[MeshView]
    kept: dict[int, np.ndarray]  # (m,) bool, of those meshes

    def __len__(self) -> int:
        return len(self.meshes)

    @overload
    def __getitem__(self, index: int) -> MeshView: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[MeshView]: ...

    def __getitem__(self, index: int | slice) -> MeshView | Sequence[MeshView]:
        if isinstance(index, slice):
            return [self[at] for at in range(len(self))[index]]
        at = range(len(self))[index]
        mesh = self.meshes[at]
        return mesh if at not in self.kept else _trimmed(mesh, self.kept[at])


def _trimmed(mesh: MeshView, kept: np.ndarray) -> MeshView:
    """Some triangles of a mesh, and the vertices that they use, in their order."""
    triangles = mesh.triangles[kept]
    used = np.zeros(len(mesh.positions), bool)
    used[triangles.reshape(-1)] = True
    number = (np.cumsum(used) - 1).astype(np.uint32)
    return MeshView(
        mesh.positions[used], mesh.normals[used], mesh.colours[used], number[triangles], mesh.source_faces[kept]
    )
