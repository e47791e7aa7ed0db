"""Scenes of several files become one list of repaired meshes and their placements, in the first file's frame."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jobs.importing.repair import FARTHEST, repair
from jobs.importing.saved import IDENTITY, MeshView, Placement
from jobs.importing.scene import Defect, SourceScene, Tally, compose
from storage.errors import ModelError, ParameterError

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


def join_scenes(
    scenes: Sequence[SourceScene], units: str | float | None, up: str | None
) -> tuple[list[MeshView], list[Placement], str, float, dict[str, dict[str, Any]]]:
    """Repaired meshes, placements, up axis, metres per unit and the report of what was repaired.

    Files that do not say their unit or up axis are taken to share the first file's; `units` and `up` hold for all
    files. A defect of a mesh counts once for each of its placements. Empties the scenes' lists of meshes as it goes, to
    save memory. Raises ModelError if no triangle is left, ParameterError for a bad `units` or `up`.
    """
    if up not in (None, "x", "y", "z"):
        raise ParameterError(f"up {up!r}: expected x, y or z")
    first = scenes[0]
    unit = metres_per_unit(units) if units is not None else first.unit_in_metres or 1.0
    axis = up or first.up or first.usual_up
    folder = _common_folder([scene.file for scene in scenes])
    meshes: list[MeshView] = []
    placements: list[Placement] = []
    tally = Tally()
    for scene in scenes:
        prefix = f"{scene.file.relative_to(folder).as_posix()}/" if len(scenes) > 1 else ""
        tally.update(scene.tally, prefix)
        frame = _frame(
            1.0 if units is not None else (scene.unit_in_metres or unit) / unit,
            axis if up is not None else scene.up or axis,
            axis,
        )
        with np.errstate(over="ignore", under="ignore", invalid="ignore", divide="ignore"):
            _add_scene(scene, frame, prefix, meshes, placements, tally)
    if not placements:
        raise ModelError(f"{_inputs(scenes)}: no triangle is left to draw{_losses(tally)}; check the export")
    return meshes, placements, axis, unit, tally.report()


def _add_scene(
    scene: SourceScene,
    frame: np.ndarray,
    prefix: str,
    meshes: list[MeshView],
    placements: list[Placement],
    tally: Tally,
) -> None:
    users: dict[int, list[int]] = {}
    for number, node in enumerate(scene.nodes):
        users.setdefault(node.mesh, []).append(number)
    placed: dict[int, Placement] = {}
    for index in range(len(scene.meshes)):
        if index not in users:
            continue
        source = scene.meshes[index]
        mesh, counts = repair(source)
        scene.meshes[index] = type(source)(source.name, np.empty((0, 3)), np.empty((0, 3), np.int64))
        names = Counter(prefix + scene.nodes[number].name for number in users[index])
        for defect, count in (*source.defects.items(), *counts.items()):
            for name, times in names.items():
                tally.add(defect, name, count * times)
        if mesh is None:
            continue
        nodes = [scene.nodes[number] for number in users[index]]
        matrices = [node.matrix if frame is IDENTITY else compose(frame, node.matrix) for node in nodes]
        flaws = _flaws(np.stack(matrices), mesh.positions.min(axis=0), mesh.positions.max(axis=0))
        misplaced, flat = (flaw.tolist() for flaw in flaws)
        for at, (number, node) in enumerate(zip(users[index], nodes, strict=True)):
            if misplaced[at] or flat[at]:
                tally.add(Defect.MISPLACED if misplaced[at] else Defect.SINGULAR, prefix + node.name)
            else:
                placed[number] = Placement(len(meshes), prefix + node.name, matrices[at])
        meshes.append(mesh)
    placements.extend(placed[number] for number in sorted(placed))


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


def _inputs(scenes: Sequence[SourceScene]) -> str:
    return str(scenes[0].file) + (f" and {len(scenes) - 1} more" if len(scenes) > 1 else "")


def _losses(tally: Tally) -> str:
    losses = [f"{counts['total']} {defect}" for defect, counts in tally.report().items()]
    return f" (removed: {', '.join(losses)})" if losses else ""
