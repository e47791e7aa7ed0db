"""This hierarchy against Nexus: triangles at the same measured error, and seconds of building.

    python tests/benchmarks/compare_nexus.py --python PYTHON [--json FILE] [MODEL ...]

PYTHON: an interpreter with pymeshlab, whose filter nxs_build is Nexus' builder; make it in a virtual environment of its
own. MODEL: the name of a demo scene with its number of triangles (plant:1000000), or a path below VLOD_MODELS.

Of Nexus' cuts, those with about a half, an eighth and a thirtieth of the triangles are measured; this hierarchy's cut
for each is the one whose stored errors are below what was measured there. pymeshlab measures both.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from storage.geometry_reader import Geometry
from storage.model.cut import cut_within
from storage.model.tree import leaves
from tests.benchmarks.models import model_file
from tests.benchmarks.nexus import write_ply
from tests.jobs.built_geometry import build_geometry
from tests.jobs.tiny_model import write_rooms

MODELS = ["plant:1000000", "large_ldraw/deathstar10143.glb"]
PARTS = ("0.5", "0.125", "0.033")


def compare(name: str, folder: Path, python: str) -> dict[str, Any]:
    """One model's table."""

    def nexus(*arguments: str | Path) -> Any:
        script = Path(__file__).parent / "nexus.py"
        done = subprocess.run([python, script, *map(str, arguments)], check=True, capture_output=True, text=True)
        return json.loads(done.stdout.splitlines()[-1])

    built = build_geometry([model_file(name, folder)], folder / "store")
    seconds = {stage.name: stage.core_seconds for stage in built.run.reports}
    geometry = built.geometry
    full = folder / "full.ply"
    nodes = geometry.nodes
    triangles = _write(geometry, nodes["first_drawable"][leaves(nodes)].astype(np.int64), full)
    theirs = nexus("build", full, folder / "model.nxs")
    rows = []
    for cut in nexus("cuts", folder / "model.nxs", folder, *PARTS):
        (reached,) = nexus("distances", full, cut["file"])
        own = folder / "own.ply"
        count = _write(geometry, cut_within(nodes, geometry.drawables, reached), own)
        (measured,) = nexus("distances", full, own)
        rows.append({"nexus": cut["triangles"], "nexus_error": reached, "own": count, "own_error": measured})
    return {
        "triangles": triangles,
        "nexus_seconds": theirs["seconds"],
        "nexus_core_seconds": theirs["core_seconds"],
        "own_core_seconds": sum(seconds[stage] for stage in ("pieces", "hierarchy", "shared", "nodes")),
        "cuts": rows,
    }


def _write(geometry: Geometry, drawables: np.ndarray, path: Path) -> int:
    """Write drawables as one PLY file; how many triangles that were."""
    found = geometry.surfaces(drawables)
    write_ply(path, found.points * geometry.grid.step, found.triangles)
    return len(found.triangles)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=MODELS, metavar="MODEL")
    parser.add_argument("--python", required=True, help="an interpreter with pymeshlab")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as folder:  # compiles what is not compiled yet
        build_geometry([write_rooms(Path(folder) / "rooms.obj", 2)], Path(folder) / "store")
    for name in arguments.models:
        with tempfile.TemporaryDirectory() as folder:
            results[name] = found = compare(name, Path(folder), arguments.python)
        print(
            f"{name}: {found['triangles']:,} triangles; built in {found['own_core_seconds']:.1f} core-seconds, Nexus "
            f"{found['nexus_core_seconds']:.1f} ({found['nexus_seconds']:.1f} s)"
        )
        for row in found["cuts"]:
            print(
                f"    Nexus {row['nexus']:>10,} triangles, error {row['nexus_error']:.4g}"
                f"    own {row['own']:>10,} triangles, error {row['own_error']:.4g}",
                flush=True,
            )
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1, sort_keys=True))


if __name__ == "__main__":
    main()
