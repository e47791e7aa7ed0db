"""Checks a finished store: its bytes, its deltas, its detail, and its visibility against an oracle.

What is checked:
- every checksum of every shard and of the manifest;
- every delta across a boundary is consistent with the vLODs of both its cells;
- every cell's vLOD is part of its cut, and the cut stands for every node once, at an error below the pixel error;
- rays from the surfaces of sampled cells see nothing that is not in the cells' vLODs (see `jobs.checking.oracle`),
  and no fronts of the facets that are not drawn there; in a store made with --sampled or --seal, how many do is
  measured instead.
"""

from __future__ import annotations

import os
import signal
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from typing import Any

import numpy as np

from jobs.checking.oracle import Oracle, Sight, examine
from jobs.running.errors import WorkerLostError
from storage import open_store
from storage.base.errors import ParameterError
from storage.model.cut import UNBOUNDED
from storage.store import Store

#: Problems of one kind that are spelled out; the rest is counted.
MOST_TOLD = 20
#: Bytes of triangles kept for the next cell, of all workers together.
MESH_CACHE = 1 << 30
#: Triangles in the cuts of all sampled cells from which on several processes are worth their start.
WORTH_SHARING = 10_000_000


@dataclass(frozen=True)
class CellFindings:
    """What the oracle found in one cell."""

    cell: int
    key: int
    rays: int
    reported_drawables: int
    seen_drawables: int
    reported_triangles: int
    seen_triangles: int
    missed: int
    uniform_rays: int
    missed_rays: int
    refuted: int
    seconds: float


@dataclass
class VerifyReport:
    """The result of `verify`. `problems` is empty in a sound store."""

    store: str
    cells: int  # computed cells in the store
    boundaries: int  # boundaries whose deltas were checked
    samples: int  # rays asked for in each sampled cell
    seed: int
    approximation: str | None  # the option that lets the store miss something: that is measured and is no problem
    sampled: list[CellFindings] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    stored_rays: int = 0  # hold-out rays of the sampled cells, as the store says
    stored_missed_rays: int = 0  # of these, missed
    untold: int = 0  # problems beyond those that are spelled out
    seconds: float = 0.0

    @property
    def ok(self) -> bool:
        """Whether nothing was found wrong."""
        return not self.problems

    @property
    def missed(self) -> int:
        """Drawables seen by the oracle but missing from a cell's vLOD."""
        return sum(cell.missed for cell in self.sampled)

    @property
    def uniform_rays(self) -> int:
        """Rays in uniform directions: each as good as a pixel of somebody in a cell."""
        return sum(cell.uniform_rays for cell in self.sampled)

    @property
    def missed_rays(self) -> int:
        """Uniform rays that met a missed drawable first: pixels that would be wrong."""
        return sum(cell.missed_rays for cell in self.sampled)

    @property
    def rays(self) -> int:
        """All rays cast."""
        return sum(cell.rays for cell in self.sampled)

    @property
    def tightness(self) -> dict[str, float | None]:
        """Reported over seen, all sampled cells together, in triangles and in drawables."""
        result: dict[str, float | None] = {}
        for unit in ("triangles", "drawables"):
            seen = sum(getattr(cell, f"seen_{unit}") for cell in self.sampled)
            reported = sum(getattr(cell, f"reported_{unit}") for cell in self.sampled)
            result[unit] = reported / seen if seen else None
        return result

    def to_json(self) -> dict[str, Any]:
        """Everything, ready for `json.dumps`."""
        return {
            "store": self.store,
            "ok": self.ok,
            "cells": self.cells,
            "boundaries": self.boundaries,
            "sampled_cells": len(self.sampled),
            "samples_per_cell": self.samples,
            "rays": self.rays,
            "missed": self.missed,
            "approximation": self.approximation,
            "uniform_rays": self.uniform_rays,
            "missed_rays": self.missed_rays,
            "stored_rays": self.stored_rays,
            "stored_missed_rays": self.stored_missed_rays,
            "refuted": sum(cell.refuted for cell in self.sampled),
            "tightness": self.tightness,
            "seconds": round(self.seconds, 3),
            "seed": self.seed,
            "problems": self.problems,
            "problems_untold": self.untold,
            "per_cell": [asdict(cell) for cell in self.sampled],
        }

    def tell(self, kind_count: int, problem: str) -> None:
        """Note a problem; only the first MOST_TOLD of a kind are spelled out."""
        if kind_count <= MOST_TOLD:
            self.problems.append(problem)
        else:
            self.untold += 1


def verify(
    url: str,
    *,
    samples: int = 1000,
    cells: int = 100,
    seed: int = 0,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> VerifyReport:
    """Check a store.

    Args:
        url: of the store.
        samples: rays per sampled cell; 0 leaves the oracle out.
        cells: how many cells to sample, spread evenly over the octree's order; all where the store has no more.
        seed: of the sampling. The findings do not depend on the number of workers.
        workers: processes that cast rays; by default as many as there are cores, or one where there is little to do.
        progress: called with (done, total) sampled cells.

    Raises:
        StoreNotFoundError, CorruptStoreError: the store cannot even be opened.
        ParameterError: samples or cells below 0, workers below 1.
    """
    if samples < 0 or cells < 0:
        raise ParameterError(f"samples and cells must not be negative, not {samples} and {cells}")
    if workers is not None and workers < 1:
        raise ParameterError(f"workers must be 1 or more, not {workers}")
    began = time.perf_counter()
    store = open_store(url)
    computed = np.flatnonzero(store.cells["computed"])
    report = VerifyReport(
        store=url,
        cells=len(computed),
        boundaries=0,
        samples=samples,
        seed=seed,
        approximation=store.manifest.approximation,
    )
    for count, problem in enumerate(store.check(), 1):
        report.tell(count, str(problem))
    if report.ok:
        _check_deltas(store, computed, report)
        chosen = computed[_spread(len(computed), cells)]
        if progress is not None:
            progress(0, len(chosen))
        with _oracles(store, chosen, samples, seed, workers) as findings:
            for done, (cell, found) in enumerate(zip(chosen, findings, strict=True), 1):
                _check_cut(store, int(cell), report)
                if found is not None:
                    before = report.missed
                    report.sampled.append(found[0])
                    report.stored_rays += int(store.cells["hold_out_rays"][cell])
                    report.stored_missed_rays += int(store.cells["missed_rays"][cell])
                    if report.approximation is None:
                        for count, line in enumerate(_accusations(store, int(cell), found[1]), before + 1):
                            report.tell(count, line)
                if progress is not None:
                    progress(done, len(chosen))
    report.seconds = time.perf_counter() - began
    return report


def _spread(count: int, wanted: int) -> np.ndarray:
    """Up to `wanted` places from 0 to count - 1, evenly apart."""
    return np.unique(np.linspace(0, count - 1, min(count, wanted)).astype(np.int64))


def _check_deltas(store: Store, computed: np.ndarray, report: VerifyReport) -> None:
    """Every delta turns one cell's vLOD into the other's."""
    sets = {int(cell): store.vlod(int(cell)) for cell in computed}
    wrong = 0
    for cell in computed:
        a = int(cell)
        reported = int(store.cells["drawables"][a])
        if len(sets[a]) != reported:
            wrong += 1
            report.tell(wrong, f"cell {a}: the vLOD holds {len(sets[a])} drawables, the table says {reported}")
        for other in store.neighbours(a):
            b = int(other)
            if b not in sets:
                continue
            report.boundaries += a < b
            added, dropped = store.delta(a, b)
            kept = np.setdiff1d(sets[a], dropped, assume_unique=True)
            consistent = (
                len(kept) == len(sets[a]) - len(dropped)
                and len(np.intersect1d(kept, added)) == 0
                and np.array_equal(np.union1d(kept, added), sets[b])
            )
            if not consistent:
                wrong += 1
                report.tell(wrong, f"the delta from cell {a} to cell {b} does not turn one vLOD into the other")


def _check_cut(store: Store, cell: int, report: VerifyReport) -> None:
    """The vLOD is part of the cut; the cut stands for each leaf exactly once, fine enough as seen from the cell."""
    cut, vlod = store.cut(cell), store.vlod(cell)
    if len(np.setdiff1d(vlod, cut)):
        report.problems.append(f"cell {cell}: {len(np.setdiff1d(vlod, cut))} drawables of its vLOD are not in its cut")
    rows = store.drawables[cut]
    end = store.nodes["end"].astype(np.int64)
    leaf = end == np.arange(len(end)) + 1
    covered = np.zeros(len(end) + 1, np.int64)
    np.add.at(covered, rows["node"], 1)
    np.add.at(covered, end[rows["node"]], -1)
    if (np.cumsum(covered)[:-1][leaf] != 1).any():
        report.problems.append(f"cell {cell}: its cut does not stand for every leaf exactly once")
    row = store.cells[cell]
    turned = int(store.facets(vlod).turned_away(vlod, row["lo"], row["hi"]).triangle_counts.sum())
    if turned != row["turned_triangles"]:
        report.problems.append(
            f"cell {cell}: {turned} triangles of its vLOD are turned away, the table says {row['turned_triangles']}"
        )
    # from anywhere in the cell a point of the drawable is at least this far away
    gap = np.maximum(rows["lo"].astype(np.float64) - row["hi"], row["lo"] - rows["hi"].astype(np.float64)).clip(min=0)
    distance = np.sqrt((gap * gap).sum(axis=1))
    error = rows["error"].astype(np.float64)
    # beyond UNBOUNDED, which only a cell that is kept small reaches, near things may be coarser
    angle = float(row["pixel_error"]) * store.manifest.pixel_angle
    allowed = np.maximum(angle * distance, (angle - UNBOUNDED) * np.linalg.norm(row["hi"] - row["lo"]))
    coarse = ((rows["level"] > 0) | ~leaf[rows["node"]]) & (error > allowed * (1 + 1e-6))
    for d in cut[coarse][:MOST_TOLD]:
        report.problems.append(f"cell {cell}: drawable {d} is too coarse for the allowed {row['pixel_error']} pixels")


_Findings = tuple[CellFindings, list[Sight]]


@contextmanager
def _oracles(
    store: Store, chosen: np.ndarray, samples: int, seed: int, workers: int | None
) -> Iterator[Iterator[_Findings | None]]:
    """What the oracle finds in each of the chosen cells, in their order; None for each without samples."""
    if not samples:
        yield (None for _ in chosen)
        return
    if workers is None:
        little = int(store.cells["cut_triangles"][chosen].sum()) < WORTH_SHARING
        workers = 1 if little else os.cpu_count() or 1
    only_here = store.files.url.startswith("memory:")
    workers = 1 if only_here else min(workers, len(chosen))
    if workers <= 1:
        examiner = _Examiner(store, samples, seed, MESH_CACHE)
        yield (examiner.examine(int(cell)) for cell in chosen)
        return
    place = (store.files.url, store.manifest.version)
    pool = ProcessPoolExecutor(
        workers, get_context("spawn"), _begin_worker, (*place, samples, seed, MESH_CACHE // workers)
    )
    try:
        yield pool.map(_examine, chosen.tolist())
    except BrokenProcessPool:
        raise WorkerLostError(
            "a process that cast rays died, for lack of memory most often: use fewer --workers"
        ) from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_examiner: _Examiner | None = None


def _begin_worker(url: str, version: int, samples: int, seed: int, cache: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the process that shares out the cells
    global _examiner  # noqa: PLW0603 - one store for each worker process
    _examiner = _Examiner(open_store(url, version=version), samples, seed, cache)


def _examine(cell: int) -> _Findings:
    assert _examiner is not None
    return _examiner.examine(cell)


class _Examiner:
    """Casts rays from cells of a store; keeps the triangles last used."""

    def __init__(self, store: Store, samples: int, seed: int, cache: int) -> None:
        self._store, self._samples, self._seed, self._cache = store, samples, seed, cache
        self._kept: OrderedDict[int, np.ndarray] = OrderedDict()
        self._bytes = 0

    def examine(self, cell: int) -> _Findings:
        """Rays from one cell: the counts, and what the cell misses, named as 2 d, or 2 d + 1 where d is in its vLOD."""
        began = time.perf_counter()
        store = self._store
        cut, vlod = store.cut(cell), store.vlod(cell)
        row = store.cells[cell]
        parts = self._triangles(cut)
        triangles = np.concatenate(parts) if parts else np.zeros((0, 3, 3), np.float32)
        # what is drawn of a drawable d is one thing, 2 d; what is not drawn, being turned away, another: 2 d + 1
        thing = np.repeat(2 * cut, [len(part) for part in parts])
        thing[np.isin(thing, 2 * vlod)] += self._turned_away(vlod, row["lo"], row["hi"])
        order = np.argsort(thing, kind="stable")
        triangles, thing = triangles[order], thing[order]
        oracle = Oracle(triangles, thing, store.drawables["one_sided"][thing // 2])
        rng = np.random.default_rng([self._seed, int(row["key"])])
        found = examine(oracle, thing, triangles, row["lo"], row["hi"], 2 * vlod, self._samples, rng)
        counts = store.drawables["triangles"].astype(np.int64)
        seen = np.unique(found.seen // 2)
        summary = CellFindings(
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
        return summary, found.missed

    def _turned_away(self, vlod: np.ndarray, lo: np.ndarray, hi: np.ndarray) -> np.ndarray:
        """Which triangles (m,) bool of a vLOD, drawable after drawable, are in facets that the cell does not draw."""
        found = [self._store.turned_away(drawable, lo, hi) for drawable in vlod.tolist()]
        return np.concatenate([np.zeros(0, np.bool_), *found])

    def _triangles(self, drawables: np.ndarray) -> list[np.ndarray]:
        """(m, 3, 3) float32 corners in model units of each of some drawables."""
        missing = np.array([d for d in drawables.tolist() if d not in self._kept], np.int64)
        found = self._store.surfaces(missing)
        corners = (found.points[found.triangles] * self._store.grid.step).astype(np.float32)
        fresh = [part.copy() for part in np.split(corners, np.cumsum(found.triangle_counts)[:-1])]
        self._kept.update(zip(missing.tolist(), fresh, strict=True) if len(missing) else ())
        for d in drawables.tolist():
            self._kept.move_to_end(d)
        parts = [self._kept[d] for d in drawables.tolist()]
        self._bytes += corners.nbytes
        while self._bytes > self._cache and len(self._kept) > 1:
            self._bytes -= self._kept.popitem(last=False)[1].nbytes
        return parts


def _accusations(store: Store, cell: int, missed: list[Sight]) -> Iterator[str]:
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
