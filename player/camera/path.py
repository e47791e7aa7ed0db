"""Recorded paths: where a camera was and which way it looked, over time; read, written, interpolated.

A path file is JSON:

    {"format": "vlod-path", "version": 1,
     "times": [0.0, 0.04, ...],                      seconds, increasing
     "positions": [[x, y, z], ...],                  model units
     "orientations": [[x, y, z, w], ...]}            unit quaternions, camera to model, as in glTF

Based on: Catmull, Rom: A Class of Local Interpolating Splines, 1974 (positions); Shoemake: Animating Rotation with
Quaternion Curves, SIGGRAPH 1985 (orientations).
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from player.camera.view import Vector, normalised
from player.errors import PathError

FORMAT = "vlod-path"
VERSION = 1


@dataclass(frozen=True, eq=False)
class CameraPath:
    """Poses of a camera over time."""

    times: NDArray[np.float64]  # (n,) seconds, increasing
    positions: NDArray[np.float64]  # (n, 3) model units
    orientations: NDArray[np.float64]  # (n, 4) unit quaternions x, y, z, w: camera to model

    def __len__(self) -> int:
        return len(self.times)

    @property
    def duration(self) -> float:
        """Seconds from the first pose to the last."""
        return float(self.times[-1] - self.times[0])

    @property
    def length(self) -> float:
        """Way along the positions, in model units."""
        steps = np.diff(self.positions, axis=0)
        return float(np.sqrt((steps * steps).sum(axis=1)).sum())

    def pose(self, index: int) -> tuple[Vector, Vector]:
        """Position (3,) and orientation (4,) of a stored pose."""
        return self.positions[index], self.orientations[index]

    def at(self, time: float) -> tuple[Vector, Vector]:
        """Position (3,) and orientation (4,) at a time, in seconds; the ends hold before and after."""
        if len(self) == 1 or time <= self.times[0]:
            return self.pose(0)
        if time >= self.times[-1]:
            return self.pose(len(self) - 1)
        i = int(np.searchsorted(self.times, time, side="right")) - 1
        span = self.times[i + 1] - self.times[i]
        t = float((time - self.times[i]) / span)
        start, end = self._tangent(i) * span, self._tangent(i + 1) * span
        a, b = self.positions[i], self.positions[i + 1]
        position = (
            (2 * t**3 - 3 * t**2 + 1) * a
            + (t**3 - 2 * t**2 + t) * start
            + (3 * t**2 - 2 * t**3) * b
            + (t**3 - t**2) * end
        )
        return position, slerp(self.orientations[i], self.orientations[i + 1], t)

    def resampled(self, frames_per_second: float) -> CameraPath:
        """The same motion in steps of equal time."""
        count = max(1, round(self.duration * frames_per_second) + 1)
        times = self.times[0] + np.arange(count) / frames_per_second
        poses = [self.at(float(time)) for time in times]
        return CameraPath(times, np.array([p for p, _ in poses]), np.array([q for _, q in poses]))

    def _tangent(self, i: int) -> Vector:
        before, after = max(i - 1, 0), min(i + 1, len(self) - 1)
        return (self.positions[after] - self.positions[before]) / (self.times[after] - self.times[before])


def slerp(a: Vector, b: Vector, t: float) -> Vector:
    """The rotation a part `t` (0 to 1) of the shorter way from quaternion a to quaternion b."""
    cosine = float((a * b).sum())
    if cosine < 0:
        b, cosine = -b, -cosine
    if cosine > 0.9995:
        return normalised(a + (b - a) * t)
    angle = np.arccos(cosine)
    return normalised((np.sin((1 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle))


def path_text(path: CameraPath) -> str:
    """The content of a path file."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "times": path.times.tolist(),
        "positions": path.positions.tolist(),
        "orientations": path.orientations.tolist(),
    }
    return json.dumps(content) + "\n"


def write_path(file: str | os.PathLike[str], path: CameraPath) -> None:
    """Writes a path file; whoever reads it sees the former file or the whole new one. Raises PathError."""
    write_whole(Path(file), path_text(path))


def write_whole(file: Path, text: str) -> None:
    """Writes a text file whole or not at all, making its directory. Raises PathError where that is not possible."""
    temporary = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(file)
    except OSError as error:
        raise PathError(f"{file} cannot be written: {error.strerror}") from error


def read_path(file: str | os.PathLike[str]) -> CameraPath:
    """Reads and checks a path file. Raises PathError, which names the file and what is wrong with it."""
    name = os.fspath(file)
    try:
        content = json.loads(Path(file).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise PathError(f"{name}: there is no such file; make one with: vlod path STORE -o {name}") from None
    except (OSError, UnicodeDecodeError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or "it is not JSON"
        raise PathError(f"{name} cannot be read as a path file: {reason}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise PathError(f'{name} is not a path file: its "format" must be "{FORMAT}"')
    if content.get("version") != VERSION:
        raise PathError(f"{name} is of path version {content.get('version')}; this vLOD reads version {VERSION}")
    times = _numbers(content, "times", (), name)
    positions = _numbers(content, "positions", (3,), name)
    orientations = _numbers(content, "orientations", (4,), name)
    if not len(times) == len(positions) == len(orientations):
        raise PathError(
            f"{name}: {len(times)} times, {len(positions)} positions and {len(orientations)} orientations: "
            "there must be as many of each"
        )
    if not len(times):
        raise PathError(f"{name} has no poses: a path needs at least one")
    if len(times) > 1 and float(np.diff(times).min()) <= 0:
        at = int(np.argmin(np.diff(times) > 0)) + 1
        raise PathError(f"{name}: times must increase, but times[{at}] does not")
    lengths = np.sqrt((orientations * orientations).sum(axis=1))
    if float(np.abs(lengths - 1).max()) > 1e-3:
        at = int(np.argmax(np.abs(lengths - 1)))
        raise PathError(f"{name}: orientations[{at}] is not a unit quaternion (its length is {lengths[at]:.4g})")
    return CameraPath(times, positions, normalised(orientations))


def _numbers(content: dict[str, Any], key: str, shape: tuple[int, ...], name: str) -> NDArray[np.float64]:
    what = f"{shape[0]} finite numbers" if shape else "a finite number"
    value = content.get(key)
    if not isinstance(value, list):
        raise PathError(f'{name}: "{key}" must be a list, {what} each')
    for index, item in enumerate(value):
        items = item if isinstance(item, list) and shape else [item]
        if (shape and len(items) != shape[0]) or not all(_finite(number) for number in items):
            raise PathError(f'{name}: "{key}"[{index}] must be {what}, not {str(item)[:60]}')
    return np.array(value, np.float64).reshape(-1, *shape)


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
