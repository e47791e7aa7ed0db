"""A stage that no build has: how much of the model each view cell sees. Its file, and a line in the pipeline's list."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jobs.running.arrays import save_array
from jobs.running.tasks import Assignment, Stage, Task
from jobs.stages import cells
from jobs.stages.support.build_state import BuildState, Tasks
from storage.base.typed_json import to_json

STAGE = Stage("toy", "tests.jobs.stages.toy_stage:share", ("tests.jobs.stages.toy_stage",), cure="look away")


@dataclass(frozen=True)
class Payload:
    """What decides the shares."""

    cells: tuple[str, ...]


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    cells: tuple[str, ...]


def tasks(state: BuildState) -> Tasks:
    """One task for all cells."""
    found = cells.finished_cells(state)
    payload = Payload(tuple(result.record["content"] for result in found))
    places = Places(tuple(result.key for result in found))
    return Tasks([Task(STAGE, to_json(payload), to_json(places), 1 << 20)])


def share(work: Assignment) -> dict[str, Any]:
    """The mean share of its cut that a cell reports."""
    _, places = work.read(Payload, Places)
    rows = np.concatenate([np.load(work.place.result(cells.STAGE.name, key) / "cells.npy") for key in places.cells])
    shares = rows["triangles"] / rows["cut_triangles"]
    save_array(work.out / "shares.npy", shares)
    return {"cells": len(shares), "mean": float(shares.mean())}
