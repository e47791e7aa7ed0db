"""What the hierarchy of models looks like, and what each step of building it takes, on one core.

    python tests/benchmarks/measure_hierarchy.py [--json FILE] [--plot FILE.png] [MODEL ...]

MODEL: the name of a demo scene with its number of triangles (plant:1000000), or a path below VLOD_MODELS. Everything is
built in this process, one task after the other; seconds are the process's own. Bytes are those of the geometry shards.
--plot: seconds and bytes over triangles, as a picture, of the demo scene that was given with most sizes.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from jobs.stages import hierarchy
from storage.model.cut import coarsest_triangles
from storage.model.tree import heights, leaves
from tests.benchmarks.models import model_file
from tests.jobs.built_geometry import build_geometry
from tests.jobs.tiny_model import write_rooms

MODELS = [
    "mid_hospital/hospital_three_floors.glb",
    "large_ldraw/deathstar10143.glb",
    "large_ldraw/townhall10224.glb",
    "cad_atlas/atlas_detector.glb",
    "plant:1000000",
    "plant:10000000",
    "city:1000000",
    "city:3000000",
    "city:10000000",
    "city:30000000",
]
#: What makes the hierarchy, once triangles are in memory.
WORK = ("pieces", "hierarchy", "shared", "nodes")


def measure(name: str, folder: Path) -> dict[str, Any]:
    """Builds one model's hierarchy."""
    built = build_geometry([model_file(name, folder)], folder / "store")
    geometry = built.geometry
    records = [
        json.loads(path.read_text()) for path in (folder / "store/work" / hierarchy.STAGE.name).glob("*/record.json")
    ]
    counts = records[0]["record"]["counts"]
    own = leaves(geometry.nodes)
    finest = geometry.drawables["triangles"][geometry.nodes["first_drawable"][own]]
    stored = int(geometry.geometry["triangles"].sum(dtype=np.int64))
    size_on_disk = sum(path.stat().st_size for path in (folder / "store/shards").iterdir())
    steps = {stage.name: stage for stage in built.run.reports}
    unique = int(built.model.meshes["triangles"].sum(dtype=np.int64))
    working = sum(steps[step].core_seconds for step in WORK)
    return {
        "triangles": int(finest.sum(dtype=np.int64)),
        "unique_triangles": unique,
        **{key: counts[key] for key in ("parts", "pieces", "clusters", "objects", "shared", "nodes")},
        "tree_height": int(heights(geometry.nodes).max()),
        "drawables": len(geometry.drawables),
        "root_triangles": coarsest_triangles(geometry.nodes, geometry.drawables),
        "stored_triangles": stored,
        "bytes": size_on_disk,
        "bytes_per_unique_triangle": size_on_disk / unique,
        "bytes_per_stored_triangle": size_on_disk / stored,
        "seconds": {step: stage.core_seconds for step, stage in steps.items()},
        "peak_mib": {step: stage.peak_task_memory >> 20 for step, stage in steps.items()},
        "triangles_per_second": int(finest.sum(dtype=np.int64)) / working,
        "unique_triangles_per_second": unique / working,
    }


def draw(results: dict[str, dict[str, Any]], file: Path) -> None:
    """Seconds and bytes over triangles, of the demo scene with most sizes."""
    width, height, left, below = 640, 400, 60, 40
    kinds = [name.partition(":")[0] for name in results if ":" in name]
    kind = max(kinds, key=kinds.count)
    scenes = sorted((found["triangles"], found) for name, found in results.items() if name.startswith(f"{kind}:"))
    curves = {
        f"{kind}: core-seconds, import and all steps": [sum(found["seconds"].values()) for _, found in scenes],
        "megabytes stored": [found["bytes"] / 1e6 for _, found in scenes],
    }
    right = max(size for size, _ in scenes)
    image = Image.new("RGB", (width, height), "white")
    pen = ImageDraw.Draw(image)
    pen.line([(left, 10), (left, height - below), (width - 10, height - below)], fill="black")
    for n, (label, values) in enumerate(curves.items()):
        colour = ("#0b6e6e", "#c0562b")[n]
        top = max(values)
        places = [
            (left + size / right * (width - left - 70), height - below - value / top * (height - below - 50))
            for (size, _), value in zip(scenes, values, strict=True)
        ]
        pen.line([(left, height - below), *places], fill=colour, width=2)
        for (x, y), value in zip(places, values, strict=True):
            pen.ellipse([x - 4, y - 4, x + 4, y + 4], fill=colour)
            # the curves nearly cover each other: one's numbers stand below it, the other's above
            pen.text((x - 6, y - 20) if n else (x + 8, y - 2), f"{value:,.0f}", fill=colour)
        pen.text((left + 12, 12 + 16 * n), label, fill=colour)
    for size, _ in scenes:
        x = left + size / right * (width - left - 70)
        pen.line([(x, height - below), (x, height - below + 4)], fill="black")
        pen.text((x - 8, height - below + 8), f"{size / 1e6:.0f} M", fill="black")
    pen.text((width - 90, height - 18), "triangles", fill="black")
    image.save(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=MODELS, metavar="MODEL")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path)
    arguments = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as folder:  # compiles what is not compiled yet
        build_geometry([write_rooms(Path(folder) / "rooms.obj", 2)], Path(folder) / "store")
    for name in arguments.models:
        with tempfile.TemporaryDirectory() as folder:
            results[name] = found = measure(name, Path(folder))
        print(name)
        for key, value in found.items():
            if isinstance(value, dict):
                text = ", ".join(f"{step} {amount:,.4g}" for step, amount in value.items())
            else:
                text = f"{value:,.6g}"
            print(f"    {key:28} {text}", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1, sort_keys=True))
    if arguments.plot:
        draw(results, arguments.plot)


if __name__ == "__main__":
    main()
