"""Scenes of several files become repaired meshes, and parts that place them, in the first file's frame.

One scene, and of it one mesh, is held at a time.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jobs.importing.far import Shape, shape_of
from jobs.importing.keeping.saved import MeshView, Part
from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.source_scene import SourceScene, compose
from jobs.importing.repair import FARTHEST, repair
from storage.base.errors import ModelError, ParameterError
from storage.meshes.placement import IDENTITY

#: Metres per unit, by the names that people write.
UNITS = {
    "um": 1e-6,
    "micrometre": 1e-6,
    "mm": 1e-3,
    "millimetre": 1e-3,
    "cm": 1e-2,
    "centimetre": 1e-2,
    "dm": 0.1,
    "decimetre": 0.1,
    "m": 1.0,
    "metre": 1.0,
    "km": 1e3,
    "kilometre": 1e3,
    "in": 0.0254,
    "inch": 0.0254,
    "ft": 0.3048,
    "foot": 0.3048,
    "yd": 0.9144,
    "yard": 0.9144,
    "mi": 1609.344,
    "mile": 1609.344,
}

_SPELLINGS = {"inches": "inch", "feet": "foot"}

#: For each up axis, the rotation that takes a frame with that axis up to one with y up.
_TO_Y_UP = {
    "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}

#: A placement that flattens to below this share of the product of its columns' lengths has no inverse.
_SINGULAR = 1e-12

#: A placement that shrinks below this has none either.
_SHORTEST = 1e-30


def metres_per_unit(units: str | float) -> float:
    """Metres per unit of a unit's name or of a number. Raises ParameterError for what is neither."""
    text = str(units).strip().lower()
    text = _SPELLINGS.get(text, text)
    for name in (text, text.removesuffix("s"), text.removesuffix("s").replace("meter", "metre")):
        if name in UNITS:
            return UNITS[name]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise ParameterError(f"units {units!r}: expected one of {', '.join(UNITS)}, or metres per unit as a number")
    return value


class Joined(NamedTuple):
    """Scenes in one frame."""

    parts: list[Part]  # of the meshes, counted in the order in which they were handed on
    up: str  # "x", "y" or "z"
    unit_in_metres: float
    shapes: list[Shape]  # of the meshes
    tally: Tally  # of what was repaired


def join_scenes(
    files: Sequence[Path],
    scenes: Iterable[SourceScene],
    units: str | float | None,
    up: str | None,
    take: Callable[[MeshView], None],
) -> Joined:
    """Repair the meshes of the `scenes` of some `files` and hand them to `take`, one by one.

    Files that do not say their unit or up axis are taken to share the first file's; `units` and `up` hold for all
    files. A defect of a mesh counts once for each of its placements. Raises ModelError if no triangle is left,
    ParameterError for a bad `units` or `up`.
    """
    if up not in (None, "x", "y", "z"):
        raise ParameterError(f"up {up!r}: expected x, y or z")
    unit = 0.0 if units is None else metres_per_unit(units)
    axis = up or ""
    folder = _common_folder(files)
    joined = _Joining(take)
    for scene in scenes:
        unit = unit or scene.unit_in_metres or 1.0
        axis = axis or scene.up or scene.usual_up
        prefix = f"{scene.file.relative_to(folder).as_posix()}/" if len(files) > 1 else ""
        frame = _frame(
            1.0 if units is not None else (scene.unit_in_metres or unit) / unit,
            axis if up is not None else scene.up or axis,
            axis,
        )
        with np.errstate(over="ignore", under="ignore", invalid="ignore", divide="ignore"):
            joined.add(scene, frame, prefix)
    if not joined.parts:
        raise ModelError(f"{_inputs(files)}: no triangle is left to draw{_losses(joined.tally)}; check the export")
    return Joined(joined.parts, axis, unit, joined.shapes, joined.tally)


class _Joining:
    """Meshes handed on, and parts and defects noted, scene by scene."""

    def __init__(self, take: Callable[[MeshView], None]) -> None:
        self.parts: list[Part] = []
        self.tally = Tally()
        self._take = take
        self.shapes: list[Shape] = []

    def add(self, scene: SourceScene, frame: np.ndarray, prefix: str) -> None:
        """Takes a scene under a (3, 4) matrix; the names of its parts are prefixed."""
        self.tally.update(scene.tally, prefix)
        users: dict[int, list[int]] = {}
        for number, node in enumerate(scene.nodes):
            users.setdefault(node.mesh, []).append(number)
        placed: dict[int, Part] = {}
        for index in sorted(users):
            mesh = self._repaired(scene, index, users[index], prefix)
            if mesh is None:
                continue
            nodes = [scene.nodes[number] for number in users[index]]
            matrices = [node.matrix if frame is IDENTITY else compose(frame, node.matrix) for node in nodes]
            shape = shape_of(mesh)
            flaws = _flaws(np.stack(matrices), shape.lo, shape.hi)
            misplaced, flat = (flaw.tolist() for flaw in flaws)
            for at, (number, node) in enumerate(zip(users[index], nodes, strict=True)):
                if misplaced[at] or flat[at]:
                    self.tally.add(Defect.MISPLACED if misplaced[at] else Defect.SINGULAR, prefix + node.name)
                else:
                    placed[number] = Part(len(self.shapes), prefix + node.name, matrices[at])
            self._take(mesh)
            self.shapes.append(shape)
        self.parts.extend(placed[number] for number in sorted(placed))

    def _repaired(self, scene: SourceScene, index: int, users: Sequence[int], prefix: str) -> MeshView | None:
        """A mesh without its defects, which are noted for each node that places it; None if nothing is left."""
        source = scene.meshes[index]
        mesh, counts = repair(source)
        names = Counter(prefix + scene.nodes[number].name for number in users)
        for defect, count in (*source.defects.items(), *counts.items()):
            for name, times in names.items():
                self.tally.add(defect, name, count * times)
        return mesh


def _flaws(matrices: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of some (k, 3, 4) matrices throw a mesh with that box out of reach, and which flatten it."""
    linear = matrices[:, :, :3]
    size = np.maximum(np.abs(low), np.abs(high))
    x, y, z = (np.abs(linear[:, :, axis]) * size[axis] for axis in range(3))
    reach = ((x + y) + z) + np.abs(matrices[:, :, 3])
    misplaced = ~(np.isfinite(matrices).all(axis=(1, 2)) & (reach <= FARTHEST).all(axis=1))
    lengths = np.sqrt((linear[:, 0] ** 2 + linear[:, 1] ** 2) + linear[:, 2] ** 2)
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(linear / np.where(lengths > 0, lengths, 1.0)[:, None, :], 0, 2)
    volume = (a * (e * i - f * h) + b * (f * g - d * i)) + c * (d * h - e * g)
    return misplaced, ~misplaced & ~((np.abs(volume) >= _SINGULAR) & (lengths > _SHORTEST).all(axis=1))


def _frame(scale: float, up: str, target: str) -> np.ndarray:
    """The (3, 4) matrix from a frame with `up` to one with `target`, times `scale`; IDENTITY itself if it is that."""
    if scale == 1.0 and up == target:
        return IDENTITY
    turn = compose(
        np.column_stack([_TO_Y_UP[target].T, np.zeros(3)]),
        np.column_stack([_TO_Y_UP[up], np.zeros(3)]),
    )
    return turn * scale


def _common_folder(files: Sequence[Path]) -> Path:
    folder = files[0].parent
    while not all(file.is_relative_to(folder) for file in files):
        folder = folder.parent
    return folder


def _inputs(files: Sequence[Path]) -> str:
    return str(files[0]) + (f" and {len(files) - 1} more" if len(files) > 1 else "")


def _losses(tally: Tally) -> str:
    losses = [f"{counts['total']} {defect}" for defect, counts in tally.report().items()]
    return f" (removed: {', '.join(losses)})" if losses else ""
