"""No cracks, no holes: whatever the cut, nobody outside sees the background through a closed model.

And nothing vanishes before its whole extent is below the allowed error.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from jobs.scenes import write_scene
from player.camera.view import Boxes, View, boxes_between, boxes_in_frustum, looking
from storage.geometry_reader import Geometry
from storage.model.cut import choose_cut, cut_within, pixel_angle
from storage.model.tree import leaves
from tests.end_to_end.coverage import Shown, faults, of_triangles, shown
from tests.jobs.built_geometry import build_geometry
from tests.jobs.detail.sampling import distances
from tests.jobs.detail.shapes import Shape, sphere

#: Seen from there, outside the model.
DIRECTIONS = np.array([(1.0, 0.3, 0.4), (-0.4, 1.0, 0.5), (0.2, -0.7, -0.6), (0.1, 0.15, 1.0)])
SIZE, FIELD = 200, 40.0
ANGLE = pixel_angle(SIZE, FIELD, 1.0)

#: Allowed errors, as parts of the model's diagonal.
ERRORS = (1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2)


class Closed(NamedTuple):
    """A closed model with its hierarchy."""

    geometry: Geometry
    finest: np.ndarray  # drawables: the finest levels of all leaves
    one_solid: bool  # one closed surface: no back of it can be seen from outside
    lo: np.ndarray  # (3,) float64
    hi: np.ndarray

    @property
    def diagonal(self) -> float:
        return float(np.linalg.norm(self.hi - self.lo))

    def shown(self, drawables: np.ndarray) -> Shown:
        return shown(self.geometry, drawables, fronts_only=self.one_solid)

    def seams(self, pixels: float) -> float:
        """What may open between solids that touch, at an allowed error in pixels."""
        return 0.0 if self.one_solid else pixels

    def view(self, direction: np.ndarray, away: float) -> View:
        """Towards the middle, from `away` diagonals off."""
        off = direction / np.linalg.norm(direction)
        eye = (self.lo + self.hi) / 2 + off * away * self.diagonal
        return View(eye, looking(-off, (0.3, 0.2, 1.0)), FIELD, SIZE, SIZE, 1e-3, 10 * self.diagonal)


def slab(n: int = 90) -> Shape:
    """A piece of land: hills above, flat below, closed all around."""
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij")
    z = 0.08 * np.sin(7 * x) * np.cos(5 * y) + 0.02 * np.sin(31 * x + 3) * np.sin(27 * y)
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    above = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    rim = np.concatenate([i[:-1, 0], i[-1, :-1], i[:0:-1, -1], i[0, :0:-1]])
    following, down = np.roll(rim, -1), n * n
    around = [np.stack([rim, rim + down, following], 1), np.stack([following, rim + down, following + down], 1)]
    points = [np.stack([x, y, height], -1).reshape(-1, 3) for height in (z, np.full_like(z, -0.2))]
    return np.concatenate(points), np.concatenate([above, above[:, ::-1] + down, *around])


@pytest.fixture(scope="module", params=["ball", "slab", "city", "plant"])
def closed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Closed:
    """A model that is large enough to be cut into several objects."""
    folder = tmp_path_factory.mktemp(request.param)
    file = folder / "scene.glb"
    solids = {"ball": sphere(44, 1.0, 0.1), "slab": slab()}
    if request.param in solids:
        file = _written(folder / "solid.obj", solids[request.param])
    else:
        write_scene(request.param, file, 20_000, 0)
    geometry = build_geometry([file], folder / "store").geometry
    own = leaves(geometry.nodes)
    assert own.sum() > 20
    return Closed(
        geometry,
        np.sort(geometry.nodes["first_drawable"][own].astype(np.int64)),
        request.param in solids,
        geometry.drawables["lo"].min(axis=0).astype(np.float64),
        geometry.drawables["hi"].max(axis=0).astype(np.float64),
    )


@pytest.mark.parametrize("error", ERRORS)
def test_cuts_of_one_error_have_no_holes(closed: Closed, error: float) -> None:
    cut, allowed = _uniform(closed, error)
    finest, drawn = closed.shown(closed.finest), closed.shown(cut)
    looked_at = 0
    for direction in DIRECTIONS:
        view = closed.view(direction, 1.6)
        gap = np.maximum(np.maximum(closed.lo - view.position, view.position - closed.hi), 0)
        pixels = allowed / (ANGLE * (np.linalg.norm(gap) - allowed))
        found = faults(finest, drawn, view, pixels, seams=closed.seams(pixels))
        assert (found.holes, found.overhangs) == (0, 0)
        looked_at += found.looked_at
    assert looked_at > 1000


@pytest.mark.parametrize("away", [0.6, 1.2])
@pytest.mark.parametrize("pixels", [1, 4, 16])
def test_cuts_for_a_view_have_no_holes(closed: Closed, pixels: int, away: float) -> None:
    """As the player chooses them for each frame: another error at every distance, and only what the frustum touches."""
    geometry = closed.geometry
    boxes = boxes_between(geometry.nodes["lo"], geometry.nodes["hi"])
    finest = closed.shown(closed.finest)
    looked_at = 0
    for direction in DIRECTIONS:
        view = closed.view(direction, away)

        def wanted(nodes: np.ndarray, view: View = view) -> np.ndarray:
            return boxes_in_frustum(view, Boxes(boxes.centre[nodes], boxes.half[nodes]))

        eye = view.position
        cut = choose_cut(geometry.nodes, geometry.drawables, eye, eye, ANGLE, pixels, wanted)
        found = faults(finest, closed.shown(cut), view, pixels, seams=closed.seams(pixels))
        assert (found.holes, found.overhangs) == (0, 0)
        looked_at += found.looked_at
    assert looked_at > 1000


@pytest.mark.parametrize("error", [1e-3, 1e-2, 3e-2])
def test_nothing_vanishes_before_its_whole_extent_is_below_the_error(closed: Closed, error: float) -> None:
    """Every vertex of the model has something of the cut within the error of the drawable that stands for it."""
    cut, _ = _uniform(closed, error)
    points, triangles, _ = _mesh(closed, cut)
    vertices, _, owner = _mesh(closed, closed.finest)
    rows = closed.geometry.drawables
    node = rows["node"][cut].astype(np.int64)
    stands = np.searchsorted(node, rows["node"][owner].astype(np.int64), side="right") - 1
    # both errors are from the imported model, and the finest level lies on the grid
    allowed = rows["error"][cut][stands].astype(np.float64) + rows["error"][owner]
    assert (distances(vertices, points, triangles) <= allowed).all()


def test_a_missing_drawable_is_noticed(closed: Closed) -> None:
    cut, allowed = _uniform(closed, 1e-2)
    view = closed.view(DIRECTIONS[0], 1.6)
    rows = closed.geometry.drawables[cut]
    toward = ((rows["lo"].astype(float) + rows["hi"]) / 2) @ (view.position - (closed.lo + closed.hi) / 2)
    nearest = np.argmax(toward) if closed.one_solid else np.argmax((rows["hi"] - rows["lo"]).sum(axis=1))
    left = np.delete(cut, nearest)
    assert faults(closed.shown(closed.finest), closed.shown(left), view, 1.0).holes > 0
    vertices, _, _ = _mesh(closed, closed.finest)
    away = distances(vertices, *_mesh(closed, left)[:2])
    assert away.max() > 2 * allowed


@pytest.mark.parametrize("closed", ["ball", "slab"], indirect=True)
@pytest.mark.parametrize("error", [1e-3, 3e-3])
def test_a_border_that_gapes_is_noticed(closed: Closed, error: float) -> None:
    """A single vertex of a border, moved in one of the drawables that share it, by less than a pixel."""
    cut, _ = _uniform(closed, error)
    drawn = closed.shown(cut)
    view = closed.view(DIRECTIONS[0], 1.6)
    points, ids = np.unique(drawn.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    pairs = np.unique(np.stack([ids.reshape(-1), np.repeat(drawn.owner, 3)], axis=1), axis=0)
    shared = np.flatnonzero(np.bincount(pairs[:, 0]) > 1)
    middle = (closed.lo + closed.hi) / 2
    moved = shared[np.argmax((points[shared] - middle) @ (view.position - middle))]
    owner = pairs[pairs[:, 0] == moved][0, 1]
    triangles = drawn.triangles.copy()
    corners = (ids.reshape(-1, 3) == moved) & (drawn.owner == owner)[:, None]
    pixel = 2 * np.tan(np.radians(FIELD) / 2) / SIZE * 1.2 * closed.diagonal
    inward = triangles[corners.any(axis=1)].mean(axis=(0, 1)) - points[moved]
    triangles[corners] += (0.5 * pixel * inward / np.linalg.norm(inward)).astype(np.float32)
    torn = of_triangles(triangles, drawn.owner, drawn.one_sided)
    assert faults(closed.shown(closed.finest), torn, view, 1.0, aimed=40_000).holes > 0


def _uniform(closed: Closed, error: float) -> tuple[np.ndarray, float]:
    """The cut of an error in diagonals, and the error that it really has, in model units."""
    rows = closed.geometry.drawables
    cut = cut_within(closed.geometry.nodes, rows, error * closed.diagonal)
    return cut, max(error * closed.diagonal, float(rows["error"][cut].max()))


def _mesh(closed: Closed, drawables: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (n, 3) float64, triangles (m, 3), and the drawable (n,) of each point."""
    surfaces = closed.geometry.surfaces(drawables)
    points = surfaces.points * np.float64(closed.geometry.grid.step)
    return points, surfaces.triangles, np.repeat(drawables, surfaces.vertex_counts)


def _written(file: Path, shape: Shape) -> Path:
    points, triangles = shape
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in points]
    lines += [f"f {a} {b} {c}\n" for a, b, c in triangles + 1]
    file.write_text("".join(lines))
    return file
