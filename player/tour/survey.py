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

#: The fewest of them, where cells reach so far that voxels must be larger.
_FEWEST_HIGH = 4

#: Height of a walker's eyes, in metres.
_EYE_HEIGHT = 1.6

#: A person whose eyes are lower than this part of the rooms' height stands in a model whose unit is not what it says.
_LOWEST = 0.04


@dataclass(frozen=True, eq=False)
class Voxels:
    """A model's coarse levels on a grid: of the whole model, or of what lies around its computed cells."""

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
    """Looks at the model's coarse levels; the same for the same store.

    Where cells were computed, the grid is a finer one around them: nothing else is walked through.
    """
    extent = np.maximum(model.hi - model.lo, 1e-3 * model.extent)
    size = float(max((extent.prod() / _VOXELS) ** (1 / 3), extent.max() / 600))
    whole = _voxelise(model, (model.lo + model.hi - extent) / 2, extent, size)
    eyes = _eye_height(model, whole)
    if model.store.cells["computed"].any():
        return Survey(_voxelise(model, *_around_cells(model, eyes)), eyes)
    eyes = max(eyes, 2.5 * size)
    return Survey(_coarser(whole, int(eyes / (_VOXELS_HIGH * size))), eyes)


def _around_cells(model: ShownModel, eyes: float) -> tuple[Vector, Vector, float]:
    """Corner (3,), extent (3,) and voxels' edge of a grid around the computed cells, with the floors below them.

    No voxel is larger than a cell: whoever goes from one into the next that lies in a cell leaves the cells nowhere. A
    grid that would have more than _VOXELS covers what lies around the middle of the cells.
    """
    cells = model.store.cells[model.store.cells["computed"]]
    edge = float((model.store.cells["hi"] - model.store.cells["lo"]).min())
    up = AXES[model.store.manifest.model.up]
    below, above = np.full(3, 2 * eyes), np.full(3, 2 * eyes)
    below[up] = 1.6 * eyes
    lo, hi = cells["lo"].min(axis=0) - below, cells["hi"].max(axis=0) + above
    extent = hi - lo
    sparing = float(extent.prod() / _VOXELS) ** (1 / 3)
    size = min(max(sparing, eyes / _VOXELS_HIGH), eyes / _FEWEST_HIGH, edge)
    most = float(extent.max())
    while np.minimum(extent, most).prod() > _VOXELS * size**3:
        most *= 0.95
    centres = (cells["lo"] + cells["hi"]) / 2
    middle = centres[np.argmin(((centres - np.median(centres, axis=0)) ** 2).sum(axis=1))]
    kept = np.minimum(extent, most)
    return np.clip(middle - kept / 2, lo, hi - kept), kept, size


def _voxelise(model: ShownModel, corner: Vector, extent: Vector, size: float) -> Voxels:
    """What lies in a box of that corner (3,) and extent (3,), on voxels of edge `size`; two voxels more around it."""
    shape = np.ceil(extent / size).astype(np.int64) + 4
    lo = corner + extent / 2 - shape * size / 2
    occupied = np.zeros(tuple(shape.tolist()), np.bool_)
    facing = np.zeros((*occupied.shape, 3), np.float32)
    rows = model.store.drawables
    for drawable in _coarse(model, size / 2, lo, lo + shape * size).tolist():
        mesh = model.store.mesh(drawable)
        corners = mesh.positions.astype(np.float64)[mesh.triangles]
        mark_triangles(occupied, facing, corners, bool(rows["one_sided"][drawable]), lo, size)
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


def _coarse(model: ShownModel, error: float, lo: Vector, hi: Vector) -> NDArray[np.int64]:
    """What stands for the model between lo and hi (3,) with at most `error`: ids in the order of their packs."""
    store = model.store
    chosen = cut_within(store.nodes, store.drawables, error)
    boxes = store.drawables[["lo", "hi"]][chosen]
    chosen = chosen[((boxes["lo"] <= hi) & (boxes["hi"] >= lo)).all(axis=1)]
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
    heights = (above[above >= 3] + 1) * voxels.size  # of the voxels of a floor and a ceiling about half is free
    room = float(np.median(heights)) if len(heights) else float(model.hi[up] - model.lo[up])
    return person if _LOWEST * room < person < 0.9 * room else 0.5 * room
