"""How fast triangles are drawn into the images around a cell, by themselves.

    python tests/benchmarks/measure_rasteriser.py [MODEL] [--pixels 10] [--resolution 80] [--rounds 7] [--json OUT.json]

The triangles of a MODEL (see `models`; the plant with a million by default), each scaled so that the box of its image
is PIXELS wide and high, somewhere on a face, at depths of its own. Drawn in one call: transformed, clipped, set up, and
the depths and the coverage of their pixels written. The best of some rounds counts.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np

from jobs.visibility.images.cube_faces import Face, Pixels
from jobs.visibility.images.raster import LANES, draw_triangles
from tests.benchmarks.measure_visibility import Case

FACE = 4
FARTHEST = 1e6


def placed(triangles: np.ndarray, pixels: float, resolution: int) -> np.ndarray:
    """Corners (3 n, 3) float64, in cell coordinates, of triangles (n, 3, 3) moved into the image on a face."""
    rng = np.random.default_rng(0)
    normals = np.abs(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]))
    triangles, normals = (values[normals.max(axis=1) > 0] for values in (triangles, normals))
    n = len(triangles)
    across = np.argsort(normals, axis=1)[:, :2]  # the two axes along which the triangle is seen best
    flat = np.take_along_axis(triangles, across[:, None, :], axis=2).astype(np.float64)
    flat -= flat.min(axis=1, keepdims=True)
    flat *= pixels / flat.max(axis=1, keepdims=True)
    flat += rng.random((n, 1, 2)) * (resolution - pixels)
    depth = rng.uniform(5, 15, (n, 3))
    around = (flat / (0.5 * resolution) - 1) * depth[:, :, None]
    return np.concatenate([around, depth[:, :, None]], axis=2).reshape(-1, 3)


def measure(triangles: np.ndarray, pixels: float, resolution: int, rounds: int) -> dict[str, float]:
    """Triangles a second: as cores, of which it counts what they cover, and as the others of a set."""
    q = placed(triangles, pixels, resolution)
    corners = np.arange(len(q), dtype=np.int32).reshape(-1, 3)
    chosen = np.arange(len(corners), dtype=np.int32)
    face, pixels_drawn = Face(FACE, resolution, FARTHEST), Pixels(0, resolution - 1, 0, resolution - 1)
    found = {"triangles": float(len(corners)), "pixels": float(pixels)}
    for name, covers in (("core", True), ("others", False)):
        best = np.inf
        for _ in range(rounds):
            inverse = np.full((resolution, resolution + LANES), np.inf, np.float32)
            limit = np.zeros_like(inverse)
            began = time.thread_time()
            draw_triangles(q, corners, chosen, face, pixels_drawn, np.empty((4, 2)), covers, inverse, limit)
            best = min(best, time.thread_time() - began)
        found[f"{name}_per_second"] = len(corners) / best
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", nargs="?", default="plant:1000000")
    parser.add_argument("--pixels", type=float, default=10)
    parser.add_argument("--resolution", type=int, default=80)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        triangles = Case(arguments.model, Path(folder)).triangles
    found = measure(triangles, arguments.pixels, arguments.resolution, arguments.rounds)
    print(
        f"{arguments.model}: {found['triangles']:,.0f} triangles of {arguments.pixels:g} x {arguments.pixels:g} "
        f"pixels; millions a second on one core: {found['core_per_second'] / 1e6:.2f} of a core, "
        f"{found['others_per_second'] / 1e6:.2f} of the others of a set"
    )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
