"""What lies behind glass, behind a grating and behind a door that is half open is in the vLODs, and on the pictures."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from jobs.checking.verify import verify
from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from player.camera.path import CameraPath
from player.camera.view import looking
from player.errors import GraphicsError
from player.shells.compare import passed
from player.shells.headless import Screen, render
from player.shown_model import shown_model
from player.walkthrough import Settings
from storage import open_store
from storage.model.tree import leaves
from storage.store import Store
from tests.jobs.importing.shapes import Glb

#: Part of the pixels of two pictures that may be off by more than LEVELS of 255.
ALLOWED, LEVELS = 0.005, 12

#: Where one looks from: the front room, at some distance from its walls. Behind it is z < 0.
FRONT = (-1.5, 1.2, 1.5, 1.5, 1.9, 3.0)

#: Two rooms of 6 x 3 x 4, z towards the viewer, and the wall between them with an opening 1.2 wide and 2 high. All of
#: them reach into each other: nobody looks through a seam.
WALLS = [
    ((-3.2, -0.2, -4.2), (3.2, 0, 4.2)),
    ((-3.2, 3, -4.2), (3.2, 3.2, 4.2)),
    ((-3.2, -0.1, -4.2), (-3, 3.1, 4.2)),
    ((3, -0.1, -4.2), (3.2, 3.1, 4.2)),
    ((-3.1, -0.1, -4.2), (3.1, 3.1, -4)),
    ((-3.1, -0.1, 4), (3.1, 3.1, 4.2)),
    ((-3.1, -0.1, -0.1), (-0.6, 3.1, 0.1)),
    ((0.6, -0.1, -0.1), (3.1, 3.1, 0.1)),
    ((-0.7, 2, -0.1), (0.7, 3.1, 0.1)),
]

#: What stands behind the opening.
THINGS = [((x - 0.15, 0, -3), (x + 0.15, 1.5 + 0.1 * number, -2.7)) for number, x in enumerate((-0.4, 0.0, 0.4))]


def solid(lo: tuple[float, ...], hi: tuple[float, ...], cuts: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """A closed box with some triangles on each side."""
    steps = np.linspace(0, 1, cuts + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    corner = (np.arange(cuts)[:, None] * (cuts + 1) + np.arange(cuts)).ravel()
    points, triangles = [], []
    for axis in range(3):
        for end in (0, 1):
            side = np.zeros((len(u), 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = end, u, v
            around = [corner, corner + cuts + 1, corner + cuts + 2, corner + 1]
            a, b, c, d = around if end else around[::-1]
            triangles += [np.stack(own, axis=1) + len(u) * len(points) for own in ((a, b, c), (a, c, d))]
            points.append(np.add(lo, side * np.subtract(hi, lo)))
    return np.concatenate(points), np.concatenate(triangles)


def grating() -> bytes:
    """A picture of bars with holes between them."""
    pixels = np.full((64, 64, 4), (60, 60, 60, 255), np.uint8)
    pixels[:, np.arange(64) % 8 < 5, 3] = 0
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def scene(path: Path, closing: str) -> Path:
    """Writes the two rooms; closing: what is in the opening. A `shut` one is of the same triangles, and opaque."""
    kind, _, shut = closing.partition(" ")
    glb = Glb()
    for colour in ((0.8, 0.8, 0.7, 1), (0.9, 0.2, 0.1, 1), (0.4, 0.6, 1, 0.3)):
        glb.header["materials"].append({"pbrMetallicRoughness": {"baseColorFactor": list(colour)}})
    walls = [glb.primitive(*solid(*wall), material=0) for wall in WALLS]
    glb.node(mesh=glb.mesh(*walls), name="walls")
    for lo, hi in THINGS:
        glb.node(mesh=glb.mesh(glb.primitive(*solid(lo, hi), material=1)), name="thing")
    pane = np.array([(-0.65, -0.05, 0), (0.65, -0.05, 0), (0.65, 2.05, 0), (-0.65, 2.05, 0)])
    corners = np.array([(0, 1, 2), (0, 2, 3)])
    material = glb.header["materials"][2]
    material["alphaMode"] = "OPAQUE" if shut else {"glass": "BLEND", "grating": "MASK", "door": "OPAQUE"}[kind]
    if kind == "glass":
        glb.node(mesh=glb.mesh(glb.primitive(pane, corners, material=2)), name="pane")
    elif kind == "grating":
        material["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, 1]
        glb.header["images"] = [{"bufferView": glb.view(grating()), "mimeType": "image/png"}]
        glb.header["textures"] = [{"source": 0}]
        material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
        places = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], "<f4")
        glb.node(mesh=glb.mesh(glb.primitive(pane, corners, material=2, TEXCOORD_0=places)), name="pane")
    else:  # the target is the door turned by 90 degrees about its hinge at x = -0.65: half of it stands in the way
        points, triangles = solid((-0.65, -0.05, -0.03), (0.65, 2.05, 0.03))
        turned = np.stack([-0.65 + points[:, 2], points[:, 1], -(points[:, 0] + 0.65)], axis=1)
        target = {"POSITION": glb.accessor(np.asarray(turned - points, "<f4"))}
        leaf = glb.primitive(points, triangles, material=0, targets=[target])
        glb.node(mesh=glb.mesh(leaf, weights=[0.0 if shut else 0.5]), name="door")
    return glb.write(path)


def built(folder: Path, closing: str) -> Store:
    """The store of that scene, with cells in the front room only."""
    parameters = BuildParameters(region=FRONT, max_depth=3, triangles_per_cell=100, object_triangles=64)
    build([scene(folder / "rooms.glb", closing)], folder / "store", parameters, SerialExecutor())
    return open_store(folder / "store")


def things_in(store: Store, cell: int) -> list[bool]:
    """Of each leaf among the things behind: whether it is in the vLOD of the cell."""
    nodes = store.nodes
    own = store.drawables["node"][store.vlod(cell)].astype(np.int64)
    behind = np.flatnonzero(leaves(nodes) & (nodes["lo"][:, 2] > -3.1) & (nodes["hi"][:, 2] < -2.6))
    assert len(behind) >= len(THINGS)
    return [bool(((own <= leaf) & (leaf < nodes["end"][own])).any()) for leaf in behind.tolist()]


@pytest.mark.parametrize("closing", ["glass", "grating", "door"])
def test_what_lies_behind_is_there_and_the_picture_is_that_of_the_full_model(tmp_path: Path, closing: str) -> None:
    store = built(tmp_path, closing)
    assert list(store.check()) == []
    computed = np.flatnonzero(store.cells["computed"]).tolist()
    straight = [n for n in computed if store.cells["lo"][n, 0] <= 0 <= store.cells["hi"][n, 0]]
    assert straight
    if closing == "door":  # it hides what stands on its side from some places, and nothing from all
        assert np.any([things_in(store, cell) for cell in computed], axis=0).all()
    else:
        assert np.all([things_in(store, cell) for cell in straight])
    assert store.drawables["see_through"].any() == (closing != "door")
    report = verify(str(tmp_path / "store"), samples=3000, workers=1)
    assert report.problems == []
    assert report.rays >= 3000

    spots = np.array([(-1.2, 1.6, 2.8), (-0.3, 1.6, 2.2), (0.0, 1.5, 2.9), (0.5, 1.7, 1.7), (1.3, 1.6, 2.5)])
    assert (store.cell_at(spots) >= 0).all()
    turns = [looking(np.array([0, 1.0, -2.8]) - spot, np.array([0.0, 1, 0])) for spot in spots]
    path = CameraPath(np.arange(len(spots)) / 25, spots, np.array(turns))
    settings = Settings(strategy="vlod", wait=True, prefetch=False)
    red = 0
    differences = []
    try:
        frames = list(render(shown_model(store), path, Screen(480, 270), settings, compare=True))
    except GraphicsError as error:
        pytest.skip(str(error))
    for frame in frames:
        assert frame.full is not None
        off = np.abs(frame.picture[..., :3].astype(int) - frame.full[..., :3]).max(axis=2) > LEVELS
        assert off.mean() <= ALLOWED
        assert frame.difference is not None
        differences.append(frame.difference)
        red += int((frame.picture[..., 0] > frame.picture[..., 1].astype(int) + 40).sum())
    assert passed(differences)
    assert red > 500, "the things behind are on the pictures"


@pytest.mark.parametrize("closing", ["glass shut", "grating shut", "door shut"])
def test_most_of_what_lies_behind_the_same_opening_shut_is_not_there(tmp_path: Path, closing: str) -> None:
    store = built(tmp_path, closing)
    assert not store.drawables["see_through"].any()
    computed = np.flatnonzero(store.cells["computed"]).tolist()
    assert computed
    there = np.array([things_in(store, cell) for cell in computed if store.cells["lo"][cell, 2] > 0.2])
    assert there.mean() < 0.5, "what is neither proven seen nor proven hidden is drawn, the rest is not"
    assert verify(str(tmp_path / "store"), samples=1000, workers=1).problems == []
