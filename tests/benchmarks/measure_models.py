"""Builds and verifies stores of the real models and of the demo scenes, and prints a table for the README.

    python tests/benchmarks/measure_models.py OUT.json [NAME ...] [--cells 100] [--samples 3000] [--work DIR]

Needs the environment variable VLOD_MODELS for the real models; leaves out those that are not there. Stores and the
generated scenes stay in the work directory, so that a second run measures only what changed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from storage import open_store


@dataclass(frozen=True)
class Case:
    """A model and how its store is built."""

    source: str  # path under VLOD_MODELS, or a demo scene's kind
    options: tuple[str, ...]  # of `vlod build`
    triangles: int | None = None  # of a demo scene


CASES = {
    "mid_hospital": Case(
        "mid_hospital/hospital_three_floors.glb",
        ("--region", "-8", "6.9", "-20", "8", "8.2", "0", "--cell-size", "1.8"),
    ),
    "mid_conference": Case(
        "mid_conference/conference.obj",
        ("--region", "-600", "200", "-700", "1400", "350", "200", "--cell-size", "80"),
    ),
    "small_willowgarage": Case(
        "small_willowgarage/willowgarage_visual.dae", ("--max-depth", "4", "--triangles-per-cell", "1000")
    ),
    "mid_lost_empire": Case(
        "mid_lost_empire/lost_empire.obj",
        ("--region", "15", "2", "-76", "27", "3.5", "-58", "--cell-size", "1.3"),
    ),
    "cad_sportscar": Case("cad_sportscar/sportsCar.obj", ("--max-depth", "4")),
    "plant": Case("plant", ("--region", "-2", "1.4", "-48", "40", "2", "0", "--cell-size", "3.5"), 300_000),
    "offices": Case("offices", ("--region", "-18", "1.2", "-12", "10", "2", "8", "--cell-size", "1.3"), 300_000),
    "city": Case("city", ("--region", "30", "1.2", "-70", "60", "2", "-45", "--cell-size", "1.3"), 300_000),
}


def vlod(*arguments: str) -> str:
    """Standard output of a vlod command; its messages go to standard error."""
    command = [sys.executable, "-c", "from storage.cli.command import main; main()", *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in {0, 1}:
        raise SystemExit(f"vlod {' '.join(arguments)} ended with {done.returncode}")
    return done.stdout


def measure(name: str, case: Case, work: Path, cells: int, samples: int) -> dict[str, Any] | None:
    """Build and verify one model; None where it is not at hand."""
    if case.triangles is None:
        models = os.environ.get("VLOD_MODELS")
        if models is None or not (Path(models) / case.source).exists():
            print(f"{name}: left out, not under VLOD_MODELS", file=sys.stderr)
            return None
        source = Path(models) / case.source
    else:
        source = work / f"{name}.glb"
        if not source.exists():
            vlod("demo-scene", case.source, str(source), "--triangles", str(case.triangles))
    store = work / f"{name}.store"
    began = time.perf_counter()
    build = json.loads(vlod("build", str(source), str(store), *case.options, "--json"))
    seconds = time.perf_counter() - began
    report = json.loads(vlod("verify", str(store), "--cells", str(cells), "--samples", str(samples), "--json"))
    opened = open_store(str(store))
    computed = opened.cells[opened.cells["computed"]]
    return {
        "name": name,
        "triangles": opened.manifest.model.triangles,
        "options": " ".join(case.options),
        "cells": len(computed),
        "drawables": len(opened.drawables),
        "build_seconds": round(seconds, 1),
        "build": build,
        "mean_reported": float(np.mean(computed["triangles"])),
        "mean_cut": float(np.mean(computed["cut_triangles"])),
        "verify": {key: value for key, value in report.items() if key != "per_cell"},
    }


def main() -> None:
    """Measure what is asked for and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*", default=list(CASES))
    parser.add_argument("--cells", type=int, default=100)
    parser.add_argument("--samples", type=int, default=3000)
    parser.add_argument("--work", type=Path, default=Path("build/measure"))
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    rows = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}
    for name in arguments.names:
        row = measure(name, CASES[name], arguments.work, arguments.cells, arguments.samples)
        if row is not None:
            rows[name] = row
            arguments.out.write_text(json.dumps(rows, indent=1))
    print(
        "| model | triangles | cells checked | seen but missing | reported / seen: triangles, drawables "
        "| triangles a cell: cut, vLOD | core-seconds a cell |\n|---|---|---|---|---|---|---|"
    )
    for row in rows.values():
        checked = row["verify"]
        tight = checked["tightness"]
        visibility = sum(stage["core_seconds"] for stage in row["build"]["stages"] if stage["name"] == "cells")
        print(
            f"| {row['name']} | {row['triangles']:,} | {checked['sampled_cells']} of {row['cells']} | "
            f"{checked['missed']} | {tight['triangles']:.2f}, {tight['drawables']:.2f} | "
            f"{row['mean_cut']:,.0f}, {row['mean_reported']:,.0f} | {visibility / row['cells']:.2f} |"
        )


if __name__ == "__main__":
    main()
