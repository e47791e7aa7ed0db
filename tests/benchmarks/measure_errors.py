"""Stored against measured errors of all levels of models: at least 100,000 points a model, in both directions.

    python tests/benchmarks/measure_errors.py [--points N] [--json FILE] [MODEL ...]

Models are real ones, found by the environment variable VLOD_MODELS, and demo scenes. Exits with 1 if any measured
distance is above the stored error.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from jobs.detail.pieces import DetailOptions, build_pieces
from jobs.importing.model import import_model, open_model
from jobs.scenes import write_scene
from tests.jobs.detail.sampling import distances, measured, sample
from tests.jobs.detail.shapes import level_mesh, original

MODELS = {
    "mid_conference": "mid_conference/conference.obj",
    "mid_hospital": "mid_hospital/hospital_three_floors.glb",
    "small_willowgarage": "small_willowgarage/willowgarage_visual.dae",
    "mid_lost_empire": "mid_lost_empire/lost_empire.obj",
    "cad_sportscar": "cad_sportscar/sportsCar.obj",
}
#: Demo scenes, of this many triangles each.
SCENES = ("plant", "offices", "city")
SCENE_TRIANGLES = 300_000
#: Errors below this many grid steps are rounding, not simplification: left out of the ratios.
ROUNDING_STEPS = 8
#: How far the stored error is above the true one takes many points a level to see: on some pieces only.
DENSE_PIECES = 24
DENSE_POINTS = 2_000


def measure(name: str, points: int, seed: int = 1) -> dict[str, Any]:
    """Import a model, build its pieces, and sample all their levels with about `points` points in each direction."""
    with tempfile.TemporaryDirectory() as folder:
        if name in SCENES:
            file = Path(folder) / f"{name}.glb"
            write_scene(name, file, SCENE_TRIANGLES, 0)
        else:
            file = Path(os.environ["VLOD_MODELS"]) / MODELS[name]
        import_model([file], Path(folder) / "model")
        model = open_model(Path(folder) / "model")
        pieces = list(build_pieces(model, range(len(model.meshes)), DetailOptions()))
        total = sum(len(level.triangles) for piece in pieces for level in piece.levels)
        rng = np.random.default_rng(seed)
        taken, above, worst = 0, 0, 0.0
        for piece in pieces:
            surface = original(model, piece)
            for k, level in enumerate(piece.levels):
                count = 8 + points * len(level.triangles) // total
                mesh = level_mesh(piece, k)
                there, back = sample(*surface, count, rng), sample(*mesh, count, rng)
                found = float(max(distances(there, *mesh).max(), distances(back, *surface).max()))
                taken += len(there)
                rounding = 1e-12 * float(np.abs(surface[0]).max())
                above += found > level.error + rounding
                worst = max(worst, found / level.error if level.error > rounding else 0.0)
        simplified = [piece for piece in pieces if len(piece.levels) > 1]
        ratios = [
            level.error / measured(original(model, piece), level_mesh(piece, k), DENSE_POINTS, rng)
            for piece in simplified[:: max(1, len(simplified) // DENSE_PIECES)]
            for k, level in enumerate(piece.levels)
            if k > 0 and level.error > ROUNDING_STEPS * piece.scale
        ] or [1.0]
    return {
        "pieces": len(pieces),
        "levels": sum(len(piece.levels) for piece in pieces),
        "points_each_way": taken,
        "measured_above_stored": above,
        "largest_measured_over_stored": worst,
        "stored_over_measured_median": float(np.median(ratios)),
        "stored_over_measured_90_percent": float(np.quantile(ratios, 0.9)),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=[*MODELS, *SCENES], metavar="MODEL")
    parser.add_argument("--points", type=int, default=110_000, help="in each direction, for each model")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    results = {}
    columns = ["pieces", "levels", "points_each_way", "measured_above_stored", "largest_measured_over_stored"]
    columns += ["stored_over_measured_median", "stored_over_measured_90_percent"]
    print(" " * 20 + " ".join(f"{column:>31}" for column in columns))
    for name in arguments.models:
        results[name] = r = measure(name, arguments.points)
        print(f"{name:20}" + " ".join(f"{r[column]:31.6g}" for column in columns), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1, sort_keys=True))
    return int(any(r["measured_above_stored"] for r in results.values()))


if __name__ == "__main__":
    sys.exit(main())
