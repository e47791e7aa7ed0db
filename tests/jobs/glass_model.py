"""A model of which much can be seen through: panes in frames, a dome, and a ball that is half of glass."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.jobs.detail.shapes import Shape, box, joined, sphere, torus

VERTEX = np.dtype([("position", "<f4", (3,)), ("colour", "u1", (4,))])
FACE = np.dtype([("count", "u1"), ("corners", "<u4", (3,))])


def glass_shapes() -> list[tuple[Shape, np.ndarray]]:
    """Meshes and the colours (n, 4) uint8 of their vertices; some triangles have opaque corners and others."""
    ground, ring, ball, dome = (
        box((-4, -4, -0.2), (4, 4, 0)),
        torus(40, 20),
        sphere(10, 0.8),
        sphere(12, 1.5, bumps=0.02),
    )
    shapes = [
        (ground, painted(ground, (90, 110, 90, 255))),
        (moved(ring, (-2, -2, 1)), painted(ring, (200, 60, 40, 255))),
        (
            moved(ball, (2, -2, 1)),
            np.where(ball[0][:, 2:] < 0, painted(ball, (60, 60, 70, 255)), painted(ball, (60, 90, 200, 90))),
        ),
        (moved(dome, (0, 0, 0.5)), painted(dome, (180, 220, 240, 0))),
    ]
    shapes[-1][1][:, 3] = np.rint(110 + 60 * dome[0][:, 2] / 1.6)
    for number in range(40):
        x, y = -3.5 + 0.7 * (number % 10), 2 + 0.5 * (number // 10)
        frame, pane = box((x, y, 0.2), (x + 0.1, y + 0.1, 1)), box((x + 0.1, y, 0.2), (x + 0.6, y + 0.02, 1))
        shapes += [(frame, painted(frame, (120, 80, 40, 255))), (pane, painted(pane, (200, 230, 230, 60 + number)))]
    return shapes


def painted(shape: Shape, colour: tuple[int, int, int, int]) -> np.ndarray:
    """One colour for all vertices of a shape."""
    return np.tile(np.array(colour, np.uint8), (len(shape[0]), 1))


def moved(shape: Shape, by: tuple[float, float, float]) -> Shape:
    """A shape elsewhere."""
    return shape[0] + np.array(by), shape[1]


def write_glass(path: Path, *, opaque: bool = True) -> Path:
    """Writes these shapes as one mesh of a PLY; without `opaque`, only those that can be seen through everywhere."""
    shapes = [(shape, colours) for shape, colours in glass_shapes() if opaque or (colours[:, 3] < 255).all()]
    points, triangles = joined([shape for shape, _ in shapes])
    vertices, faces = np.zeros(len(points), VERTEX), np.zeros(len(triangles), FACE)
    vertices["position"], vertices["colour"] = points, np.concatenate([colours for _, colours in shapes])
    faces["count"], faces["corners"] = 3, triangles
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    channels = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{axes}{channels}"
    head += f"element face {len(triangles)}\nproperty list uchar uint vertex_indices\nend_header\n"
    path.write_bytes(head.encode() + vertices.tobytes() + faces.tobytes())
    return path
