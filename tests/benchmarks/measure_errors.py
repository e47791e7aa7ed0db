"""Stored against measured errors of all drawables of models: at least 200,000 points a model, in both directions.

    python tests/benchmarks/measure_errors.py [--points N] [--json FILE] [MODEL ...]

MODEL: one of those below, a path below VLOD_MODELS, or the name of a demo scene with its number of triangles
(plant:1000000). Exits with 1 if any measured distance is above the stored error.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from storage.model.tree import leaves
from tests.benchmarks.models import model_file
from tests.jobs.built_geometry import Originals, build_geometry, mesh_of
from tests.jobs.detail.sampling import distances, measured, sample

MODELS = {
    "mid_conference": "mid_conference/conference.obj",
    "mid_hospital": "mid_hospital/hospital_three_floors.glb",
    "small_willowgarage": "small_willowgarage/willowgarage_visual.dae",
    "mid_lost_empire": "mid_lost_empire/lost_empire.obj",
    "cad_sportscar": "cad_sportscar/sportsCar.obj",
}
SCENES = ("plant:300000", "offices:300000", "city:300000")
#: Errors below this many grid steps are rounding, not simplification: left out of the ratios.
ROUNDING_STEPS = 8
#: How far the stored error is above the true one takes many points to see: on some drawables of each kind only.
DENSE_DRAWABLES = 60
DENSE_POINTS = 2_000


def measure(name: str, points: int, seed: int = 1) -> dict[str, Any]:
    """Build a model's hierarchy and sample all its drawables with about `points` points in each direction."""
    with tempfile.TemporaryDirectory() as folder:
        file = model_file(MODELS.get(name, name), Path(folder))
        built = build_geometry([file], Path(folder) / "store")
        geometry, originals = built.geometry, Originals(built)
        rows = geometry.drawables
        inner = ~leaves(geometry.nodes)[rows["node"]]
        total = int(rows["triangles"].sum(dtype=np.int64))
        rng = np.random.default_rng(seed)
        taken, above, worst = 0, 0, 0.0
        for drawable, row in enumerate(rows):
            surface = originals.of(int(row["node"]))
            count = 8 + points * int(row["triangles"]) // total
            mesh = mesh_of(geometry, drawable)
            there, back = sample(*surface, count, rng), sample(*mesh, count, rng)
            found = float(max(distances(there, *mesh).max(), distances(back, *surface).max()))
            taken += len(there)
            rounding = 1e-12 * float(np.abs(surface[0]).max())
            above += int(found > row["error"] + rounding)
            worst = max(worst, found / float(row["error"]) if row["error"] > rounding else 0.0)
        ratios = {}
        for kind, which in (("leaves", ~inner & (rows["level"] > 0)), ("inner", inner)):
            simplified = np.flatnonzero(which & (rows["error"] > ROUNDING_STEPS * geometry.grid.step))
            ratios[kind] = [
                float(rows["error"][drawable])
                / measured(originals.of(int(rows["node"][drawable])), mesh_of(geometry, drawable), DENSE_POINTS, rng)
                for drawable in simplified[:: max(1, len(simplified) // DENSE_DRAWABLES)].tolist()
            ] or [1.0]
    both = ratios["leaves"] + ratios["inner"]
    return {
        "nodes": len(geometry.nodes),
        "drawables": len(rows),
        "points_each_way": taken,
        "measured_above_stored": above,
        "largest_measured_over_stored": worst,
        "stored_over_measured_median": float(np.median(both)),
        "in_leaves": float(np.median(ratios["leaves"])),
        "in_inner_nodes": float(np.median(ratios["inner"])),
        "stored_over_measured_90_percent": float(np.quantile(both, 0.9)),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=[*MODELS, *SCENES], metavar="MODEL")
    parser.add_argument("--points", type=int, default=210_000, help="in each direction, for each model")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    results = {}
    columns = ["nodes", "drawables", "points_each_way", "measured_above_stored", "largest_measured_over_stored"]
    columns += ["stored_over_measured_median", "in_leaves", "in_inner_nodes", "stored_over_measured_90_percent"]
    print(" " * 40 + " ".join(f"{column:>31}" for column in columns))
    for name in arguments.models:
        results[name] = r = measure(name, arguments.points)
        print(f"{name:40}" + " ".join(f"{r[column]:31.6g}" for column in columns), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1, sort_keys=True))
    return int(any(r["measured_above_stored"] for r in results.values()))


if __name__ == "__main__":
    sys.exit(main())
