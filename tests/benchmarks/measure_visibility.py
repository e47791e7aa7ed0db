"""How tight and how fast from-region visibility is: cells around persons in rooms, against many rays.

    python tests/benchmarks/measure_visibility.py MODEL[@METRES] ... [--sizes 0.25 0.5 1] [--cells 50] [--json OUT.json]
    python tests/benchmarks/measure_visibility.py MODEL ... --anywhere [--sizes 0.001 0.005 0.02] [--cells 34]

A MODEL is a demo scene with its number of triangles (offices:1000000) or a file below VLOD_MODELS, with the length of
its unit in metres where that is not one. Cells are cubes around the eyes of persons that stand on floors below
ceilings; what is seen is the model at its finest, so the figures tell of visibility alone. The oracle casts --rays rays
a cell, two thirds of them at drawables that were not seen before; what it finds is added to what it found in earlier
runs on the same cells, so that the truth is approached from below. Tightness: triangles of the drawables that are
reported over those of the drawables that were seen, all cells together.

With --anywhere cells lie anywhere in the model's box, in walls and outdoors too; sizes are parts of its longest edge.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jobs.checking.oracle import Oracle, examine
from jobs.visibility.engine import Engine
from jobs.visibility.settings import QUALITIES, EngineSettings
from jobs.visibility.surfaces.soup import build_soup
from storage.geometry_reader import Geometry
from storage.model.cut import cut_within
from tests.benchmarks.models import model_file
from tests.jobs.built_geometry import build_geometry

#: Eyes above the floor, and the least distance of floor and ceiling, of walls, and the farthest walls, in metres.
EYES, LOWEST, NARROWEST, WIDEST = 1.6, 2.0, 0.35, 30.0


@dataclass(frozen=True)
class Finding:
    """What was found of all cells of a size."""

    model: str
    triangles: int
    size: float  # of the cells' edges, in metres
    cells: int
    rays: int  # in each cell and run
    missed: int  # drawables that were seen but not reported
    tightness: float  # triangles of what is reported over those of what is seen
    drawables: float  # the same by the number of drawables
    proven: float  # the triangles that cells know to be seen over those that are seen
    median_ms: float  # of a cell
    mean_ms: float
    worst_ms: float
    mean_seen: int  # triangles


class Case:
    """A model at its finest, and where persons stand in it."""

    def __init__(self, name: str, folder: Path, seal: float = 0.0) -> None:
        """Take a model; gaps no wider than `seal`, in metres, count as closed."""
        self.name, _, metres = name.partition("@")
        self.unit = float(metres or 1)
        self.folder = folder / self.name.replace("/", "_").replace(":", "_")
        self.folder.mkdir(parents=True, exist_ok=True)
        built = build_geometry([model_file(self.name, self.folder)], self.folder / "store")
        self.geometry: Geometry = built.geometry
        self.up = "xyz".index(built.model.up[-1])
        self.ids = cut_within(self.geometry.nodes, self.geometry.drawables, -1.0)
        rows = self.geometry.drawables[self.ids]
        surfaces = self.geometry.surfaces(self.ids)
        self.soup = build_soup(
            self.ids, rows["one_sided"], rows["see_through"], surfaces.points, surfaces.triangles,
            surfaces.triangle_counts, EngineSettings().cluster_size, seal / self.unit / self.geometry.grid.step,
        )  # fmt: skip
        self.owner = np.repeat(self.ids, surfaces.triangle_counts)
        corners = surfaces.points[surfaces.triangles] * self.geometry.grid.step
        self.triangles = np.ascontiguousarray(corners, np.float32)
        one_sided, see_through = (self.geometry.drawables[name][self.owner] for name in ("one_sided", "see_through"))
        self.oracle = Oracle(self.triangles, self.owner, one_sided, see_through)

    def persons(self, count: int) -> np.ndarray:
        """(count, 3) eyes of persons: at random above floors that have a ceiling and walls."""
        rng = np.random.default_rng(1)
        box_lo, box_hi = self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))
        down = np.zeros(3, np.float32)
        down[self.up] = -1
        turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
        around = np.zeros((12, 3), np.float32)
        around[:, (self.up + 1) % 3], around[:, (self.up + 2) % 3] = np.cos(turn), np.sin(turn)
        found: list[np.ndarray] = []
        for _ in range(200):
            start = (box_lo + rng.random((1000, 3)) * (box_hi - box_lo)).astype(np.float32)
            _, below = self.oracle.cast(start, np.broadcast_to(down, start.shape))
            eyes = start.copy()
            eyes[:, self.up] += np.where(np.isfinite(below), EYES / self.unit - below, 0).astype(np.float32)
            eyes = eyes[np.isfinite(below) & (below * self.unit < LOWEST)]
            _, under = self.oracle.cast(eyes, np.broadcast_to(down, eyes.shape))
            _, above = self.oracle.cast(eyes, np.broadcast_to(-down, eyes.shape))
            _, beside = self.oracle.cast(np.repeat(eyes, 12, axis=0), np.tile(around, (len(eyes), 1)))
            beside = beside.reshape(-1, 12) * self.unit
            stands = (np.abs(under * self.unit - EYES) < 0.05) & (above * self.unit > LOWEST - EYES) & (above < np.inf)
            stands &= (beside > NARROWEST).all(axis=1) & ((beside < WIDEST).sum(axis=1) >= 9)
            found.extend(eyes[stands].astype(np.float64))
            if len(found) >= count:
                return np.array(found[:count])
        raise SystemExit(f"{self.name}: only {len(found)} of {count} persons found a room; is its unit right?")

    def places(self, count: int) -> np.ndarray:
        """(count, 3) points anywhere in the model's box."""
        lo, hi = self.triangles.min(axis=(0, 1)).astype(np.float64), self.triangles.max(axis=(0, 1)).astype(np.float64)
        return lo + np.random.default_rng(2).random((count, 3)) * (hi - lo)

    @property
    def longest(self) -> float:
        """The longest edge of the model's box, in metres."""
        return float(np.ptp(self.triangles, axis=(0, 1)).max()) * self.unit

    def measure(self, size: float, eyes: np.ndarray, rays: int, settings: EngineSettings) -> Finding:
        """Cells of `size` metres around eyes (n, 3)."""
        engine = Engine(self.soup, settings)
        counts = self.geometry.drawables["triangles"].astype(np.int64)
        half = 0.5 * size / self.unit
        kept = self.folder / f"seen_{size:g}.npz"
        known = dict(np.load(kept)) if kept.exists() else {}
        seconds, missed, reported, seen, proven = [], 0, [], [], []
        step = self.geometry.grid.step
        engine.visible_from((eyes[0] - half) / step, (eyes[0] + half) / step, self.ids)
        for number, eye in enumerate(eyes):
            lo, hi = eye - half, eye + half
            began = time.perf_counter()
            found = engine.visible_from(lo / step, hi / step, self.ids)
            seconds.append(time.perf_counter() - began)
            assert found is not None
            name = " ".join(f"{value!r}" for value in eye.tolist())
            rng = np.random.default_rng([number, len(known.get(name, ()))])  # other rays in each run, the same for all
            looked = examine(self.oracle, lo, hi, found.visible, rays, rng)
            missed += len(looked.missed)
            # What was kept of earlier runs counts only as long as it is reported: single precision now and then lets a
            # ray slip between triangles, and only hits on what is not reported are confirmed in double precision.
            before = np.intersect1d(known.get(name, np.zeros(0, np.int64)), found.visible)
            known[name] = np.union1d(np.union1d(before, looked.seen), found.proven)
            reported.append(found.visible)
            seen.append(known[name])
            proven.append(found.proven)
        np.savez(kept, **known)

        def triangles(sets: list[np.ndarray]) -> int:
            return sum(int(counts[ids].sum()) for ids in sets)

        ms = 1000 * np.array(seconds)
        return Finding(
            model=self.name,
            triangles=int(counts[self.ids].sum()),
            size=size,
            cells=len(eyes),
            rays=rays,
            missed=missed,
            tightness=triangles(reported) / triangles(seen),
            drawables=sum(map(len, reported)) / sum(map(len, seen)),
            proven=triangles(proven) / triangles(seen),
            median_ms=float(np.median(ms)),
            mean_ms=float(ms.mean()),
            worst_ms=float(ms.max()),
            mean_seen=triangles(seen) // len(eyes),
        )


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+")
    parser.add_argument("--sizes", nargs="+", type=float)
    parser.add_argument("--anywhere", action="store_true", help="cells anywhere in the model's box")
    parser.add_argument("--cells", type=int, default=50)
    parser.add_argument("--rays", type=int, default=100_000)
    parser.add_argument("--work", type=Path, default=Path("build/visibility"))
    parser.add_argument("--quality", choices=QUALITIES, default="normal")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="settings of the engine, changed")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    settings = replace(
        QUALITIES[arguments.quality],
        **{k: type(getattr(EngineSettings(), k))(v) for k, v in (s.split("=") for s in arguments.set)},
    )
    rows: list[dict[str, Any]] = []
    print("model, triangles | cell | tightness: triangles, drawables, proven | ms: median, mean, worst | seen | missed")
    for name in arguments.models:
        case = Case(name, arguments.work, settings.seal)
        eyes = case.places(arguments.cells) if arguments.anywhere else case.persons(arguments.cells)
        for size in arguments.sizes or ((0.001, 0.005, 0.02) if arguments.anywhere else (0.25, 0.5, 1.0)):
            row = case.measure(size * case.longest if arguments.anywhere else size, eyes, arguments.rays, settings)
            rows.append(asdict(row))
            print(
                f"{row.model}, {row.triangles:,} | {row.size:g} m | "
                f"{row.tightness:.3f}, {row.drawables:.3f}, {row.proven:.3f} | "
                f"{row.median_ms:.0f}, {row.mean_ms:.0f}, {row.worst_ms:.0f} | {row.mean_seen:,} | {row.missed}",
                flush=True,
            )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
