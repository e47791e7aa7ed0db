"""What the hierarchy of models looks like, and what each step of building it takes, on one core.

    python tests/benchmarks/measure_hierarchy.py [--json FILE] [MODEL ...]

MODEL: the name of a demo scene with its number of triangles (plant:1000000), or a path below VLOD_MODELS. Everything is
built in this process, one task after the other; seconds are the process's own. Bytes are those of the geometry shards.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from jobs.scenes import write_scene
from jobs.stages import HIERARCHY
from storage.tree import leaves
from tests.jobs.built_geometry import build_geometry
from tests.jobs.tiny_model import write_rooms

MODELS = [
    "plant:1000000",
    "city:1000000",
    "mid_hospital/hospital_three_floors.glb",
    "large_ldraw/deathstar10143.glb",
    "large_ldraw/townhall10224.glb",
]


def measure(name: str, folder: Path) -> dict[str, Any]:
    """Builds one model's hierarchy."""
    scene, _, size = name.partition(":")
    if size:
        file = folder / f"{scene}.glb"
        write_scene(scene, file, int(size), 0)
    else:
        file = Path(os.environ["VLOD_MODELS"]) / name
    built = build_geometry([file], folder / "store")
    geometry = built.geometry
    records = [json.loads(path.read_text()) for path in (folder / "store/work" / HIERARCHY.name).glob("*/record.json")]
    counts = records[0]["record"]["counts"]
    own = leaves(geometry.nodes)
    finest = geometry.drawables["triangles"][geometry.nodes["first_drawable"][own]]
    stored = int(geometry.geometry["triangles"].sum(dtype=np.int64))
    size_on_disk = sum(path.stat().st_size for path in (folder / "store/shards").iterdir())
    steps = {stage.name: stage for stage in built.run.reports}
    working = sum(steps[step].core_seconds for step in ("pieces", "hierarchy", "shared", "nodes"))
    return {
        "triangles": int(finest.sum(dtype=np.int64)),
        "unique_triangles": int(built.model.meshes["triangles"].sum(dtype=np.int64)),
        **{key: counts[key] for key in ("parts", "pieces", "clusters", "objects", "shared", "nodes")},
        "drawables": len(geometry.drawables),
        "root_triangles": int(geometry.drawables["triangles"][int(geometry.nodes["levels"][0]) - 1]),
        "stored_triangles": stored,
        "bytes": size_on_disk,
        "bytes_per_triangle": size_on_disk / int(built.model.meshes["triangles"].sum(dtype=np.int64)),
        "seconds": {step: stage.core_seconds for step, stage in steps.items()},
        "peak_mib": {step: stage.peak_task_memory >> 20 for step, stage in steps.items()},
        "unique_triangles_per_second": int(built.model.meshes["triangles"].sum(dtype=np.int64)) / working,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=MODELS, metavar="MODEL")
    parser.add_argument("--json", type=Path)
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


if __name__ == "__main__":
    main()
