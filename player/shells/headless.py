"""Renders a path without a window: frames as PNG files, and a report of what each took."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from player.camera.path import CameraPath, write_whole
from player.camera.view import View
from player.renderer.context import Abilities, abilities, headless_context
from player.renderer.target import Target
from player.scene import Scene
from player.shells.compare import Difference, Picture, difference, magnified
from player.walkthrough import FrameStatistics, Settings, Walkthrough

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Screen:
    """The picture to render."""

    width: int = 1280  # in pixels
    height: int = 720  # in pixels
    field_of_view: float = 60.0  # vertical, in degrees
    samples: int = 0  # per pixel; 0: one
    force_gl33: bool = False  # use the path for OpenGL 3.3 even where the driver can do more


@dataclass(frozen=True)
class Frame:
    """One rendered frame."""

    index: int
    picture: Picture
    statistics: FrameStatistics
    difference: Difference | None = None  # from the full model
    full: Picture | None = None  # the full model's picture


@dataclass
class Report:
    """What rendering a path took; `content` is what is written as JSON."""

    content: dict[str, Any] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """The comparison found nothing wrong, or was not asked for."""
        compared = self.content.get("compare")
        return compared is None or bool(compared["passed"])


def near_and_far(scene: Scene, position: np.ndarray, able: Abilities) -> tuple[float, float]:
    """Distances of the near and far plane in model units for an eye at `position` (3,).

    With reversed depth the near plane costs no precision. Otherwise it is as far off as 24 bits of depth need.
    """
    corner = np.maximum(np.abs(scene.lo - position), np.abs(scene.hi - position))
    far = 1.01 * float(np.sqrt((corner * corner).sum())) + scene.extent * 1e-3
    closest = (1e-6 if able.reversed_depth else 1e-4) * scene.extent
    return max(closest, 2 * scene.store.grid.step), far


def render(
    scene: Scene, path: CameraPath, screen: Screen, settings: Settings, *, compare: bool = False
) -> Iterator[tuple[Frame, Abilities]]:
    """Renders each pose of `path` in turn.

    compare: renders the full model (strategy none) as well. Raises GraphicsError where there is no OpenGL.
    """
    context = headless_context()
    able = abilities(context, force_gl33=screen.force_gl33)
    size = (screen.width, screen.height)
    target = Target(context, size, samples=screen.samples, reversed_depth=able.reversed_depth)
    walk = Walkthrough(scene, context, able, settings)
    whole: Walkthrough | None = None
    if compare:
        plain = replace(settings, strategy="none", wait=True, prefetch=False, cache_bytes=1 << 62)
        whole = Walkthrough(scene, context, able, plain)
    try:
        for index in range(len(path)):
            position, orientation = path.pose(index)
            near, far = near_and_far(scene, position, able)
            view = View(position, orientation, screen.field_of_view, screen.width, screen.height, near, far)
            statistics = walk.frame(view, target)
            picture = target.read()
            full = None
            if whole is not None:
                whole.frame(view, target)
                full = target.read()
            found = None if full is None else difference(picture, full)
            yield Frame(index, picture, statistics, found, full), able
    finally:
        walk.close()
        if whole is not None:
            whole.close()
        target.release()
        context.release()


def play(
    scene: Scene,
    path: CameraPath,
    screen: Screen,
    settings: Settings,
    *,
    frames: Path | None = None,
    keep: list[Picture] | None = None,
    compare: bool = False,
    progress: Progress | None = None,
) -> Report:
    """Renders `path`, writes the pictures into the directory `frames`, and returns the report.

    keep: gets the pictures too, alpha included.
    compare: also compares each frame with the full model; the worst frame's pair and the difference go to `frames` too.
    progress: called with (frames done, frames in all).
    """
    if frames is not None:
        frames.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    worst: Frame | None = None
    able: Abilities | None = None
    for frame, able in render(scene, path, screen, settings, compare=compare):  # noqa: B007
        name = f"frame_{frame.index:04d}.png"
        row: dict[str, Any] = {
            "index": frame.index,
            "time": float(path.times[frame.index]),
            "position": path.positions[frame.index].tolist(),
            "orientation": path.orientations[frame.index].tolist(),
            "image": name if frames is not None else None,
            **asdict(frame.statistics),
        }
        if frames is not None:
            save(frames / name, frame.picture)
        if keep is not None:
            keep.append(frame.picture)
        if frame.difference is not None:
            row["compare"] = asdict(frame.difference)
            if worst is None or _badness(frame) > _badness(worst):
                worst = frame
        rows.append(row)
        if progress is not None:
            progress(frame.index + 1, len(path))
    if able is None:
        raise AssertionError("a path has at least one pose")
    content: dict[str, Any] = {
        "format": "vlod-play-report",
        "version": 1,
        "strategy": settings.strategy,
        "pixel_error": settings.pixel_error or scene.pixel_error,
        "screen": asdict(screen),
        "graphics": asdict(able),
        "settings": asdict(settings),
        "model_triangles": scene.store.manifest.model.triangles,
        "frames": rows,
        "totals": totals(rows),
    }
    if worst is not None:
        content["compare"] = _comparison(rows, worst, frames)
    return Report(content)


def totals(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Sums, means and extremes over all frames of a report."""

    def over(key: str) -> dict[str, float]:
        values = np.array([row[key] for row in rows], np.float64)
        return {
            "mean": float(values.mean()),
            "median": float(np.median(values)),
            "p95": float(np.percentile(values, 95)),
            "max": float(values.max()),
        }

    counts = ("triangles", "turned_triangles", "drawables", "draw_calls", "cache_bytes")
    times = ("strategy_ms", "cpu_ms", "wait_ms", "draw_ms", "frame_ms")
    return {
        "frames": len(rows),
        "computed_frames": sum(row["computed"] for row in rows),
        "cells_entered": 1 + sum(a["cell"] != b["cell"] for a, b in pairwise(rows)),
        "bytes_fetched": rows[-1]["bytes_fetched"],
        **{key: over(key) for key in counts + times},
    }


def save(file: Path, picture: np.ndarray) -> None:
    """Writes the colours of a picture as PNG."""
    Image.fromarray(np.ascontiguousarray(picture[..., :3])).save(file, compress_level=4)


def write_report(file: str | os.PathLike[str], report: Report) -> None:
    """Writes the report as JSON, whole or not at all. Raises PathError where that is not possible."""
    write_whole(Path(file), json.dumps(report.content, indent=1) + "\n")


def _badness(frame: Frame) -> tuple[int, float]:
    if frame.difference is None:
        return (0, 0.0)
    return (frame.difference.holes, frame.difference.differing)


def _comparison(rows: list[dict[str, Any]], worst: Frame, frames: Path | None) -> dict[str, Any]:
    images: dict[str, str] = {}
    if frames is not None and worst.full is not None:
        pictures = {
            "drawn": worst.picture,
            "full": worst.full,
            "difference": magnified(worst.picture, worst.full),
        }
        for what, picture in pictures.items():
            images[what] = f"worst_{what}.png"
            save(frames / images[what], picture)
    differences = [Difference(**row["compare"]) for row in rows]
    return {
        "with": "none",
        "passed": all(found.passed for found in differences),
        "holes": sum(found.holes for found in differences),
        "frames_with_holes": sum(found.holes > 0 for found in differences),
        "largest_differing": max(found.differing for found in differences),
        "mean_differing": sum(found.differing for found in differences) / len(differences),
        "largest_differing_grey": max(found.differing_grey for found in differences),
        "worst_frame": worst.index,
        "images": images,
    }
