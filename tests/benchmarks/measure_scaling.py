"""How the time of a cell grows with the model: demo offices of several sizes, cells around persons in their rooms.

    python tests/benchmarks/measure_scaling.py [--triangles 1000000 3000000 10000000] [--json OUT.json]

All of a model is one tower, the larger the taller, so that a person sees about as much in each. With --towers larger
models have more towers, as the demo has them: persons at windows see into those opposite, so they see more.
The figures are of the model at its finest, one engine for all of it: the time to make the engine, and of a cell the
processor time with images alone and with all that the quality asks for.
"""

from __future__ import annotations

import argparse
import gc
import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from jobs.scenes import offices
from jobs.visibility.engine import Engine
from jobs.visibility.settings import QUALITIES, EngineSettings
from tests.benchmarks.measure_visibility import Case


@dataclass(frozen=True)
class Scaling:
    """What was measured of a model."""

    model: str
    triangles: int
    size: float  # of the cells' edges, in metres
    cells: int
    reported: int  # triangles, the mean of the cells
    engine_seconds: float  # to make the engine
    images_ms: float  # of a cell, the median, without shafts
    images_mean_ms: float
    all_ms: float  # the median with all that the quality asks for
    all_mean_ms: float


def measure(case: Case, size: float, cells: int, settings: EngineSettings) -> Scaling:
    """Cells of `size` metres around persons."""
    counts = case.geometry.drawables["triangles"].astype(np.int64)
    step, half = case.geometry.grid.step, 0.5 * size / case.unit
    eyes = case.persons(cells)
    times: list[np.ndarray] = []
    for each in (replace(settings, shafts=0), settings):
        began = time.thread_time()
        engine = Engine(case.soup, each)
        made = time.thread_time() - began
        ms, reported = [], 0
        for eye in (eyes[0], *eyes):  # the first one twice: not measured where kernels are made ready
            began = time.thread_time()
            found = engine.visible_from((eye - half) / step, (eye + half) / step, case.ids)
            ms.append(1000 * (time.thread_time() - began))
            assert found is not None
            reported += int(counts[found.visible].sum())
        times.append(np.array(ms[1:]))
    return Scaling(
        model=case.name,
        triangles=int(counts[case.ids].sum()),
        size=size,
        cells=cells,
        reported=reported // (cells + 1),
        engine_seconds=made,
        images_ms=float(np.median(times[0])),
        images_mean_ms=float(times[0].mean()),
        all_ms=float(np.median(times[1])),
        all_mean_ms=float(times[1].mean()),
    )


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--triangles", nargs="+", type=int, default=[1_000_000, 3_000_000, 10_000_000])
    parser.add_argument("--towers", action="store_true", help="more towers in place of a taller one")
    parser.add_argument("--size", type=float, default=0.25)
    parser.add_argument("--cells", type=int, default=24)
    parser.add_argument("--quality", choices=QUALITIES, default="normal")
    parser.add_argument("--work", type=Path, default=Path("build/visibility"))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if not arguments.towers:
        offices.TOWER_STOREYS = max(arguments.triangles) // offices.STOREY_TRIANGLES + 1
    folder = arguments.work / ("towers" if arguments.towers else "tower")
    rows: list[Scaling] = []
    print("model | triangles | reported | engine: s | images: ms, median and mean | all: ms, median and mean")
    for triangles in arguments.triangles:
        case = Case(f"offices:{triangles}", folder)
        row = measure(case, arguments.size, arguments.cells, QUALITIES[arguments.quality])
        rows.append(row)
        print(
            f"{row.model} | {row.triangles:,} | {row.reported:,} | {row.engine_seconds:.1f} | "
            f"{row.images_ms:.1f}, {row.images_mean_ms:.1f} | {row.all_ms:.1f}, {row.all_mean_ms:.1f}",
            flush=True,
        )
        del case
        gc.collect()
    if arguments.json is not None:
        arguments.json.write_text(json.dumps([asdict(row) for row in rows], indent=1))


if __name__ == "__main__":
    main()
