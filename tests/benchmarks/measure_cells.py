"""What view cells cost and what they give: how the octree is split, and what a budget of triangles does to it.

    python tests/benchmarks/measure_cells.py MODEL ... [--max-depth 5] [--triangles-per-cell N] [--max-triangles N]

A MODEL is a demo scene with its number of triangles (plant:3000000) or a file below VLOD_MODELS. Each is built as it
is by default, with cells split wherever they are above the target (whatever a split saves), and, where --max-triangles
is given, with that. Triangles a frame: the mean of the cells' vLODs, each cell weighed by the part of the view space
that it takes; bytes: all shards of cells. --view: the part of the model's box where the viewer may be.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jobs.cells.subtree
from jobs.parameters import BuildParameters
from jobs.pipeline import build
from jobs.running.executors import SerialExecutor
from jobs.stages import cells as cells_stage
from storage import open_store
from tests.benchmarks.models import model_file
from tests.jobs.built_geometry import build_geometry

#: The rule of splitting that looks at the target alone.
ALWAYS = "split whatever it saves"


def measure(file: Path, folder: Path, parameters: BuildParameters) -> dict[str, Any]:
    """Builds a store, whose geometry is there already, and looks at its cells."""
    shutil.rmtree(folder / "work" / cells_stage.STAGE.name, ignore_errors=True)
    began = time.process_time()
    report = build([file], folder, parameters, SerialExecutor())
    store = open_store(folder)
    cells = store.cells
    lo, hi = (np.asarray(corner) for corner in (store.manifest.model.lo, store.manifest.model.hi))
    if parameters.view_box is not None:
        lo, hi = np.asarray(parameters.view_box[:3]), np.asarray(parameters.view_box[3:])
        lo, hi = lo - store.manifest.model.origin, hi - store.manifest.model.origin
    inside = (np.minimum(cells["hi"], hi) - np.maximum(cells["lo"], lo)).clip(min=0).prod(axis=1)
    raised = cells["pixel_error"] > parameters.pixel_error
    return {
        "cells": len(cells),
        "triangles_a_frame": float(np.average(cells["triangles"], weights=inside)),
        "largest": int(cells["triangles"].max()),
        "cell_bytes": report.bytes["cells"],
        "seconds": time.process_time() - began,
        "raised": int(raised.sum()),
        "largest_pixel_error": float(cells["pixel_error"].max()),
        "median_raised_pixel_error": float(np.median(cells["pixel_error"][raised])) if raised.any() else None,
    }


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", metavar="MODEL")
    parser.add_argument("--max-depth", type=int, default=5)
    parser.add_argument("--triangles-per-cell", type=int, default=50_000)
    parser.add_argument("--max-triangles", type=int)
    parser.add_argument("--quality", default="normal")
    parser.add_argument("--view", nargs=6, type=float, metavar="PART", help="x0 y0 z0 x1 y1 z1, each from 0 to 1")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    results: dict[str, dict[str, Any]] = {}
    print("model | rule | cells | triangles a frame, largest | KB of cells | core-seconds | raised, pixels")
    for name in arguments.models:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            file = model_file(name, folder)
            model = build_geometry([file], folder / "store").model
            lo, hi = np.asarray(model.lo), np.asarray(model.hi)
            view = None
            if arguments.view:
                corners = np.concatenate([lo + np.array(arguments.view[at : at + 3]) * (hi - lo) for at in (0, 3)])
                view = tuple((corners + np.tile(model.origin, 2)).tolist())
            parameters = BuildParameters(
                view_box=view,
                triangles_per_cell=arguments.triangles_per_cell,
                max_depth=arguments.max_depth,
                quality=arguments.quality,
            )
            rules = {"default": parameters, ALWAYS: parameters}
            if arguments.max_triangles is not None:
                bound = dataclasses.replace(parameters, max_triangles=arguments.max_triangles)
                rules[f"max {arguments.max_triangles:,}"] = bound
            results[name] = {}
            for rule, asked in rules.items():
                with pytest.MonkeyPatch.context() as patch:
                    if rule == ALWAYS:
                        patch.setattr(jobs.cells.subtree, "LEAST_SAVED", -np.inf)
                    results[name][rule] = row = measure(file, folder / "store", asked)
                median = row["median_raised_pixel_error"]
                pixels = "" if median is None else f", {median:g} (median) to {row['largest_pixel_error']:g}"
                print(
                    f"{name} | {rule} | {row['cells']:,} | {row['triangles_a_frame']:,.0f}, {row['largest']:,} | "
                    f"{row['cell_bytes'] / 1000:.0f} | {row['seconds']:.0f} | {row['raised']}{pixels}",
                    flush=True,
                )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
