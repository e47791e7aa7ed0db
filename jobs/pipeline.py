"""The job from end to end: model files in, a store out.

    import      model files to parts                                  one task
    pieces      parts to pieces, no larger than objects may be        one task for each chunk of meshes
    hierarchy   pieces to objects, and the tree above them            one task
    shared      levels of what is placed several times                one task for each chunk of meshes
    nodes       levels of all other nodes, from the leaves up         one task for each fragment of the tree
    tables      nodes and drawables of the whole model                one task
    cells       what can be seen from each view cell                  waves of subtrees of the octree
    layout      the order of all cells, and which share a face        one task
    shards      what can be seen from the cells, in cell shards       one task for each subtree
    order       the sequence in which meshes lie                      one task
    packs       meshes in that sequence, in geometry shards           one task for each shard
    index       where each mesh lies: the tables of the store         one task

and at last the manifest. Until then readers see the former version of the store, or none. Whatever order tasks finish
in, the results are put together in the order of their keys: the same model and parameters give the same bytes.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from jobs.cells.task_keys import count_cells
from jobs.parameters import BuildParameters
from jobs.report.build_report import BuildReport
from jobs.running.executors import Executor
from jobs.running.memory import TASK_MEMORY, MemoryWatch
from jobs.running.run import Run
from jobs.running.tasks import TaskResult
from jobs.running.workplace import Workplace
from jobs.stages import (
    cells,
    hierarchy,
    import_model,
    layout,
    nodes,
    pieces,
    shards,
    shared,
    tables,
)
from jobs.stages.packing import index, order, packs
from jobs.stages.support.build_state import BuildState, StageFile
from jobs.stages.support.written_geometry import geometry_section_of
from storage.base.errors import ParameterError
from storage.base.progress import Progress, Silent
from storage.base.typed_json import from_json
from storage.shards.manifest import Manifest, commit, current
from storage.shards.sections import ModelSection
from storage.versions import content_of
from storage.vlod_writer import cells_section

#: The stages of a build in their order. Another one is a file in `jobs.stages`, imported above and named here.
STAGES: tuple[StageFile, ...] = (
    import_model,
    pieces,
    hierarchy,
    shared,
    nodes,
    tables,
    cells,
    layout,
    shards,
    order,
    packs,
    index,
)


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
    memory: that a task may need, in bytes, which changes no result but that of cells which it is too small to look at.
    May be interrupted or killed at any moment; the same call again goes on where it was. What is refused for its inputs
    or for where its cells would lie leaves nothing behind. Raises ModelError,
    ParameterError, JobError, StoreError where the former version cannot be read, and OSError where files cannot be
    written.
    """
    began = time.perf_counter()
    angle = parameters.pixel_angle()
    place = Workplace((work or store / "work").absolute(), store.absolute())
    for path in (place.store, place.work):
        if path.exists() and not path.is_dir():
            raise ParameterError(f"{path} is a file: name a directory, new or of an earlier build")
    current(place.store)  # what the build will be the next version of: better to know now that it cannot be
    with place.made(), place.locked(), place.cleaned(), MemoryWatch() as watch:
        run = Run(place, executor, progress or Silent(), watch, memory)
        state = BuildState(place, inputs, parameters, memory)
        first, *later = STAGES
        run_stages((first,), run, state)
        imported = state.one(import_model.STAGE)
        _check_view_space(state, imported)
        _tell_cells(state, imported, run)
        run_stages(later, run, state)

        manifest = Manifest(
            model=from_json(ModelSection, imported.record["model"], "the model"),
            pixel_angle=angle,
            parameters=parameters.to_json(),
            geometry=geometry_section_of(place, index.STAGE.name, state.one(index.STAGE).key),
            cells=cells_section(place.store, state.view_space(imported).octree, shards.written_shards(state)),
        )
        place.note(content_of(manifest), {name: [done.key for done in all_] for name, all_ in state.results.items()})
        version = commit(place.store, manifest)
    return BuildReport(
        store=str(store),
        version=version,
        model=dict(imported.record["model"]),
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


def run_stages(stages: Iterable[StageFile], run: Run, state: BuildState) -> None:
    """Runs stages in their order; their results join the state."""
    for stage in stages:
        found = stage.tasks(state)
        state.results[stage.STAGE.name] = run.all(stage.STAGE, found.first, found.followers_of, found.waves_after)


def _check_view_space(state: BuildState, imported: TaskResult) -> None:
    """Raises ParameterError where no cells can be, as soon as the model's box is known, and takes this import back."""
    try:
        state.view_space(imported)
    except ParameterError:
        if not imported.reused:
            state.place.forget(import_model.STAGE.name, imported.key)
        raise


def _tell_cells(state: BuildState, imported: TaskResult, run: Run) -> None:
    """Says how many cells there will be, where that is known beforehand."""
    space = state.view_space(imported)
    if state.parameters.cell_size is not None:
        run.progress.start("view space")
        edge = space.octree.size / 2**space.max_depth
        run.progress.finish(f"{count_cells(space.octree, space.lo, space.hi, space.max_depth):,} cells of {edge:g}")


def _shard_bytes(manifest: Manifest) -> dict[str, int]:
    sizes = {"tables": 0, "geometry": 0, "cells": 0}
    for purpose, shard in {shard.name: (purpose, shard) for purpose, shard in manifest.shards()}.values():
        sizes["cells" if purpose.startswith("cell") else purpose] += shard.bytes
    return {**sizes, "total": sum(sizes.values())}
