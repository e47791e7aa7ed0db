"""Pieces: parts to pieces, no larger than objects may be. One task for each chunk of meshes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from jobs.detail.detail_options import DetailOptions
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, content_of_arrays
from jobs.running.workplace import Workplace
from jobs.stages import import_model
from jobs.stages.import_model import imported_model
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from storage.base.typed_json import to_json

if TYPE_CHECKING:
    from jobs.detail.pieces import PieceSet

STAGE = Stage(
    "pieces",
    "jobs.stages.pieces:find_pieces",
    code.PIECES,
    ("numpy", "numba"),
    apart=code.IMPORTERS,
    cure="part the largest mesh in the program that wrote it",
)

#: Triangles of a task: some seconds of work.
TRIANGLES = 500_000

#: Bytes for each triangle of a chunk. Measured: 190 of small meshes, 290 of one large mesh.
PER_TRIANGLE = 400


@dataclass(frozen=True)
class Payload:
    """What decides the pieces of a chunk."""

    model: str  # digest
    meshes: tuple[int, ...]  # of the model
    options: DetailOptions


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    model: str  # of the import


def tasks(state: BuildState) -> Tasks:
    """Partition I, in chunks of meshes."""
    return Tasks(_chunks(state))


def _chunks(state: BuildState) -> Iterator[Task]:
    from jobs.detail.pieces import plan_chunks

    imported = state.one(import_model.STAGE)
    model = imported_model(state.place, imported.key)
    for meshes in plan_chunks(model, TRIANGLES):
        payload = Payload(
            model=imported.record["model"]["digest"],
            meshes=tuple(int(mesh) for mesh in meshes),
            options=state.parameters.detail(),
        )
        memory = PROCESS + PER_TRIANGLE * int(model.meshes["triangles"][meshes].sum())
        yield Task(STAGE, to_json(payload), to_json(Places(imported.key)), memory)


def find_pieces(work: Assignment) -> dict[str, Any]:
    """Some meshes to pieces, no larger than Partition I allows."""
    from jobs.detail.pieces import make_pieces, save_pieces

    payload, places = work.read(Payload, Places)
    model = imported_model(work.place, places.model)
    found = make_pieces(model, payload.meshes, payload.options)
    save_pieces(work.out, found)
    return {
        "pieces": len(found.pieces),
        "triangles": len(found.faces),
        "content": content_of_arrays(found.pieces, found.faces, found.shading, found.shared_points, found.sharing),
    }


@lru_cache(maxsize=64)
def found_pieces(place: Workplace, key: str) -> PieceSet:
    """The result of a task; a worker keeps it for its next ones."""
    from jobs.detail.pieces import open_pieces

    return open_pieces(place.result(STAGE.name, key))
