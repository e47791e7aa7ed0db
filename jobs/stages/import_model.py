"""Import: model files to parts. One task."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jobs.importing.inputs import content_of
from jobs.running.tasks import Assignment, Stage, Task
from jobs.running.workplace import Workplace
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from storage.base.typed_json import to_json

if TYPE_CHECKING:
    from jobs.importing.model import Model

STAGE = Stage(
    "import",
    "jobs.stages.import_model:import_files",
    code.IMPORT,
    ("dracopy", "mapbox-earcut", "meshopt", "numba", "numpy", "pillow"),
    cure="part the largest mesh, or the file, in the program that wrote it",
)

#: What a process holds that does nothing but import, in bytes. Measured: 100 MiB.
PROCESS = 200 << 20


@dataclass(frozen=True)
class Payload:
    """What decides an imported model."""

    files: tuple[tuple[str, str], ...]  # name and hash of each
    names: tuple[str, ...]  # of the inputs
    units: str | None  # see jobs.importing.model.ImportOptions
    up: str | None
    keep_far: bool


@dataclass(frozen=True)
class Places:
    """Where the model lies."""

    inputs: tuple[str, ...]


def tasks(state: BuildState) -> Tasks:
    """The task, keyed by the content of the model's files. Raises ModelError for inputs that name no model."""
    from jobs.importing.import_memory import import_memory

    parameters = state.parameters
    payload = Payload(
        files=tuple((name, digest) for name, digest in content_of(state.inputs)),
        names=tuple(path.name for path in state.inputs),
        units=parameters.units,
        up=parameters.up,
        keep_far=parameters.keep_far,
    )
    places = Places(tuple(str(path.absolute()) for path in state.inputs))
    return Tasks([Task(STAGE, to_json(payload), to_json(places), PROCESS + import_memory(state.inputs))])


def import_files(work: Assignment) -> dict[str, Any]:
    """Model files to parts."""
    from jobs.importing.model import ImportOptions, import_model, open_model

    payload, places = work.read(Payload, Places)
    options = ImportOptions(units=payload.units, up=payload.up, keep_far=payload.keep_far)
    import_model([Path(path) for path in places.inputs], work.out / "model", options)
    model = open_model(work.out / "model")
    return {
        "model": {
            "digest": model.digest,
            "triangles": int(model.triangle_count),
            "lo": [float(value) for value in model.lo],
            "hi": [float(value) for value in model.hi],
            "origin": [float(value) for value in model.origin],
            "up": model.up,
            "unit_in_metres": model.unit_in_metres,
        },
        "repairs": dict(model.report),
    }


def imported_model(place: Workplace, key: str) -> Model:
    """The result of an import task."""
    from jobs.importing.model import open_model

    return open_model(place.result(STAGE.name, key) / "model")
