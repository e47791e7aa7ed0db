"""Checks a finished store: its bytes, its sets, its detail, and its visibility against an oracle.

What is checked:

    checksums   every byte of every shard and of the manifests, of all versions; and that of a drawable that is said to
                be see-through all vertices have an alpha below 255, of all others none
    sets        every cell's vLOD is part of its cut, and both are of the sizes that the table of cells says
    detail      a sampled cell's vLOD is part of its cut, and the cut stands for every leaf once, at an error below the
                pixel error
    rays        rays from the surfaces of sampled cells see nothing that is not in the cells' vLODs, neither what stops
                them nor what they go through on their way (see `jobs.checking.oracle`), and no fronts of the facets
                that are not drawn there; in a store made with --sampled or --seal, how many do is measured instead

Each part is shared out among processes item by item: a shard, a run of cells, a cell. What is found does not depend on
how many there are. What lies in a damaged shard is left out of the parts that follow, the rest is checked all the same.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from jobs.checking.checksums import check_shard
from jobs.checking.detail import check_detail
from jobs.checking.findings import VerifyReport
from jobs.checking.rays import Sample, cast_rays
from jobs.checking.sets import check_run, runs
from jobs.checking.workers import Place, Workers
from storage import open_store
from storage.base.errors import ParameterError, StoreError, StoreNotFoundError
from storage.base.progress import Progress, Silent
from storage.shards.files import Files
from storage.shards.manifest import FILE, from_bytes
from storage.versions import Versions, find_versions

#: Cells to sample by default: a part of those that were computed, so that a check takes a part of what the build took,
#: whatever a cell of the model costs; within these numbers.
SHARE, FEWEST, MOST = 0.1, 10, 100

Item = TypeVar("Item")
Result = TypeVar("Result")


def verify(
    url: str,
    *,
    samples: int = 1000,
    cells: int | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> VerifyReport:
    """Check a store.

    Args:
        url: of the store.
        samples: rays per sampled cell; 0 leaves the oracle out.
        cells: how many cells to sample, spread evenly over the octree's order; all where the store has no more. By
            default a tenth of them, from 10 to 100: see `cells_to_sample`.
        seed: of the sampling. The findings do not depend on the number of workers.
        workers: processes that work; by default one for each core, or this one alone where there is little to do.
        progress: hears of the parts.

    Raises:
        StoreNotFoundError, StoreFormatError: there is no store that can be read.
        CorruptStoreError: the manifest is damaged, so that nothing is known of the rest.
        StoreUnreachableError: the manifest cannot be read; of all else that is a problem like others.
        WorkerLostError: a worker died.
        ParameterError: samples or cells below 0, workers below 1.
    """
    if samples < 0 or (cells is not None and cells < 0):
        raise ParameterError(f"samples and cells must not be negative, not {samples} and {cells}")
    if workers is not None and workers < 1:
        raise ParameterError(f"workers must be 1 or more, not {workers}")
    began = time.perf_counter()
    place, unopened = _opened(url)
    manifest = place.manifest
    report = VerifyReport(
        store=url,
        cells=manifest.counts.get("computed_cells", 0),
        samples=samples,
        seed=seed,
        approximation=manifest.approximation,
    )
    with Workers(place, workers) as crew:
        parts = _Parts(crew, Silent() if progress is None else progress)
        damaged = _check_checksums(parts, report, find_versions(place.files, manifest))
        if unopened is None:
            readable = _check_sets(parts, report, damaged)
            wanted = cells_to_sample(report.cells) if cells is None else cells
            chosen = readable[_spread(len(readable), wanted)].tolist()
            _check_detail(parts, report, chosen)
            if samples:
                _check_visibility(parts, report, [Sample(cell, samples, seed) for cell in chosen])
        elif report.ok:
            report.checksums.note([unopened])
    report.seconds = time.perf_counter() - began
    return report


def cells_to_sample(computed: int) -> int:
    """How many of a store's computed cells are sampled by default: SHARE of them, from FEWEST to MOST."""
    return min(MOST, max(FEWEST, math.ceil(SHARE * computed)))


def _opened(url: str) -> tuple[Place, str | None]:
    """The store; and what is wrong where its manifest can be read, but not its tables."""
    try:
        store = open_store(url)
    except StoreNotFoundError:
        raise
    except StoreError as error:
        files = Files(url)
        return Place(url, from_bytes(files.read(FILE), f"{files.url}/{FILE}")), str(error)
    return Place(url, store.manifest, store), None


class _Parts:
    """The parts of a check, shared out among workers, while somebody hears how far they are."""

    def __init__(self, workers: Workers, progress: Progress) -> None:
        self.place = workers.place
        self._workers = workers
        self._progress = progress

    def start(self, name: str) -> None:
        """A part begins."""
        self._progress.start(name)

    def each(
        self, function: Callable[[Place, Item], Result], items: Sequence[Item], weights: Sequence[int] | None = None
    ) -> Iterator[Result]:
        """The results of a part's items, in their order; weights: how much of the part each item is."""
        sizes = [1] * len(items) if weights is None else weights
        done, total = 0, sum(sizes)
        self._progress.update(0, total)
        for result, size in zip(self._workers.each(function, items), sizes, strict=True):
            done += size
            self._progress.update(done, total)
            yield result

    def finish(self, note: str, problems: int) -> None:
        """The part is done."""
        self._progress.finish(f"{note}, {problems:,} problem{'s' if problems > 1 else ''}" if problems else note)


def _check_checksums(parts: _Parts, report: VerifyReport, versions: Versions) -> list[bool]:
    """Every manifest and every shard. Returns which of the current version's shards of cells are damaged."""
    parts.start("checksums")
    report.checksums.note(versions.damaged[number] for number in sorted(versions.damaged))
    shards = list(versions.shards().values())
    bad = set()
    for record, problems in zip(shards, parts.each(check_shard, shards), strict=True):
        report.checksums.note(problems)
        if problems:
            bad.add(record.name)
    damaged = [record.name in bad for purpose, record in versions.current.shards() if purpose == "cells"]
    size = sum(record.bytes for record in shards)
    parts.finish(f"{len(shards):,} shards, {size / 1e6:,.1f} MB", report.checksums.count)
    return damaged


def _check_sets(parts: _Parts, report: VerifyReport, damaged: Sequence[bool]) -> NDArray[np.int64]:
    """Every cell's vLOD. Returns the cells (n,) that were computed and do not lie in a damaged shard."""
    parts.start("sets")
    section = parts.place.manifest.cells
    shard_cells = [shard.cells for shard in section.shards] if section else []
    computed = parts.place.store.cells["computed"]
    readable = computed & ~np.repeat(np.asarray(damaged, np.bool_), shard_cells)
    report.unreadable = int(computed.sum()) - int(readable.sum())
    items = list(runs(shard_cells, damaged))
    for found in parts.each(check_run, items, [run.end - run.first for run in items]):
        report.read_cells += found.cells
        report.sets.join(found.problems)
    parts.finish(f"{report.read_cells:,} cells", report.sets.count)
    return np.flatnonzero(readable)


def _check_detail(parts: _Parts, report: VerifyReport, chosen: Sequence[int]) -> None:
    parts.start("detail")
    for problems in parts.each(check_detail, chosen):
        report.detail.join(problems)
    parts.finish(f"{len(chosen):,} cells", report.detail.count)


def _check_visibility(parts: _Parts, report: VerifyReport, samples: Sequence[Sample]) -> None:
    parts.start("rays")
    table = parts.place.store.cells
    for found in parts.each(cast_rays, samples):
        report.visibility.join(found.problems)
        if found.findings is not None:
            report.sampled.append(found.findings)
            report.stored_rays += int(table["hold_out_rays"][found.findings.cell])
            report.stored_missed_rays += int(table["missed_rays"][found.findings.cell])
    parts.finish(f"{report.rays:,} rays", report.visibility.count)


def _spread(count: int, wanted: int) -> NDArray[np.int64]:
    """Up to `wanted` places from 0 to count - 1, evenly apart."""
    return np.unique(np.linspace(0, count - 1, min(count, wanted)).astype(np.int64))
