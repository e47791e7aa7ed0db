"""Whether the certificate of a cell is honest: an exhaustive oracle against what is reported and what is proven.

    python tests/benchmarks/check_certificate.py MODEL[@METRES] ... [--cells 50] [--rays 10000000] [--json OUT.json]

MODELs and cells are those of `measure_visibility`. From each cell's surface go --rays rays as `vlod verify` casts them,
in portions: a third in uniform directions, the rest at drawables that the portion has not seen yet. Then

- nothing outside what is reported may be seen (`missed`, confirmed in double precision);
- each drawable that is proven visible must be met by a ray in double precision with nothing before it. For this a tenth
  as many rays again go in uniform directions from the cell's corners; then, where none of them met it, rays from the
  corners and from anywhere on the cell's surface are aimed at it alone (`unconfirmed` where none of these does either).

Prints a line for each cell and a summary of each model. Ends with 1 if any was missed or is left unconfirmed.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from jobs.checking.oracle import examine, surface_points
from jobs.visibility.engine import Engine
from jobs.visibility.settings import EngineSettings
from tests.benchmarks.measure_visibility import Case

#: Rays of one portion, and of one try at a drawable that is proven but not confirmed yet.
PORTION, TRY = 1_000_000, 4096
#: Tries before a drawable counts as unconfirmed, and hits of a portion or try that are looked at in double precision.
TRIES, CONFIRMED = 50, 8


@dataclass(frozen=True)
class Checked:
    """What was found of one cell."""

    model: str
    cell: int
    rays: int
    reported: int  # drawables
    proven: int
    seen: int
    missed: list[int]  # seen in double precision, but not reported
    unconfirmed: list[int]  # proven visible, but not seen in double precision
    seconds: float


def check(case: Case, engine: Engine, number: int, lo: np.ndarray, hi: np.ndarray, rays: int) -> Checked:
    """Check the cell lo to hi (3,), in model units."""
    began = time.perf_counter()
    step = case.geometry.grid.step
    found = engine.visible_from(lo / step, hi / step, case.ids)
    assert found is not None
    rng = np.random.default_rng([7, number])
    seen: set[int] = set()
    missed: set[int] = set()
    known = found.visible
    cast = 0
    while cast < rays:
        looked = examine(case.oracle, lo, hi, known, min(PORTION, rays - cast), rng)
        cast += looked.rays
        seen.update(looked.seen.tolist())
        missed.update(sight.drawable for sight in looked.missed)
    left = set(found.proven.tolist())
    for start in range(0, rays // 10, PORTION):
        count = min(PORTION, rays // 10 - start)
        eyes = surface_points(lo, hi, 8, rng)[rng.integers(0, 8, count)]
        anywhere = rng.normal(size=(count, 3)).astype(np.float32)
        left -= _confirmed(case, eyes, anywhere, np.full(count, -1, np.int64), left)
    for drawable in sorted(left):
        if _is_seen(case, lo, hi, drawable, rng):
            left.remove(drawable)
    return Checked(
        case.name, number, cast, len(found.visible), len(found.proven), len(seen), sorted(missed), sorted(left),
        round(time.perf_counter() - began, 1),
    )  # fmt: skip


def _is_seen(case: Case, lo: np.ndarray, hi: np.ndarray, drawable: int, rng: np.random.Generator) -> bool:
    """Whether one of many rays from the cell's surface at a drawable meets it."""
    first, last = np.searchsorted(case.owner, [drawable, drawable + 1])
    corners = case.triangles[first:last].astype(np.float64)
    for attempt in range(TRIES):
        eyes = surface_points(lo, hi, TRY, rng)
        if attempt % 2 == 0:
            eyes = eyes[rng.integers(0, 8, TRY)]  # the corners
        weights = rng.dirichlet((1.0, 1.0, 1.0), TRY)
        aims = rng.integers(0, last - first, TRY)
        targets = (corners[aims] * weights[:, :, None]).sum(axis=1)
        if _confirmed(case, eyes, (targets - eyes).astype(np.float32), first + aims, {drawable}):
            return True
    return False


def _confirmed(case: Case, origins: np.ndarray, directions: np.ndarray, aims: np.ndarray, wanted: set[int]) -> set[int]:
    """Which of some drawables rays from origins (n, 3) float32 along directions (n, 3) float32 surely see.

    aims: (n,) int64 triangles that they end in, -1: none.
    """
    hits, along = case.oracle.cast(origins, directions)
    through, panes = case.oracle.passed(origins, directions, along)
    aimed = np.flatnonzero((aims >= 0) & (along > 1))
    rays = np.concatenate([np.flatnonzero(hits >= 0), through, aimed])
    hits = np.concatenate([hits[hits >= 0], panes, aims[aimed]])
    drawables = case.owner[hits]
    confirmed: set[int] = set()
    for drawable in wanted:
        for hit in np.flatnonzero(drawables == drawable)[:CONFIRMED]:
            ray = rays[hit]
            if not np.isnan(case.oracle.confirm(origins[ray], directions[ray], int(hits[hit]), alone=False)):
                confirmed.add(drawable)
                break
    return confirmed


def say(name: str, cells: list[Checked]) -> None:
    """Print what was found of some cells, all together."""
    print(
        f"{name}: {sum(row.rays for row in cells):,} rays, {sum(row.reported for row in cells):,} reported, "
        f"{sum(row.proven for row in cells):,} proven, {sum(row.seen for row in cells):,} seen, "
        f"missed {_all(row.missed for row in cells)}, unconfirmed {_all(row.unconfirmed for row in cells)}, "
        f"{sum(row.seconds for row in cells):,.1f} s",
        flush=True,
    )


def _all(found: Iterable[list[int]]) -> str:
    """How many drawables, and which."""
    drawables = [drawable for row in found for drawable in row]
    return f"{len(drawables)} {drawables}" if drawables else "0"


def main() -> None:
    """Check and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+")
    parser.add_argument("--cells", type=int, default=50)
    parser.add_argument("--size", type=float, default=0.5, help="of the cells' edges, in metres")
    parser.add_argument("--rays", type=int, default=10_000_000)
    parser.add_argument("--work", type=Path, default=Path("build/visibility"))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    checked: list[Checked] = []
    for name in arguments.models:
        case = Case(name, arguments.work)
        engine = Engine(case.soup, EngineSettings())
        half = 0.5 * arguments.size / case.unit
        cells = []
        for number, eye in enumerate(case.persons(arguments.cells)):
            cells.append(check(case, engine, number, eye - half, eye + half, arguments.rays))
            say(f"  cell {number}", cells[-1:])
        say(f"{case.name}, {len(cells)} cells", cells)
        checked += cells
    if arguments.json is not None:
        arguments.json.write_text(json.dumps([asdict(row) for row in checked], indent=1))
    raise SystemExit(1 if any(row.missed or row.unconfirmed for row in checked) else 0)


if __name__ == "__main__":
    main()
