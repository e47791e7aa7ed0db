"""The automatic tour: a walk through the most interesting rooms of a model that keeps clear of its surfaces.

The model's coarse levels are drawn into a grid of voxels. Where a floor lies below at eye height one can walk; a place
is interesting if there is something to see around it. The walk visits places far apart in the largest interesting
region, along ways that keep off the walls, smoothed, looking ahead. Where there is no such region (a single machine in
the void, say), the tour circles around the model instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from player.camera.path import CameraPath
from player.camera.view import AXES, Vector, direction_yaw_pitch, looking, up_vector, yaw_pitch_direction
from player.scene import Scene
from player.tour.occupancy import cheapest_ways, clearance, enclosure, free_run, mark_triangles
from storage.model.cut import cut_within

#: Voxels in the grid.
_VOXELS = 2_000_000

#: Voxels from the floor to a walker's eyes at which ways are still found well.
_VOXELS_HIGH = 8

#: Height of a walker's eyes, in metres.
_EYE_HEIGHT = 1.65

#: A person whose eyes are lower than this part of the rooms' height stands in a model whose unit is not what it says.
_LOWEST = 0.04

#: Pictures a second of a tour that is played back.
FRAMES_PER_SECOND = 25.0

#: Way between two frames, in eye heights: brisk, but no chase.
_STEP = 0.12


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
class _Region:
    """Where one can walk."""

    voxels: NDArray[np.int64]  # (n, 3)
    flat: NDArray[np.int64]  # (n,) their flat indices
    interest: NDArray[np.float32]  # (n,) 0 to 1
    cost: NDArray[np.float32]  # (nx, ny, nz) of a way through each voxel, infinite elsewhere
    room: NDArray[np.float32]  # (nx, ny, nz) distance to the nearest surface, in voxels


@dataclass(frozen=True, eq=False)
class Survey:
    """What the tour knows of a model."""

    voxels: Voxels
    eye_height: float  # of a walker above the floor, in model units


def survey(scene: Scene) -> Survey:
    """Looks at the model's coarse levels; the same for the same store."""
    voxels = _voxelise(scene)
    eyes = _eye_height(scene, voxels)
    return Survey(_coarser(voxels, int(eyes / (_VOXELS_HIGH * voxels.size))), eyes)


def make_tour(scene: Scene, known: Survey, *, frames: int, seed: int) -> CameraPath:
    """A tour of `frames` poses at FRAMES_PER_SECOND; the same for the same store, frames and seed."""
    walk = _walk(scene, known, frames=max(frames, 2), seed=seed)
    path = _orbit(scene, frames=max(frames, 2), seed=seed) if walk is None else walk
    return CameraPath(path.times[:frames], path.positions[:frames], path.orientations[:frames])


def _voxelise(scene: Scene) -> Voxels:
    """The model on a grid of about _VOXELS voxels, a margin of two voxels around it."""
    extent = np.maximum(scene.hi - scene.lo, 1e-3 * scene.extent)
    size = float(max((extent.prod() / _VOXELS) ** (1 / 3), extent.max() / 600))
    shape = np.ceil(extent / size).astype(np.int64) + 4
    lo = (scene.lo + scene.hi) / 2 - shape * size / 2
    occupied = np.zeros(tuple(shape.tolist()), np.bool_)
    facing = np.zeros((*occupied.shape, 3), np.float32)
    for drawable in _coarse(scene, size / 2).tolist():
        mesh = scene.store.mesh(drawable)
        corners = mesh.positions.astype(np.float64)[mesh.triangles]
        mark_triangles(occupied, facing, corners, bool(scene.store.drawables["one_sided"][drawable]), lo, size)
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


def _coarse(scene: Scene, error: float) -> NDArray[np.int64]:
    """What stands for the model with at most `error`: ids in the order of their packs."""
    store = scene.store
    chosen = cut_within(store.nodes, store.drawables, error)
    packs = store.geometry["pack"][store.drawables["geometry"][chosen]]
    return chosen[np.lexsort((chosen, packs))]


def _eye_height(scene: Scene, voxels: Voxels) -> float:
    """Height of a walker's eyes in model units: a person's, unless the rooms' height says that the unit is a guess."""
    model = scene.store.manifest.model
    up = AXES[model.up]
    person = _EYE_HEIGHT / model.unit_in_metres
    floors = free_run(voxels.occupied, up, -1) == 0
    floors &= ~voxels.occupied
    above = free_run(voxels.occupied, up, 1)[floors]
    heights = above[above >= 3] * voxels.size
    room = float(np.median(heights)) if len(heights) else float(scene.hi[up] - scene.lo[up])
    return max(person if _LOWEST * room < person < 0.9 * room else 0.5 * room, 2.5 * voxels.size)


def _walk(scene: Scene, known: Survey, *, frames: int, seed: int) -> CameraPath | None:
    voxels, eyes = known.voxels, known.eye_height
    region = _region(scene, voxels, eyes)
    if region is None:
        return None
    length = frames * _STEP * eyes
    route = _route(region, voxels, length, np.random.default_rng(seed))
    if route is None:
        return None
    line = _smooth(voxels.centres(route), voxels, region.room, eyes)
    way = np.concatenate([[0], np.cumsum(np.sqrt((np.diff(line, axis=0) ** 2).sum(axis=1)))])
    if way[-1] < min(2 * eyes, length / 2):
        return None
    stops = np.linspace(0, min(way[-1], length), frames)
    positions = np.stack([np.interp(stops, way, line[:, axis]) for axis in range(3)], axis=1)
    return _looking_ahead(scene, positions, eyes)


def _region(scene: Scene, voxels: Voxels, eyes: float) -> _Region | None:
    """The connected voxels at eye height with the most to see around them; None where one can walk nowhere."""
    store, occupied = scene.store, voxels.occupied
    up = AXES[store.manifest.model.up]
    eye = eyes / voxels.size
    room = clearance(occupied)
    below = free_run(occupied, up, -1)
    walkable = (below >= 0.6 * eye - 1) & (below <= 1.4 * eye) & (room >= 1.5)
    places = np.argwhere(walkable)
    if len(places) and store.cells["computed"].any():
        computed = store.cell_at(voxels.centres(places)) >= 0
        if computed.any():
            places = places[computed]
    if not len(places):
        return None
    around = enclosure(occupied, voxels.facing, places, _horizontal(up))
    at = tuple(places.T)
    above = free_run(occupied, up, 1)[at] >= 0
    interest = (around**2 * np.where(above, 1.0, 0.6)).astype(np.float32)
    off_height = np.abs(below[at] + 0.5 - eye) / eye
    tight = np.maximum(1 - room[at] / (0.7 * eye), 0) ** 2 + 0.3 / np.maximum(room[at] - 0.5, 0.25)
    cost = np.full(occupied.shape, np.inf, np.float32)
    cost[at] = 1 + 3 * off_height + 6 * tight + 4 * (1 - interest)
    flat = np.ravel_multi_index(at, occupied.shape).astype(np.int64)
    best: NDArray[np.bool_] | None = None
    left = np.ones(len(flat), np.bool_)
    best_score = 0.0
    while left.any():
        start = int(np.flatnonzero(left)[np.argmax(interest[left])])
        total, _ = cheapest_ways(cost, int(flat[start]))
        reached = left & np.isfinite(total[flat])
        left &= ~reached
        score = float(interest[reached].sum())
        if score > best_score:
            best, best_score = reached, score
        if best_score >= float(interest[left].sum()):
            break
    if best is None:
        return None
    inside = np.full(occupied.shape, np.inf, np.float32)
    kept = tuple(places[best].T)
    inside[kept] = cost[kept]
    return _Region(places[best], flat[best], interest[best], inside, room)


def _horizontal(up: int) -> NDArray[np.float64]:
    """Sixteen unit directions (16, 3) across the up axis."""
    angles = np.arange(16) * (2 * math.pi / 16) + 0.1
    directions = np.zeros((16, 3))
    directions[:, (up + 1) % 3] = np.cos(angles)
    directions[:, (up + 2) % 3] = np.sin(angles)
    return directions


def _route(region: _Region, voxels: Voxels, length: float, random: np.random.Generator) -> NDArray[np.int64] | None:
    """Voxels (n, 3) along a way of at least `length` model units through places far apart, if the region has one."""
    attraction = region.interest.astype(np.float64) * (0.85 + 0.3 * random.random(len(region.flat)))
    attraction *= np.minimum(region.room.ravel()[region.flat], 5) / 5
    here = int(region.flat[np.argmax(attraction)])
    visited = np.full(len(region.flat), np.inf)
    pieces: list[NDArray[np.int64]] = []
    travelled = 0.0
    for _ in range(24):
        total, before = cheapest_ways(region.cost, here)
        ways = total[region.flat].astype(np.float64)
        visited = np.minimum(visited, ways)
        usable = np.isfinite(ways)
        # Far from all that was seen, attractive, but not at the other end of the world if the tour is short.
        reach = max(2 * length / voxels.size, 8)
        score = np.where(usable, np.minimum(visited, reach) * attraction / (1 + ways / (2 * reach)), -1)
        goal = int(region.flat[np.argmax(score)])
        if goal == here:
            break
        piece = [goal]
        while piece[-1] != here:
            piece.append(int(before[piece[-1]]))
        line = np.stack(np.unravel_index(np.array(piece[::-1]), region.cost.shape), axis=1).astype(np.int64)
        pieces.append(line if not pieces else line[1:])
        travelled += float(np.sqrt((np.diff(line, axis=0) ** 2).sum(axis=1)).sum()) * voxels.size
        here = goal
        if travelled >= 1.15 * length:  # smoothing shortens it
            break
    return np.concatenate(pieces) if pieces else None


def _smooth(line: NDArray[np.float64], voxels: Voxels, room: NDArray[np.float32], eyes: float) -> NDArray[np.float64]:
    """The line (n, 3) with its corners rounded, as far as it stays at least a voxel and a half off every surface."""
    way = np.concatenate([[0], np.cumsum(np.sqrt((np.diff(line, axis=0) ** 2).sum(axis=1)))])
    count = max(int(way[-1] / (0.5 * voxels.size)), 2) + 1
    stops = np.linspace(0, way[-1], count)
    points = np.stack([np.interp(stops, way, line[:, axis]) for axis in range(3)], axis=1)
    sigma = 0.6 * eyes / (0.5 * voxels.size)
    for _ in range(8):
        smoother = _blurred(points, sigma / 3)
        voxel = np.floor((smoother - voxels.lo) / voxels.size).astype(np.int64)
        voxel = np.clip(voxel, 0, np.array(room.shape) - 1)
        safe = np.where(room[tuple(voxel.T)] >= 1.5, 1.0, 0.0)
        share = np.minimum(_eroded(safe, 2), 1)[:, None]
        points = smoother * share + points * (1 - share)
    return points


def _blurred(values: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Values (n, k) averaged along n with a Gaussian of `sigma` steps; the ends stay."""
    reach = max(1, min(int(3 * sigma), len(values) - 1))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-6)) ** 2)
    weights /= weights.sum()
    before = 2 * values[0] - values[reach:0:-1]
    after = 2 * values[-1] - values[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, values, after])
    return np.stack([np.convolve(padded[:, k], weights, mode="valid") for k in range(values.shape[1])], axis=1)


def _eroded(values: NDArray[np.float64], steps: int) -> NDArray[np.float64]:
    """The smallest of each value (n,) and its neighbours up to `steps` away."""
    padded = np.pad(values, steps, mode="edge")
    return np.min([padded[k : k + len(values)] for k in range(2 * steps + 1)], axis=0)


def _looking_ahead(scene: Scene, positions: NDArray[np.float64], eyes: float) -> CameraPath:
    """Poses that look along the motion, a little ahead, turning smoothly and never far up or down."""
    up_name = scene.store.manifest.model.up
    up = up_vector(up_name)
    step = max(float(np.sqrt(((positions[1] - positions[0]) ** 2).sum())), 1e-12)
    ahead = max(2, round(1.5 * eyes / step))
    beyond = positions[-1] + (positions[-1] - positions[-2]) / step * eyes * np.linspace(0.2, 2, 10)[:, None]
    line = np.concatenate([positions, beyond])
    targets = line[np.minimum(np.arange(len(positions)) + ahead, len(line) - 1)]
    yaws, pitches = np.transpose([direction_yaw_pitch(d, up_name) for d in targets - positions])
    angles = np.stack([np.unwrap(yaws), np.clip(pitches, -0.5, 0.5) * 0.6 - 0.04], axis=1)
    angles = _blurred(angles, max(1.0, min(0.5 * ahead, len(positions) / 6)))
    orientations = [looking(yaw_pitch_direction(float(yaw), float(pitch), up_name), up) for yaw, pitch in angles]
    return CameraPath(np.arange(len(positions)) / FRAMES_PER_SECOND, positions, np.array(orientations))


def _orbit(scene: Scene, *, frames: int, seed: int) -> CameraPath:
    """A turn around the model, looking at its middle from a little above."""
    up_name = scene.store.manifest.model.up
    up = up_vector(up_name)
    centre = (scene.lo + scene.hi) / 2
    start = np.random.default_rng(seed).random() * 2 * math.pi
    turn = min(2 * math.pi, frames * 0.05)
    positions, orientations = [], []
    for part in np.linspace(0, 1, frames):
        direction = yaw_pitch_direction(start + turn * float(part), 0.35, up_name)
        positions.append(centre + direction * 0.9 * scene.extent)
        orientations.append(looking(-direction, up))
    return CameraPath(np.arange(frames) / FRAMES_PER_SECOND, np.array(positions), np.array(orientations))
