"""Two pictures of a model from outside: its parts as they were imported, and its objects, each in a colour of its own.

    python tests/benchmarks/picture_objects.py MODEL FOLDER [--objects NAME] [--without WORD ...] [--from YAW PITCH]

MODEL: the name of a demo scene with its number of triangles (plant:100000), or a file below VLOD_MODELS. FOLDER gets
before.png (each connected part), after.png (each object after both partitions and the clustering), and numbers.json.
Both go the whole way through a build and the player; before has parameters under which nothing is split or joined.

--without leaves out the nodes of a demo scene whose names hold one of the words, so that one sees into halls:

    python tests/benchmarks/picture_objects.py plant:60000 pictures --objects gigawalk --without roof wall ground

Based on: W. V. Baxter et al., GigaWalk, UNC TR02-013, 2002, figure 4.
"""

from __future__ import annotations

import argparse
import json
import struct
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from jobs.options.objects import OBJECTS
from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from player.camera.path import CameraPath
from player.camera.view import looking, up_vector, yaw_pitch_direction
from player.shells.headless import Screen, render
from player.shown_model import ShownModel, shown_model
from player.walkthrough import Settings
from storage.base.progress import Silent
from storage.store import open_store
from tests.benchmarks.models import model_file

#: Nothing is split, nothing is joined.
AS_IMPORTED = {"object_triangles": 10**8, "object_size": 1e9, "object_ratio": 1e9, "cluster_volume": 0.0}

#: One cell far away: pictures need the levels only.
NO_CELLS = {"view_box": (1e6, 1e6, 1e6, 1e6 + 1, 1e6 + 1, 1e6 + 1), "max_depth": 0}

SCREEN = Screen(1400, 1100, 30.0, samples=4)
#: Pixels that are left around the model.
MARGIN = 12
#: Colours of the pictures that are written: makes them a third of the size.
PALETTE = 192


def without(file: Path, words: list[str]) -> None:
    """Takes the meshes of all nodes away whose names hold one of the words."""
    data = file.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    content = json.loads(data[20 : 20 + length])
    for node in content["nodes"]:
        if any(word in node.get("name", "") for word in words):
            node.pop("mesh", None)
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    file.write_bytes(head[:16] + b"JSON" + text + rest)


def outside(model: ShownModel, yaw: float, pitch: float) -> CameraPath:
    """One pose that looks at the model from a direction in degrees and has all of it in the picture."""
    up = model.store.manifest.model.up
    ahead = -yaw_pitch_direction(np.radians(yaw), np.radians(pitch), up)
    orientation = looking(ahead, up_vector(up))
    right = np.cross(ahead, up_vector(up))
    right /= np.linalg.norm(right)
    above = np.cross(right, ahead)
    corners = np.stack(np.meshgrid(*np.stack([model.lo, model.hi], axis=1), indexing="ij"), axis=-1).reshape(-1, 3)
    centre = (model.lo + model.hi) / 2
    half = np.tan(np.radians(SCREEN.field_of_view) / 2) * 0.96
    wide = half * SCREEN.width / SCREEN.height
    offset = corners - centre
    need = np.maximum(np.abs(offset @ right) / wide, np.abs(offset @ above) / half) - offset @ ahead
    return CameraPath(np.zeros(1), (centre - ahead * need.max())[None], orientation[None])


def cropped(picture: np.ndarray) -> np.ndarray:
    """The part of a picture (height, width, 4) where there is a surface, (h, w, 3)."""
    rows, columns = (np.flatnonzero((picture[..., 3] > 0).any(axis=axis)) for axis in (1, 0))
    top, left = max(rows[0] - MARGIN, 0), max(columns[0] - MARGIN, 0)
    return np.ascontiguousarray(picture[top : rows[-1] + MARGIN, left : columns[-1] + MARGIN, :3])


def picture(model: Path, options: dict, file: Path, yaw: float, pitch: float) -> dict[str, int]:
    """Builds the model and writes its picture; the numbers of what it shows."""
    with tempfile.TemporaryDirectory() as folder:
        executor = SerialExecutor()
        build([model], Path(folder) / "store", BuildParameters(**NO_CELLS, **options), executor, Silent())
        executor.close()
        shown = shown_model(open_store(str(Path(folder) / "store")))
        (frame,) = render(shown, outside(shown, yaw, pitch), SCREEN, Settings("none", colours="objects"))
    image = Image.fromarray(cropped(frame.picture))
    image.quantize(PALETTE, dither=Image.Dither.NONE).save(file, optimize=True)
    store = shown.store
    triangles = store.drawables["triangles"][shown.first_drawable[shown.leaves]]
    return {"objects": len(shown.leaves), "triangles": int(triangles.sum()), "nodes": len(store.nodes)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--objects", choices=list(OBJECTS), default="balanced")
    parser.add_argument("--without", nargs="*", default=[], metavar="WORD")
    parser.add_argument("--from", dest="direction", nargs=2, type=float, default=(-60.0, 40.0))
    arguments = parser.parse_args()
    if arguments.without and ":" not in arguments.model:
        parser.error("--without changes the file: it is for demo scenes, which are made anew")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        model = model_file(arguments.model, Path(folder))
        if arguments.without:
            without(model, arguments.without)
        for name, options in (("before", AS_IMPORTED), ("after", OBJECTS[arguments.objects])):
            found[name] = picture(model, options, arguments.folder / f"{name}.png", *arguments.direction)
            print(name, found[name])
    (arguments.folder / "numbers.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
