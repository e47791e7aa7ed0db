"""What it takes to check a store of many cells: seconds, memory and cores of each part of `vlod verify`.

    python tests/benchmarks/measure_verify.py [--depth 5] [--floors 10] [--sight 10] [--copies 1] [--cells 100]
        [--samples 1000] [--workers 1 2] [--store PATH] [--json OUT.json]

The store is a tower of rooms (`tests.jobs.checking.tower_store`), 20,480 cells by default, made anew unless --store is
there. Each number of workers is measured in a process of its own. Memory is the largest of all processes at its peak
until the part's end; cores are the processor time of all of them over the time that passed, less where the machine is
in use otherwise.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from jobs.checking.verify import verify
from storage import open_store
from storage.base.progress import Silent
from tests.jobs.checking.peaks import Watch
from tests.jobs.checking.tower_store import Tower, make_tower


@dataclass(frozen=True)
class Part:
    """What a part took."""

    workers: int
    name: str
    note: str
    seconds: float
    processor_seconds: float  # of all processes
    peak_memory: int  # bytes
    processes: int

    @property
    def cores(self) -> float:
        """How many were at work, on average."""
        return self.processor_seconds / max(self.seconds, 1e-9)


class Parts(Silent):
    """Measures each part from its start to its end."""

    def __init__(self, workers: int, watch: Watch) -> None:
        self.measured: list[Part] = []
        self._workers, self._watch = workers, watch

    def start(self, step: str) -> None:
        """See `Progress.start`."""
        self._watch.look()
        self._step, self._began, self._used = step, time.perf_counter(), self._watch.seconds

    def finish(self, note: str) -> None:
        """See `Progress.finish`."""
        self._watch.look()
        seconds = time.perf_counter() - self._began
        used, watch = self._watch.seconds - self._used, self._watch
        self.measured.append(
            Part(self._workers, self._step, note, round(seconds, 2), round(used, 2), watch.peak, len(watch.processes))
        )


def measure(store: str, workers: int, cells: int, samples: int) -> list[Part]:
    """Check a store in this process and its workers."""
    with Watch() as watch:
        parts = Parts(workers, watch)
        verify(store, cells=cells, samples=samples, workers=workers, progress=parts)
    return parts.measured


def say(part: Part) -> None:
    """Print one part."""
    print(
        f"{part.workers} workers  {part.name:<10} {part.seconds:7.1f} s, {part.processor_seconds:7.1f} s of processors "
        f"({part.cores:4.2f} cores), {part.peak_memory / 2**20:6.0f} MiB, {part.processes} processes: {part.note}",
        flush=True,
    )


def main() -> None:
    """Make the store, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--depth", type=int, default=5, help="of the cells")
    parser.add_argument("--floors", type=int, default=10)
    parser.add_argument("--sight", type=int, default=10, help="in rooms")
    parser.add_argument("--copies", type=int, default=1, help="of each thing in a room")
    parser.add_argument("--cells", type=int, default=100, help="to sample")
    parser.add_argument("--samples", type=int, default=1000, help="rays for each sampled cell")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--store", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.alone:
        found = measure(str(arguments.store), arguments.workers[0], arguments.cells, arguments.samples)
        print(json.dumps([asdict(part) for part in found]))
        return
    measured: list[Part] = []
    with tempfile.TemporaryDirectory() as folder:
        place = arguments.store or Path(folder) / "store"
        if not (place / "manifest.json").exists():
            began = time.perf_counter()
            make_tower(place, Tower(arguments.depth, arguments.floors, arguments.sight, arguments.copies))
            print(f"made in {time.perf_counter() - began:.0f} s", flush=True)
        store = open_store(place)
        sizes = np.sort(store.cells["drawables"])
        print(
            f"{len(store.cells):,} cells, {len(store.drawables):,} drawables, vLODs of {sizes[0]:,} to {sizes[-1]:,}, "
            f"{sizes.mean():,.0f} on average",
            flush=True,
        )
        for workers in arguments.workers:
            options = ["--cells", arguments.cells, "--samples", arguments.samples, "--workers", workers]
            command = [sys.executable, __file__, "--alone", "--store", place, *options]
            done = subprocess.run(map(str, command), check=True, stdout=subprocess.PIPE, text=True)
            found = [Part(**row) for row in json.loads(done.stdout)]
            for part in found:
                say(part)
            measured += found
    if arguments.json is not None:
        arguments.json.write_text(json.dumps([asdict(part) for part in measured], indent=1))


if __name__ == "__main__":
    main()
