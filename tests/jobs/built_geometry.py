"""The hierarchy of a model with all its levels, built in process, without any cells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jobs.importing.model import Model, open_model
from jobs.parameters import BuildParameters
from jobs.pipeline import STAGES, run_stages
from jobs.running.executors import SerialExecutor
from jobs.running.memory import MemoryWatch
from jobs.running.run import Run
from jobs.running.tasks import Task, TaskResult
from jobs.running.workplace import Workplace
from jobs.stages import import_model, tables
from jobs.stages.import_model import imported_model
from jobs.stages.support.build_state import BuildState, StageFile
from jobs.stages.support.written_geometry import open_drafted
from storage.base.progress import Silent
from storage.geometry_reader import Geometry
from storage.meshes.placement import transform_points

#: All that comes before cells.
GEOMETRY = STAGES[: STAGES.index(tables) + 1]

Shape = tuple[np.ndarray, np.ndarray]


class Built(NamedTuple):
    """What a build made of a model."""

    model: Model
    geometry: Geometry
    run: Run


def build_geometry(inputs: list[Path], folder: Path, parameters: BuildParameters | None = None) -> Built:
    """Builds everything but the cells of a store in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    state = BuildState(Workplace(folder / "work", folder), inputs, parameters or BuildParameters())
    return _built(state, GEOMETRY)


def build_levels(model: Path, folder: Path, parameters: BuildParameters | None = None) -> Built:
    """The same of a model that was written by `write_model`, which is moved into the work directory of `folder`."""
    state = BuildState(Workplace(folder / "work", folder), [], parameters or BuildParameters())
    stage = import_model.STAGE
    imported = TaskResult(Task(stage, {}), {"model": {"digest": open_model(model).digest}}, 0.0, 0.0, 0, reused=True)
    imported.task.__dict__["key"] = "m"
    state.place.result(stage.name, "m").mkdir(parents=True)
    model.rename(state.place.result(stage.name, "m") / "model")
    state.results[stage.name] = [imported]
    return _built(state, GEOMETRY[1:])


def _built(state: BuildState, stages: Sequence[StageFile]) -> Built:
    with MemoryWatch() as watch:
        run = Run(state.place, SerialExecutor(), Silent(), watch)
        run_stages(stages, run, state)
    model = imported_model(state.place, state.one(import_model.STAGE).key)
    return Built(model, open_drafted(state.place, tables.STAGE.name, state.one(tables.STAGE).key), run)


class Originals:
    """The float64 triangles of the model that nodes stand for, by the source faces of their leaves."""

    def __init__(self, built: Built) -> None:
        self._built = built
        self._kept: dict[int, np.ndarray] = {}
        self._last: tuple[int, Shape] | None = None

    def of(self, node: int) -> Shape:
        """Points (3 m, 3) and triangles (m, 3) of all leaves below a node, or of the leaf itself."""
        if self._last and self._last[0] == node:
            return self._last[1]
        nodes = self._built.geometry.nodes
        end = int(nodes["end"][node])
        leaves = (node + np.flatnonzero(nodes["end"][node:end] == np.arange(node, end) + 1)).tolist()
        corners = np.concatenate([self._leaf(leaf) for leaf in leaves])
        shape = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
        self._last = node, shape
        return shape

    def _leaf(self, leaf: int) -> np.ndarray:
        """(m, 3, 3) corners of a leaf's triangles."""
        if leaf not in self._kept:
            model, geometry = self._built.model, self._built.geometry
            parts, faces = geometry.source_faces(int(geometry.nodes["first_drawable"][leaf]))
            found = []
            for part in np.unique(parts).tolist():
                row = model.parts[part]
                view = model.mesh(int(row["mesh"]))
                rows = np.flatnonzero(np.isin(view.source_faces, faces[parts == part]))
                points = transform_points(row["matrix"], view.positions[view.triangles[rows].reshape(-1)])
                found.append(points.reshape(-1, 3, 3))
            self._kept[leaf] = np.concatenate(found)
        return self._kept[leaf]


def mesh_of(geometry: Geometry, drawable: int) -> Shape:
    """A drawable's float64 positions in model units, exact, and its triangles."""
    surfaces = geometry.surfaces(np.array([drawable]))
    return surfaces.points * np.float64(geometry.grid.step), surfaces.triangles
