"""Speed of build_pieces on generated and real models, and of its two costly steps, in one run.

    python tests/benchmarks/bench_detail.py [--triangles N] [--json FILE] [MODEL ...]

Times are the process's own (one core). Real models need the environment variable VLOD_MODELS.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from jobs.detail import levels
from jobs.detail.pieces import DetailOptions, build_pieces
from jobs.importing.model import Model, import_model, open_model
from tests.jobs.detail.shapes import box, grid, joined, model_of, sphere

MODELS = {
    "conference": "mid_conference/conference.obj",
    "sportscar": "cad_sportscar/sportsCar.obj",
    "deathstar": "large_ldraw/deathstar10143.glb",
}


def timed(model: Model) -> dict[str, Any]:
    """Build all pieces once; seconds in all, in the edge collapses and in the error bounds."""
    inner = {"coarser": 0.0, "hausdorff_bound": 0.0}
    whole = {name: getattr(levels, name) for name in inner}

    def watched(name: str) -> Any:
        def call(*arguments: Any) -> Any:
            begin = time.process_time()
            result = whole[name](*arguments)
            inner[name] += time.process_time() - begin
            return result

        return call

    try:
        for name in inner:
            setattr(levels, name, watched(name))
        begin = time.process_time()
        pieces = list(build_pieces(model, range(len(model.meshes)), DetailOptions()))
        seconds = time.process_time() - begin
    finally:
        for name, function in whole.items():
            setattr(levels, name, function)
    triangles = int(model.meshes["triangles"].sum())
    return {
        "triangles": triangles,
        "pieces": len(pieces),
        "levels": sum(len(piece.levels) for piece in pieces),
        "coarsest_triangles": sum(len(piece.levels[-1].triangles) for piece in pieces),
        "seconds": seconds,
        "seconds_collapsing": inner["coarser"],
        "seconds_bounding": inner["hausdorff_bound"],
        "triangles_per_second": triangles / seconds,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=list(MODELS), metavar="MODEL")
    parser.add_argument("--triangles", type=int, default=200_000, help="of each generated model")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    n = arguments.triangles
    side = int((n / 2) ** 0.5) + 1
    rough = np.random.default_rng(0).random((side, side)).cumsum(axis=0).cumsum(axis=1) / side**2
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        list(
            build_pieces(
                model_of(root / "warm", sphere(40), box()), [0, 1], DetailOptions(component_triangle_limit=9000)
            )
        )
        cases: dict[str, Any] = {
            "bumpy sphere": lambda: model_of(root / "sphere", sphere(int((n / 12) ** 0.5), bumps=0.1)),
            "terrain": lambda: model_of(root / "terrain", grid(side, rough)),
            "boxes": lambda: model_of(
                root / "boxes", joined([box((2 * i, 0, 0), (2 * i + 1, 1, 1)) for i in range(n // 12)])
            ),
        }
        for name in arguments.models if "VLOD_MODELS" in os.environ else []:

            def imported(name: str = name) -> Model:
                import_model([Path(os.environ["VLOD_MODELS"]) / MODELS[name]], root / name)
                return open_model(root / name)

            cases[name] = imported
        columns = ["triangles", "pieces", "levels", "coarsest_triangles", "seconds", "seconds_collapsing"]
        columns += ["seconds_bounding", "triangles_per_second"]
        print(" " * 14 + " ".join(f"{column:>20}" for column in columns))
        for name, case in cases.items():
            results[name] = r = timed(case())
            print(f"{name:14}" + " ".join(f"{r[column]:20.6g}" for column in columns), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1, sort_keys=True))


if __name__ == "__main__":
    main()
