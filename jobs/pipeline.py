"""The job from end to end: model files in, a store out.

    import      model files to parts                                  one task
    pieces      parts to pieces, no larger than objects may be        one task for each chunk of meshes
    hierarchy   pieces to objects, and the tree above them            one task
    shared      levels of what is placed several times                one task for each chunk of meshes
    nodes       levels of all other nodes, from the leaves up         one task for each fragment of the tree
    tables      nodes and drawables of the whole model                one task
    cells       what can be seen from each view cell                  waves of subtrees of the octree
    layout      the order of all cells, and which share a face        one task
    shards      vLODs and the changes across faces, in cell shards    one task for each subtree

and at last the manifest. Until then readers see the former version of the store, or none. Whatever order tasks finish
in, the results are put together in the order of their keys: the same model and parameters give the same bytes.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from jobs import plan, stages
from jobs.parameters import BuildParameters, view_space
from jobs.report.build_report import BuildReport, StageReport
from jobs.running.executors import Executor, Then, no_more
from jobs.running.memory import TASK_MEMORY, MemoryWatch
from jobs.running.tasks import Stage, Task, TaskResult, find_finished
from jobs.running.workplace import Workplace
from jobs.stages.detail import geometry_section_of
from storage.base.errors import ParameterError
from storage.base.progress import Progress, Silent
from storage.base.typed_json import from_json
from storage.model.cut import pixel_angle
from storage.shards.manifest import Manifest, commit, current
from storage.shards.sections import CellShardRecord, ModelSection
from storage.vlod_writer import cells_section


def build(
    inputs: Sequence[Path],
    store: Path,
    parameters: BuildParameters,
    executor: Executor,
    progress: Progress | None = None,
    work: Path | None = None,
    memory: int = TASK_MEMORY,
) -> BuildReport:
    """Builds a store, or its next version, from model files.

    inputs: files or folders; work: directory for tasks' results on the same file system, `store`/work by default;
    memory: that a task may need, in bytes, which changes no result.
    May be interrupted or killed at any moment; the same call again goes on where it was. Raises ModelError,
    ParameterError, JobError, StoreError where the former version cannot be read, and OSError where files cannot be
    written.
    """
    began = time.perf_counter()
    angle = pixel_angle(parameters.screen_height, parameters.field_of_view)
    place = Workplace((work or store / "work").absolute(), store.absolute())
    for path in (place.store, place.work):
        if path.exists() and not path.is_dir():
            raise ParameterError(f"{path} is a file: name a directory, new or of an earlier build")
    current(place.store)  # what the build will be the next version of: better to know now that it cannot be
    with place.made(), place.locked(), place.cleaned(), MemoryWatch() as watch:
        run = Run(place, executor, progress or Silent(), watch, memory)

        imported, tables = make_geometry(run, inputs, parameters)
        model = imported.record["model"]
        lo, hi, origin = (np.asarray(model[name], np.float64) for name in ("lo", "hi", "origin"))
        space = view_space(parameters, lo, hi, origin)

        cell_parameters = plan.cell_parameters(parameters, space, angle)
        subtrees = plan.CellsPlan(tables, cell_parameters)
        waves = run.all(stages.CELLS, [subtrees.first(place)], subtrees.then)
        cells = sorted(
            (wave for wave in waves if wave.record["cells"]), key=lambda wave: int(wave.task.payload["root"])
        )
        if not cells:
            raise ParameterError("no view cell lies in the view space: choose a larger --view-box or --region")
        layout = run.one(plan.layout_task(cells))
        shards = run.all(stages.SHARDS, plan.shard_tasks(place, layout, cells))

        written = []
        for shard in shards:
            ((name, size),) = shard.record["shards"]
            written.append(CellShardRecord(name, size, shard.record["cells"], shard.record["codec"]))
        manifest = Manifest(
            model=from_json(ModelSection, model, "the model"),
            pixel_angle=angle,
            parameters=parameters.to_json(),
            geometry=geometry_section_of(place, tables.key),
            cells=cells_section(place.store, space.octree, written),
        )
        version = commit(place.store, manifest)
    return BuildReport(
        store=str(store),
        version=version,
        model=dict(model),
        repairs=dict(imported.record["repairs"]),
        parameters=parameters.to_json(),
        executor=executor.name,
        workers=executor.workers,
        counts=dict(manifest.counts),
        bytes=_shard_bytes(manifest),
        seconds=round(time.perf_counter() - began, 3),
        peak_memory=max(stage.peak_memory for stage in run.reports),
        stages=tuple(run.reports),
    )


def make_geometry(run: Run, inputs: Sequence[Path], parameters: BuildParameters) -> tuple[TaskResult, TaskResult]:
    """Model files to the hierarchy with all its levels: the results of the import and of the tables."""
    imported = run.one(plan.import_task(inputs, parameters))
    return imported, make_levels(run, imported, parameters)


def make_levels(run: Run, imported: TaskResult, parameters: BuildParameters) -> TaskResult:
    """An imported model to the hierarchy with all its levels: the result of the tables."""
    pieces = run.all(stages.PIECES, plan.pieces_tasks(run.place, imported, parameters))
    hierarchy = run.one(plan.hierarchy_task(imported, pieces, parameters))
    shared = run.all(stages.SHARED, plan.shared_tasks(imported, pieces, hierarchy, parameters))
    fragments = plan.NodesPlan(run.place, imported, pieces, hierarchy, shared, parameters)
    nodes = run.all(stages.NODES, fragments.first(), fragments.then)
    in_tree = sorted(nodes, key=lambda result: int(result.task.payload["root"]))
    return run.one(plan.tables_task(imported, hierarchy, [*shared, *in_tree]))


class Run:
    """Runs stages one after the other and notes what they took."""

    def __init__(
        self, place: Workplace, executor: Executor, progress: Progress, watch: MemoryWatch, memory: int = TASK_MEMORY
    ) -> None:
        """memory: that a task may need, in bytes."""
        self.memory = memory
        self.place = place
        self.executor = executor
        self.progress = progress
        self.watch = watch
        self.reports: list[StageReport] = []

    def one(self, task: Task) -> TaskResult:
        """The result of a stage of one task."""
        return self.all(task.stage, [task])[0]

    def all(self, stage: Stage, tasks: Iterable[Task], then: Then = no_more) -> list[TaskResult]:
        """The results of a stage's tasks: first those of `tasks` in their order, then those that followed, by key.

        Raises MemoryLimitError for a task that would need too much memory, before it begins.
        """
        given = list(tasks)
        self._check(given)
        known = len(given)
        began = time.perf_counter()
        self.watch.restart()
        self.progress.start(stage.name)
        self.progress.update(0, known)

        def follow(result: TaskResult) -> list[Task]:
            nonlocal known
            more = list(then(result))
            self._check(more)
            known += len(more)
            return more

        results: dict[str, TaskResult] = {}
        with contextlib.closing(self.executor.run(given, self.place, follow)) as finished:
            for result in finished:
                results[result.key] = result
                self.progress.update(len(results), known)
        report = _stage_report(stage, list(results.values()), time.perf_counter() - began, self.watch.restart())
        self.reports.append(report)
        reused = f", {report.reused} finished before" if report.reused else ""
        self.progress.finish(f"{len(results)} task{'s' if len(results) != 1 else ''}{reused}")
        ordered = [results.pop(task.key) for task in given]
        return ordered + [results[key] for key in sorted(results)]

    def _check(self, tasks: Iterable[Task]) -> None:
        for task in tasks:
            if task.memory > self.memory and find_finished(task, self.place) is None:
                raise plan.too_large(task, self.memory)


def _stage_report(stage: Stage, results: Sequence[TaskResult], seconds: float, peak: int) -> StageReport:
    return StageReport(
        name=stage.name,
        run=sum(not result.reused for result in results),
        reused=sum(result.reused for result in results),
        seconds=round(seconds, 3),
        core_seconds=round(sum(result.core_seconds for result in results), 3),
        peak_memory=peak,
        peak_task_memory=max((result.peak_memory for result in results), default=0),
        shard_bytes=sum(size for result in results for _, size in result.record.get("shards", ())),
    )


def _shard_bytes(manifest: Manifest) -> dict[str, int]:
    sizes = {"tables": 0, "geometry": 0, "cells": 0}
    for purpose, shard in manifest.shards():
        sizes["cells" if purpose.startswith("cell") else purpose] += shard.bytes
    return {**sizes, "total": sum(sizes.values())}
