"""Shared: levels of pieces that several placements share. One task for each chunk of meshes that found pieces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.detail.detail_options import DetailOptions
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task
from jobs.running.workplace import Workplace
from jobs.stages import hierarchy, import_model, pieces
from jobs.stages.hierarchy import Shapes
from jobs.stages.import_model import imported_model
from jobs.stages.pieces import found_pieces
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from jobs.stages.support.written_nodes import MadeNode, crease_cosine, write_nodes
from storage.base.typed_json import to_json

if TYPE_CHECKING:
    from jobs.detail.node import Offer

STAGE = Stage(
    "shared",
    "jobs.stages.shared:make_shared",
    code.SHARED,
    ("numpy", "numba", "zstandard"),
    apart=code.IMPORTERS,
    cure="part the largest mesh in the program that wrote it",
)

#: Bytes for each triangle of a chunk, and for each placement. Measured: 60 a triangle, since pieces are worked on one
#: by one.
PER_TRIANGLE = 300
PER_PLACEMENT = 1000

#: File of a task: what its pieces offer.
OFFERS = "offers.npz"


@dataclass(frozen=True)
class Payload:
    """What decides the shared levels of a chunk's pieces."""

    model: str  # digest
    chunk: int  # its number
    pieces: str  # content of the chunk
    hierarchy: str  # content
    options: DetailOptions


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    model: str  # of the import
    hierarchy: str
    pieces: str


def tasks(state: BuildState) -> Tasks:
    """One task for each chunk."""
    return Tasks(_chunks(state))


def _chunks(state: BuildState) -> Iterator[Task]:
    imported, tree = state.one(import_model.STAGE), state.one(hierarchy.STAGE)
    counts = tree.record["counts"]
    for chunk, found in enumerate(state.all(pieces.STAGE)):
        payload = Payload(
            model=imported.record["model"]["digest"],
            chunk=chunk,
            pieces=found.record["content"],
            hierarchy=tree.record["content"],
            options=state.parameters.detail(),
        )
        places = Places(imported.key, tree.key, found.key)
        memory = (
            PROCESS
            + PER_TRIANGLE * int(found.record["triangles"])
            + PER_PLACEMENT * int(counts["shared"])
            + hierarchy.SHAPES_PER_PIECE * int(counts["pieces"])
        )
        yield Task(STAGE, to_json(payload), to_json(places), memory)


def make_shared(work: Assignment) -> dict[str, Any]:
    """Levels of instanced pieces that stay shared, the nodes of all their placements, and what these offer."""
    from jobs.detail.assemble import Placement
    from jobs.detail.leaf import SHARED_LEVELS, Member, gather, make_leaf
    from jobs.detail.offers import affordable, save_offers

    payload, places = work.read(Payload, Places)
    model = imported_model(work.place, places.model)
    shapes = Shapes.open(work.place, places.hierarchy)
    found = found_pieces(work.place, places.pieces)
    crease = crease_cosine(payload.options)
    first = int(shapes.chunk_start[payload.chunk])
    users = _shared_users(shapes, first, first + len(found.pieces))
    instances = np.cumsum(~model.parts["identity"]) - 1
    offers: list[list[Offer]] = [[] for _ in found.pieces]

    def made() -> Iterator[MadeNode]:
        for piece, nodes in users.items():
            scale = float(found.pieces["scale"][piece])
            patch = gather(model, [Member(found, piece, 0, None, 1.0, None)], scale, -1)
            leaf = make_leaf(patch, scale, crease, SHARED_LEVELS)
            offers[piece] = affordable(leaf.offers, len(patch.mesh.triangles), len(nodes))
            parts = shapes.placed["part"][shapes.members[shapes.start[shapes.leaf[nodes]]]].tolist()
            placements = [
                Placement(part, int(instances[part]), model.parts["matrix"][part], float(shapes.stretch[part]))
                for part in parts
            ]
            yield MadeNode(leaf.node, 0, nodes, placements)

    record = write_nodes(work, model.grid, made())
    save_offers(work.out / OFFERS, offers)
    return record


def _shared_users(shapes: Shapes, first: int, end: int) -> dict[int, list[int]]:
    """For pieces first ... end - 1 that are shared leaves: the nodes that place each, counted from `first`."""
    nodes = np.flatnonzero(shapes.leaf >= 0)
    nodes = nodes[shapes.shared[shapes.leaf[nodes]]]
    piece = shapes.placed["piece"][shapes.members[shapes.start[shapes.leaf[nodes]]]].astype(np.int64)
    own = (piece >= first) & (piece < end)
    users: dict[int, list[int]] = {}
    for at, node in sorted(zip(piece[own].tolist(), nodes[own].tolist(), strict=True)):
        users.setdefault(at - first, []).append(node)
    return users


@lru_cache(maxsize=16)
def shared_offers(place: Workplace, key: str) -> list[list[Offer]]:
    """What the pieces of a chunk offer their parents, of a task; a worker keeps it for its next ones."""
    from jobs.detail.offers import load_offers

    return load_offers(place.result(STAGE.name, key) / OFFERS)
