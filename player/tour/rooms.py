"""A walk through the most interesting rooms of a model that keeps clear of its surfaces.

Where a floor lies below at eye height one can walk; a place is interesting if there is something to see around it. The
walk visits places far apart in the largest interesting region, along ways that keep off the walls, smoothed, looking
ahead. Where cells were computed it never leaves them: where no floor lies at eye height below them it floats, and where
there is no way to go it looks around.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from player.camera.path import CameraPath
from player.camera.view import AXES, direction_yaw_pitch, looking, up_vector, yaw_pitch_direction
from player.shown_model import ShownModel
from player.tour.occupancy import cheapest_ways, clearance, enclosure, free_run
from player.tour.survey import Survey, Voxels
from player.tour.tour import FRAMES_PER_SECOND

#: Way between two frames, in eye heights: brisk, but no chase.
_STEP = 0.12


#: Room around whoever walks, and whoever floats, in eye heights; never below _LEAST_ROOM voxels.
_ROOM_WALKING, _ROOM_FLOATING, _LEAST_ROOM = 0.1, 0.25, 1.5

#: Radians between two frames for whoever looks around.
_TURN = 0.05


@dataclass(frozen=True, eq=False)
class _Region:
    """Where one can go."""

    flat: NDArray[np.int64]  # (n,) flat indices of voxels
    interest: NDArray[np.float32]  # (n,) 0 to 1
    off_height: NDArray[np.float32]  # (n,) from 0, at eye height above a floor, to 1
    cost: NDArray[np.float32]  # (nx, ny, nz) of a way through each voxel, infinite elsewhere
    room: NDArray[np.float32]  # (nx, ny, nz) distance to the nearest surface, in voxels


def walk_through_rooms(model: ShownModel, known: Survey, *, frames: int, seed: int) -> CameraPath | None:
    """A walk of `frames` poses; None where there is no region to walk through. The same for the same store and seed."""
    voxels, eyes = known.voxels, known.eye_height
    regions = _regions(model, voxels, eyes)
    length = frames * _STEP * eyes
    for region in regions:
        route = _route(region, voxels, length, np.random.default_rng(seed))
        if route is None:
            continue
        line = _smooth(model, voxels.centres(route), voxels, region, eyes)
        way = np.concatenate([[0], np.cumsum(np.sqrt((np.diff(line, axis=0) ** 2).sum(axis=1)))])
        if way[-1] < min(2 * eyes, length / 2):
            continue
        stops = np.linspace(0, min(way[-1], length), frames)
        positions = np.stack([np.interp(stops, way, line[:, axis]) for axis in range(3)], axis=1)
        nearest = np.clip(np.searchsorted(way, stops), 0, len(line) - 1)
        positions = np.where(_allowed(model, positions)[:, None], positions, line[nearest])
        return _looking_ahead(model, positions, eyes)
    if not regions or not model.store.cells["computed"].any():
        return None
    best = regions[0].flat[np.argmax(regions[0].interest)]
    place = np.stack(np.unravel_index([best], voxels.occupied.shape), axis=1)
    return _looking_around(model, voxels.centres(place)[0], frames)


def _allowed(model: ShownModel, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the points (n, 3) lie in computed cells; all of them where there is no such cell."""
    if not model.store.cells["computed"].any():
        return np.ones(len(points), np.bool_)
    return model.store.cell_at(points) >= 0


def _regions(model: ShownModel, voxels: Voxels, eyes: float) -> list[_Region]:
    """Where one can walk, and where cells were computed, where one can float: each the connected voxels with the most
    to see around them. Those that are not there are left out.
    """
    occupied = voxels.occupied
    eye = eyes / voxels.size
    room = clearance(occupied)
    below = free_run(occupied, AXES[model.store.manifest.model.up], -1)
    high = (below >= 0.75 * eye - 1) & (below <= 1.25 * eye)
    wanted = [high & (room >= max(_LEAST_ROOM, _ROOM_WALKING * eye))]
    if model.store.cells["computed"].any():
        wanted.append(room >= max(_LEAST_ROOM, _ROOM_FLOATING * eye))
    regions = []
    for places in map(np.argwhere, wanted):
        inside = places[_allowed(model, voxels.centres(places))]
        region = _region(model, voxels, eye, inside[~_in_solids(voxels, inside)], room, below)
        if region is not None:
            regions.append(region)
    return regions


def _in_solids(voxels: Voxels, places: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which of the voxels (n, 3) lie inside solids: all that is seen from there turns its back."""
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    fronts, backs = (enclosure(voxels.occupied, sign * voxels.facing, places, directions) for sign in (1, -1))
    return np.asarray((fronts == 0) & (backs > 0))


def _region(
    model: ShownModel,
    voxels: Voxels,
    eye: float,
    places: NDArray[np.int64],
    room: NDArray[np.float32],
    below: NDArray[np.int32],
) -> _Region | None:
    """The connected ones of the voxels `places` (n, 3) with the most to see around them; None where there are none.

    eye: in voxels; room, below (nx, ny, nz): voxels to the nearest surface, and to the floor.
    """
    if not len(places):
        return None
    up = AXES[model.store.manifest.model.up]
    occupied = voxels.occupied
    around = enclosure(occupied, voxels.facing, places, _horizontal(up))
    at = tuple(places.T)
    above = free_run(occupied, up, 1)[at] >= 0
    interest = (around**2 * np.where(above, 1.0, 0.6)).astype(np.float32)
    off_height = np.where(below[at] < 0, 1, np.minimum(np.abs(below[at] + 1 - eye) / eye, 1))
    tight = np.maximum(1 - room[at] / (0.7 * eye), 0) ** 2 + 0.3 / np.maximum(room[at] - 0.5, 0.25)
    cost = np.full(occupied.shape, np.inf, np.float32)
    cost[at] = 1 + 3 * off_height + 6 * tight + 4 * (1 - interest)
    flat = np.ravel_multi_index(at, occupied.shape).astype(np.int64)
    best: NDArray[np.bool_] | None = None
    left = np.ones(len(flat), np.bool_)
    best_score = -1.0 if model.store.cells["computed"].any() else 0.0  # there even where nothing is to be seen
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
    return _Region(flat[best], interest[best], off_height[best].astype(np.float32), inside, room)


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
    attraction /= 1 + (4 * region.off_height) ** 2
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


def _smooth(
    model: ShownModel, line: NDArray[np.float64], voxels: Voxels, region: _Region, eyes: float
) -> NDArray[np.float64]:
    """The line (n, 3) with its corners rounded, as far as it stays in the region, and in computed cells."""
    way = np.concatenate([[0], np.cumsum(np.sqrt((np.diff(line, axis=0) ** 2).sum(axis=1)))])
    count = max(int(way[-1] / (0.5 * voxels.size)), 2) + 1
    stops = np.linspace(0, way[-1], count)
    points = np.stack([np.interp(stops, way, line[:, axis]) for axis in range(3)], axis=1)
    sigma = 0.6 * eyes / (0.5 * voxels.size)
    for _ in range(8):
        smoother = _blurred(points, sigma / 3)
        voxel = np.floor((smoother - voxels.lo) / voxels.size).astype(np.int64)
        voxel = np.clip(voxel, 0, np.array(region.cost.shape) - 1)
        safe = np.isfinite(region.cost[tuple(voxel.T)]) & _allowed(model, smoother)
        share = _eroded(safe.astype(np.float64), 2)[:, None]
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


def _looking_ahead(model: ShownModel, positions: NDArray[np.float64], eyes: float) -> CameraPath:
    """Poses that look along the motion, a little ahead, turning smoothly and never far up or down."""
    up_name = model.store.manifest.model.up
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


def _looking_around(model: ShownModel, position: NDArray[np.float64], frames: int) -> CameraPath:
    """Poses at one place (3,) that turn to all sides."""
    up_name = model.store.manifest.model.up
    directions = [yaw_pitch_direction(frame * _TURN, 0.0, up_name) for frame in range(frames)]
    orientations = np.array([looking(direction, up_vector(up_name)) for direction in directions])
    return CameraPath(np.arange(frames) / FRAMES_PER_SECOND, np.tile(position, (frames, 1)), orientations)
