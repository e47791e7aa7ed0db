"""Rays from the surface of a cell: what they meet must be in the cell's vLOD, and be drawn."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from jobs.checking.cut_oracle import CutOracle
from jobs.checking.findings import CellFindings, Problems
from jobs.checking.oracle import Sight, examine
from jobs.checking.workers import Place
from storage.base.errors import StoreError
from storage.store import Store


class Sample(NamedTuple):
    """A cell, and the rays that are wanted from it."""

    cell: int
    rays: int
    seed: int


class Seen(NamedTuple):
    """What rays from one cell found."""

    findings: CellFindings | None  # None where the cell cannot be read
    problems: Problems


def cast_rays(place: Place, sample: Sample) -> Seen:
    """Casts rays from one cell.

    What they see and the vLOD misses is a problem, unless the store may miss something.
    """
    problems = Problems()
    try:
        findings, missed = _cast(place, sample)
        if place.manifest.approximation is None:
            problems.note(_accusations(place.store, sample.cell, missed))
    except StoreError as error:
        problems.note([f"no rays can be cast from cell {sample.cell}: {error}"])
        return Seen(None, problems)
    return Seen(findings, problems)


def _cast(place: Place, sample: Sample) -> tuple[CellFindings, list[Sight]]:
    """What rays from one cell found, and what they saw that is not drawn: 2 d + 1 for what is turned away of d."""
    began = time.perf_counter()
    store, cell = place.store, sample.cell
    vlod, row = store.vlod(cell), store.cells[cell]
    oracle = CutOracle(place, cell)
    rng = np.random.default_rng([sample.seed, int(row["key"])])
    found = examine(oracle, row["lo"], row["hi"], oracle.reported, sample.rays, rng)
    counts = store.drawables["triangles"].astype(np.int64)
    seen = np.unique(found.seen // 2)
    findings = CellFindings(
        cell=cell,
        key=int(row["key"]),
        rays=found.rays,
        reported_drawables=len(vlod),
        seen_drawables=len(seen),
        reported_triangles=int(counts[vlod].sum()),
        seen_triangles=int(counts[seen].sum()),
        missed=len(found.missed),
        uniform_rays=found.uniform,
        missed_rays=found.missed_rays,
        refuted=found.refuted,
        seconds=round(time.perf_counter() - began, 4),
    )
    return findings, found.missed


def _accusations(store: Store, cell: int, missed: Sequence[Sight]) -> Iterator[str]:
    """A line for each missed drawable, with all that is needed to see it oneself."""
    for sight in missed:
        drawable, turned = divmod(sight.drawable, 2)
        node = int(store.drawables["node"][drawable])
        names = ", ".join(repr(name) for name in store.names_of(node)[:3])
        what = "the front of a facet that it leaves out of drawable" if turned else "drawable"
        yield (
            f"cell {cell} (key {int(store.cells['key'][cell])}) misses {what} {drawable} of {names}: "
            f"seen from {sight.origin} along {sight.direction} at {sight.distance:g} ray lengths"
        )
