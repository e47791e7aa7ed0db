"""What levels lose of thin things: pixels with surface in the full model's picture and only background around here.

    python tests/benchmarks/measure_thin.py [--frames 120] [--lines 540 1080] [--tour KIND] [--depth D] [--turned]
        [--work DIR] [--crops DIR] [--json FILE] [MODEL ...]

MODEL: the name of a demo scene with its number of triangles (services:100000), or a path below VLOD_MODELS. Every model
is built with the default options and drawn along its automatic tour with strategy frustum, and, with --depth, with
strategy vlod in an octree of cells of that depth. Holes are counted as `vlod play --compare none` does; wide ones are
those where the full picture of four times as many lines and columns covers more than a quarter of the pixel: what was
lost there is wider than a quarter of a pixel. Models and tours stay in the work directory, so that another version
of the code can be measured along the same way: run this file with its folder in PYTHONPATH. --crops: pictures of the
worst holes, full model, levels, and holes in red side by side, six times as large.

--turned: also the full model against itself, the eye turned by a tenth of a pixel to any side. What is thinner than a
pixel is drawn where it happens to meet a pixel's middle: so many holes come from a picture that lacks nothing.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from player.camera.path import CameraPath, read_path, write_path
from player.camera.view import quaternion_of, rotation_matrix
from player.shells.compare import holes, in_a_million
from player.shells.headless import Frame, Screen, render
from player.shown_model import ShownModel, shown_model
from player.strategies import FULL
from player.tour import TOURS
from player.tour.survey import survey
from player.tour.tour import make_tour
from player.walkthrough import Settings
from storage import open_store
from tests.benchmarks.models import model_file

MODELS = [
    "plant:300000",
    "services:1000000",
    "bim_schependomlaan/schependomlaan_subcontractors.glb",
    "mid_hospital/hospital_three_floors.glb",
    "cad_atlas/atlas_detector.glb",
]
#: Where a part of a pixel counts as covered, it is looked at in so many lines and columns.
FINER = 4
#: Holes where more than this part of the pixel is covered are wide.
WIDE = 0.25
#: Where the cell is that a store needs when only its levels are looked at.
FAR = 1e6
#: Half of a crop's edge, in pixels, and how much larger it is shown.
CROP, LARGER = 24, 6
CROPS = 6
#: The eye is turned by this part of a pixel in the middle of the picture.
TURN = 0.1


@dataclass(frozen=True)
class Finding:
    """One model, strategy and size of picture."""

    model: str
    strategy: str
    lines: int
    frames: int
    triangles: float  # a frame, mean
    holes: int
    wide: int  # of these
    frames_with_holes: int
    holes_in_a_million: float  # of the pixels that the full model covers
    wide_in_a_million: float


def built(file: Path, folder: Path, depth: int | None) -> ShownModel:
    """The model of a store that is built in `folder`; without a depth with a single cell, far off, to save time."""
    parameters = BuildParameters(max_depth=depth or 0)
    if depth is None:
        parameters = replace(parameters, view_box=(FAR, FAR, FAR, FAR + 1.0, FAR + 1.0, FAR + 1.0))
    build([file], folder, parameters, SerialExecutor())
    return shown_model(open_store(str(folder)))


def tour(model: ShownModel, file: Path, frames: int, kind: str | None) -> CameraPath:
    """The model's automatic tour of a kind, or the one that `file` holds since it was first asked for."""
    if not file.exists():
        write_path(file, make_tour(model, survey(model), frames=frames, seed=0, kind=kind))
    return read_path(file)


def missing(frame: Frame) -> NDArray[np.bool_]:
    """The holes (height, width) of a frame."""
    assert frame.full is not None
    return holes(frame.picture, frame.full)


def covered(model: ShownModel, path: CameraPath, index: int, screen: Screen) -> NDArray[np.float64]:
    """The part of each pixel (height, width) that the full model covers at a pose."""
    finer = replace(screen, width=FINER * screen.width, height=FINER * screen.height)
    pose = CameraPath(*(each[index : index + 1] for each in (path.times, path.positions, path.orientations)))
    (frame,) = render(model, pose, finer, Settings(strategy=FULL, prefetch=False, cache_bytes=1 << 40))
    filled = frame.picture[..., 3] > 0
    return filled.reshape(screen.height, FINER, screen.width, FINER).mean(axis=(1, 3))


def cropped(frame: Frame, lost: NDArray[np.bool_]) -> Image.Image:
    """Where most is lost: the full model, what was drawn, and that with holes in red."""
    assert frame.full is not None
    down, across = np.nonzero(lost)
    near = (np.abs(down[:, None] - down[None, :2000]) < CROP) & (np.abs(across[:, None] - across[None, :2000]) < CROP)
    most = int(near.sum(axis=1).argmax())
    top = int(np.clip(down[most] - CROP, 0, max(0, lost.shape[0] - 2 * CROP)))
    left = int(np.clip(across[most] - CROP, 0, max(0, lost.shape[1] - 2 * CROP)))
    part = np.s_[top : top + 2 * CROP, left : left + 2 * CROP]
    red = frame.picture[..., :3].copy()
    red[lost] = (255, 0, 0)
    row = np.concatenate([frame.full[..., :3][part], frame.picture[..., :3][part], red[part]], axis=1)
    return Image.fromarray(np.kron(row, np.ones((LARGER, LARGER, 1), np.uint8)))


def measure(name: str, model: ShownModel, path: CameraPath, strategy: str, lines: int, crops: Path | None) -> Finding:
    """Draws a tour, and counts holes."""
    screen = Screen(width=lines * 16 // 9, height=lines)
    settings = Settings(strategy=strategy, prefetch=False, cache_bytes=1 << 40)
    triangles, found, seen, wide = [], [], 0, 0
    losing: dict[int, NDArray[np.bool_]] = {}
    worst: list[tuple[int, int, Image.Image]] = []
    for frame in render(model, path, screen, settings, compare=True):
        lost = missing(frame)
        triangles.append(frame.statistics.triangles)
        found.append(int(lost.sum()))
        assert frame.difference is not None
        seen += frame.difference.covered
        if found[-1]:
            losing[frame.index] = lost
            worst = sorted([*worst, (-found[-1], frame.index, cropped(frame, lost))], key=lambda w: w[:2])[:CROPS]
    for index, lost in losing.items():  # in contexts of their own, once the other one is closed
        wide += int((covered(model, path, index, screen)[lost] > WIDE).sum())
    if crops is not None:
        crops.mkdir(parents=True, exist_ok=True)
        for _, index, picture in worst:
            picture.save(crops / f"{_plain(name)}_{strategy}_{lines}_{index:04d}.png")
    return _finding(name, strategy, lines, triangles, found, wide, seen)


def turned(path: CameraPath, screen: Screen) -> CameraPath:
    """The path with the eye turned at each pose, by TURN pixels, to one side or another."""
    angle = TURN * 2.0 * np.tan(np.radians(screen.field_of_view) / 2) / screen.height
    rng = np.random.default_rng(0)
    orientations = []
    for orientation in path.orientations:
        side = rng.uniform(0.0, 2.0 * np.pi)
        x, y = np.cos(side) * np.sin(angle / 2), np.sin(side) * np.sin(angle / 2)
        little = rotation_matrix((x, y, 0.0, np.cos(angle / 2)))
        orientations.append(quaternion_of(rotation_matrix(orientation) @ little))
    return CameraPath(path.times, path.positions, np.array(orientations))


def measure_turned(name: str, model: ShownModel, path: CameraPath, lines: int) -> Finding:
    """Draws the full model along a tour and along the turned one, and counts the holes of the one in the other."""
    screen = Screen(width=lines * 16 // 9, height=lines)
    settings = Settings(strategy=FULL, prefetch=False, cache_bytes=1 << 40)
    plain = [np.packbits(frame.picture[..., 3] > 0) for frame in render(model, path, screen, settings)]
    triangles, losing, found, seen, wide = [], {}, [], 0, 0
    for frame in render(model, turned(path, screen), screen, settings):
        full = np.zeros_like(frame.picture)
        full[..., 3] = 255 * np.unpackbits(plain[frame.index], count=full[..., 3].size).reshape(full.shape[:2])
        losing[frame.index] = holes(frame.picture, full)
        triangles.append(frame.statistics.triangles)
        found.append(int(losing[frame.index].sum()))
        seen += int((full[..., 3] > 0).sum())
    for index, lost in losing.items():
        if lost.any():
            wide += int((covered(model, path, index, screen)[lost] > WIDE).sum())
    return _finding(name, "none, turned", lines, triangles, found, wide, seen)


def _finding(
    name: str, strategy: str, lines: int, triangles: list[int], found: list[int], wide: int, seen: int
) -> Finding:
    """found: holes of each frame; seen: pixels that the full model covers in all of them."""
    return Finding(
        model=name,
        strategy=strategy,
        lines=lines,
        frames=len(found),
        triangles=float(np.mean(triangles)),
        holes=sum(found),
        wide=wide,
        frames_with_holes=sum(count > 0 for count in found),
        holes_in_a_million=in_a_million(sum(found), seen),
        wide_in_a_million=in_a_million(wide, seen),
    )


def _plain(name: str) -> str:
    return Path(name).stem.replace(":", "_")


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=MODELS, metavar="MODEL")
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--lines", type=int, nargs="+", default=[540, 1080])
    parser.add_argument("--tour", choices=[offer.name for offer in TOURS], help="default: the automatic one's")
    parser.add_argument("--depth", type=int)
    parser.add_argument("--turned", action="store_true")
    parser.add_argument("--work", type=Path, default=Path("build/thin"))
    parser.add_argument("--crops", type=Path)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows: list[dict[str, Any]] = []
    print("| model | strategy, lines | triangles a frame | holes (wide) | in a million pixels | frames with holes |")
    print("|---|---|---|---|---|---|")
    for name in arguments.models:
        folder = arguments.work / _plain(name)
        folder.mkdir(parents=True, exist_ok=True)
        made = folder / f"{name.partition(':')[0]}.glb"
        file = made if made.exists() else model_file(name, folder)
        with tempfile.TemporaryDirectory() as store:
            model = built(file, Path(store), arguments.depth)
            way = folder / f"tour_{arguments.tour}_{arguments.frames}.json"
            path = tour(model, way, arguments.frames, arguments.tour)
            for lines in arguments.lines:
                strategies = ("frustum",) if arguments.depth is None else ("frustum", "vlod")
                findings = [measure(name, model, path, strategy, lines, arguments.crops) for strategy in strategies]
                if arguments.turned:
                    findings.append(measure_turned(name, model, path, lines))
                for found in findings:
                    rows.append(asdict(found))
                    print(
                        f"| {name} | {found.strategy}, {lines} | {found.triangles:,.0f} | {found.holes} ({found.wide}) "
                        f"| {found.holes_in_a_million:.2f} ({found.wide_in_a_million:.2f}) | "
                        f"{found.frames_with_holes} of {found.frames} |",
                        flush=True,
                    )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
