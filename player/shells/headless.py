"""Renders a path without a window: frames as PNG files, and a report of what each took."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from player.camera.path import CameraPath, write_whole
from player.camera.view import View
from player.renderer.context import Abilities, abilities, headless_context
from player.renderer.targets.target import Target
from player.shells.compare import ALLOWED_HOLES, Difference, Picture, difference, in_a_million, magnified, passed
from player.shown_model import ShownModel
from player.strategies import FULL
from player.walkthrough import FrameStatistics, Settings, Walkthrough
from storage.base.progress import Progress, Silent

#: How long the first frame waits for the coarse picture that is always kept where frames do not wait, in seconds.
BASE_TIME = 10.0


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
    graphics: Abilities
    picture: Picture
    statistics: FrameStatistics
    difference: Difference | None = None  # from the full model
    full: Picture | None = None  # the full model's picture
    full_unreadable: int = 0  # packs that the full model's picture lacks, because they cannot be had


@dataclass(frozen=True)
class Report:
    """What rendering a path took; `content` is what is written as JSON."""

    content: dict[str, Any]

    @property
    def passed(self) -> bool:
        """No frame had to wait for geometry in vain, and the comparison found nothing wrong, or was not asked for."""
        compared = self.content.get("compare")
        lacking = self.content["settings"]["wait"] and self.content["totals"]["lacking_frames"] > 0
        return not lacking and (compared is None or bool(compared["passed"]))


def near_and_far(model: ShownModel, position: np.ndarray, able: Abilities) -> tuple[float, float]:
    """Distances of the near and far plane in model units for an eye at `position` (3,).

    With reversed depth the near plane costs no precision. Otherwise it is as far off as 24 bits of depth need.
    """
    corner = np.maximum(np.abs(model.lo - position), np.abs(model.hi - position))
    far = 1.01 * float(np.sqrt((corner * corner).sum())) + model.extent * 1e-3
    closest = (1e-6 if able.reversed_depth else 1e-4) * model.extent
    return max(closest, 2 * model.store.grid.step), far


def render(
    model: ShownModel, path: CameraPath, screen: Screen, settings: Settings, *, compare: bool = False
) -> Iterator[Frame]:
    """Renders each pose of `path` in turn.

    compare: renders the full model (strategy FULL) as well. Raises GraphicsError where there is no OpenGL.
    """
    context = headless_context()
    able = abilities(context, force_gl33=screen.force_gl33)
    size = (screen.width, screen.height)
    target = Target(
        context, size, samples=screen.samples, reversed_depth=able.reversed_depth, see_through=model.see_through
    )
    walk = Walkthrough(model, context, able, settings)
    whole: Walkthrough | None = None
    if compare:
        plain = replace(settings, strategy=FULL, wait=True, prefetch=False, cache_bytes=1 << 62)
        whole = Walkthrough(model, context, able, plain)
    try:
        walk.packs.await_base(BASE_TIME)
        for index in range(len(path)):
            position, orientation = path.pose(index)
            near, far = near_and_far(model, position, able)
            view = View(position, orientation, screen.field_of_view, screen.width, screen.height, near, far)
            statistics = walk.frame(view, target)
            frame = Frame(index, able, target.read(), statistics)
            if whole is not None:
                lacking = whole.frame(view, target).unreadable
                full = target.read()
                found = difference(frame.picture, full)
                frame = replace(frame, difference=found, full=full, full_unreadable=lacking)
            yield frame
    finally:
        walk.close()
        if whole is not None:
            whole.close()
        target.release()
        context.release()


def play(
    model: ShownModel,
    path: CameraPath,
    screen: Screen,
    settings: Settings,
    *,
    frames: Path | None = None,
    compare: bool = False,
    progress: Progress | None = None,
) -> Report:
    """Renders `path`, writes the pictures into the directory `frames`, and returns the report.

    compare: also compares each frame with the full model; the worst frame's pair and the difference go to `frames` too.
    """
    progress = progress or Silent()
    keeping = ReportMaker(model, path, screen, settings, frames)
    progress.start("rendering")
    for frame in render(model, path, screen, settings, compare=compare):
        keeping.add(frame)
        progress.update(frame.index + 1, len(path))
    progress.finish("1 frame" if len(path) == 1 else f"{len(path)} frames")
    return keeping.report()


class ReportMaker:
    """Keeps what the frames of a path took, and writes their pictures."""

    def __init__(
        self, model: ShownModel, path: CameraPath, screen: Screen, settings: Settings, frames: Path | None = None
    ) -> None:
        """frames: directory of the pictures; None: they are not written."""
        self._model = model
        self._path = path
        self._frames = frames
        self._content: dict[str, Any] = {
            "format": "vlod-play-report",
            "version": 1,
            "strategy": settings.strategy,
            "pixel_error": settings.pixel_error or model.pixel_error,
            "screen": asdict(screen),
            "graphics": None,
            "settings": asdict(settings),
            "model_triangles": model.store.manifest.model.triangles,
        }
        self._rows: list[dict[str, Any]] = []
        self._worst: Frame | None = None
        if frames is not None:
            frames.mkdir(parents=True, exist_ok=True)

    def add(self, frame: Frame) -> None:
        """Takes the next frame."""
        name = f"frame_{frame.index:04d}.png"
        row: dict[str, Any] = {
            "index": frame.index,
            "time": float(self._path.times[frame.index]),
            "position": self._path.positions[frame.index].tolist(),
            "orientation": self._path.orientations[frame.index].tolist(),
            "image": name if self._frames is not None else None,
            **asdict(frame.statistics),
        }
        if self._frames is not None:
            save(self._frames / name, frame.picture)
        if frame.difference is not None:
            row["compare"] = asdict(frame.difference)
            row["full_unreadable"] = frame.full_unreadable
            if self._worst is None or _badness(frame) > _badness(self._worst):
                self._worst = frame
        self._rows.append(row)
        self._content["graphics"] = asdict(frame.graphics)

    def report(self) -> Report:
        """The report of the frames so far, of which there must be one."""
        content = {**self._content, "frames": self._rows, "totals": totals(self._rows)}
        if self._worst is not None:
            content["compare"] = _comparison(self._rows, self._worst, self._frames)
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
        "approximate_frames": sum(row["approximate"] for row in rows),
        "lacking_frames": sum(row["unreadable"] > 0 for row in rows),
        "absent_frames": sum(row["absent"] > 0 for row in rows),
        "most_absent": max(row["absent"] for row in rows),
        "troubles": list(dict.fromkeys(row["trouble"] for row in rows if row["trouble"])),
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
    holes, covered = sum(found.holes for found in differences), sum(found.covered for found in differences)
    return {
        "with": FULL,
        "passed": passed(differences) and not any(row["full_unreadable"] for row in rows),
        "incomplete_full_frames": sum(row["full_unreadable"] > 0 for row in rows),
        "holes": holes,
        "covered_pixels": covered,
        "holes_in_a_million": in_a_million(holes, covered),
        "allowed_in_a_million": 1e6 * ALLOWED_HOLES,
        "frames_with_holes": sum(found.holes > 0 for found in differences),
        "largest_differing": max(found.differing for found in differences),
        "mean_differing": sum(found.differing for found in differences) / len(differences),
        "largest_differing_grey": max(found.differing_grey for found in differences),
        "worst_frame": worst.index,
        "images": images,
    }
