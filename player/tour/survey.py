"""What a tour knows of a model: its coarse levels on a grid of voxels, and how high a walker's eyes are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from player.camera.view import AXES, Vector
from player.shown_model import ShownModel
from player.tour.occupancy import free_run, mark_triangles
from storage.model.cut import cut_within

#: Voxels in the grid.
_VOXELS = 2_000_000

#: Voxels from the floor to a walker's eyes at which ways are still found well.
_VOXELS_HIGH = 8

#: Height of a walker's eyes, in metres.
_EYE_HEIGHT = 1.65

#: A person whose eyes are lower than this part of the rooms' height stands in a model whose unit is not what it says.
_LOWEST = 0.04


@dataclass(frozen=True, eq=False)
class Voxels:
    """A model's coarse levels on a grid."""

    occupied: NDArray[np.bool_]  # (nx, ny, nz)
    facing: NDArray[np.float32]  # (nx, ny, nz, 3) sum of the normals of what can be seen from one side only
    lo: Vector  # corner (3,) in model units
    size: float  # edge of a voxel in model units

    def centres(self, voxels: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centres (n, 3) in model units of voxels (n, 3)."""
        return self.lo + (voxels + 0.5) * self.size


@dataclass(frozen=True, eq=False)
class Survey:
    """What the tour knows of a model."""

    voxels: Voxels
    eye_height: float  # of a walker above the floor, in model units


def survey(model: ShownModel) -> Survey:
    """Looks at the model's coarse levels; the same for the same store."""
    voxels = _voxelise(model)
    eyes = _eye_height(model, voxels)
    return Survey(_coarser(voxels, int(eyes / (_VOXELS_HIGH * voxels.size))), eyes)


def _voxelise(model: ShownModel) -> Voxels:
    """The model on a grid of about _VOXELS voxels, a margin of two voxels around it."""
    extent = np.maximum(model.hi - model.lo, 1e-3 * model.extent)
    size = float(max((extent.prod() / _VOXELS) ** (1 / 3), extent.max() / 600))
    shape = np.ceil(extent / size).astype(np.int64) + 4
    lo = (model.lo + model.hi) / 2 - shape * size / 2
    occupied = np.zeros(tuple(shape.tolist()), np.bool_)
    facing = np.zeros((*occupied.shape, 3), np.float32)
    for drawable in _coarse(model, size / 2).tolist():
        mesh = model.store.mesh(drawable)
        corners = mesh.positions.astype(np.float64)[mesh.triangles]
        mark_triangles(occupied, facing, corners, bool(model.store.drawables["one_sided"][drawable]), lo, size)
    return Voxels(occupied, facing, lo, size)


def _coarser(voxels: Voxels, factor: int) -> Voxels:
    """Voxels `factor` times as large, occupied where any of the small ones is."""
    if factor < 2:
        return voxels
    margins = [(0, -length % factor) for length in voxels.occupied.shape]
    occupied, facing = np.pad(voxels.occupied, margins), np.pad(voxels.facing, [*margins, (0, 0)])
    x, y, z = (length // factor for length in occupied.shape)
    return Voxels(
        np.asarray(occupied.reshape(x, factor, y, factor, z, factor).any(axis=(1, 3, 5))),
        facing.reshape(x, factor, y, factor, z, factor, 3).sum(axis=(1, 3, 5)),
        voxels.lo,
        voxels.size * factor,
    )


def _coarse(model: ShownModel, error: float) -> NDArray[np.int64]:
    """What stands for the model with at most `error`: ids in the order of their packs."""
    store = model.store
    chosen = cut_within(store.nodes, store.drawables, error)
    packs = store.geometry["pack"][store.drawables["geometry"][chosen]]
    return chosen[np.lexsort((chosen, packs))]


def _eye_height(model: ShownModel, voxels: Voxels) -> float:
    """Height of a walker's eyes in model units: a person's, unless the rooms' height says that the unit is a guess."""
    facts = model.store.manifest.model
    up = AXES[facts.up]
    person = _EYE_HEIGHT / facts.unit_in_metres
    floors = free_run(voxels.occupied, up, -1) == 0
    floors &= ~voxels.occupied
    above = free_run(voxels.occupied, up, 1)[floors]
    heights = above[above >= 3] * voxels.size
    room = float(np.median(heights)) if len(heights) else float(model.hi[up] - model.lo[up])
    return max(person if _LOWEST * room < person < 0.9 * room else 0.5 * room, 2.5 * voxels.size)
