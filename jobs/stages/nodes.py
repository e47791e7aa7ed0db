"""Nodes: levels of all nodes that are not shared, from the leaves up. One task for each fragment of a tree.

A fragment's task can be made when those below it are finished: it starts from what their roots offer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jobs.detail.detail_options import DetailOptions
from jobs.objects.fragments import Fragment, plan_fragments
from jobs.running.memory import PROCESS
from jobs.running.tasks import Assignment, Stage, Task, TaskResult
from jobs.running.workplace import Workplace
from jobs.stages import hierarchy, import_model, pieces, shared
from jobs.stages.hierarchy import Shapes
from jobs.stages.import_model import imported_model
from jobs.stages.pieces import found_pieces
from jobs.stages.shared import shared_offers
from jobs.stages.support import code
from jobs.stages.support.build_state import BuildState, Tasks
from jobs.stages.support.written_nodes import MadeNode, crease_cosine, write_nodes
from storage.base.typed_json import to_json

if TYPE_CHECKING:
    from jobs.detail.leaf import Member
    from jobs.detail.node import Node, Offer

STAGE = Stage(
    "nodes",
    "jobs.stages.nodes:make_nodes",
    code.NODES,
    ("numpy", "numba", "zstandard"),
    apart=code.IMPORTERS,
)

#: Triangles that a task works on: some ten seconds of work.
TRIANGLES = 150_000

#: Bytes for each triangle of a fragment. Measured: 600.
PER_TRIANGLE = 1000

#: File of a task: what its root offers.
OFFERS = "offers.npz"


@dataclass(frozen=True)
class Payload:
    """What decides the levels of a fragment's nodes."""

    model: str  # digest
    hierarchy: str  # content
    options: DetailOptions
    root: int  # node
    stops: tuple[int, ...]  # nodes below the root that are roots of other fragments
    heights: tuple[int, ...]  # of the stops
    below: tuple[str, ...]  # contents of the stops' tasks
    chunks: tuple[int, ...]  # of meshes, that the pieces in the fragment's leaves are of
    pieces: tuple[str, ...]  # contents of these chunks
    shared: tuple[str, ...]  # and of what is shared of them


@dataclass(frozen=True)
class Places:
    """Keys of the tasks whose results are read."""

    model: str  # of the import
    hierarchy: str
    below: tuple[str, ...]
    pieces: tuple[str, ...]
    shared: tuple[str, ...]


def tasks(state: BuildState) -> Tasks:
    """The tasks that wait for no other, and those above them once they are finished."""
    plan = _Plan(state)
    return Tasks(plan.first(), plan.followers_of)


class _Plan:
    """Which fragments there are, and which of them are finished."""

    def __init__(self, state: BuildState) -> None:
        self._imported, self._tree = state.one(import_model.STAGE), state.one(hierarchy.STAGE)
        self._pieces, self._shared = state.all(pieces.STAGE), state.all(shared.STAGE)
        self._options = state.parameters.detail()
        shapes = Shapes.open(state.place, self._tree.key)
        triangles = np.zeros(len(shapes.end), np.int64)
        leaves = np.flatnonzero(shapes.leaf >= 0)
        counts = shapes.placed["triangles"][shapes.members].astype(np.int64)
        triangles[leaves] = np.add.reduceat(counts, shapes.start[:-1])[shapes.leaf[leaves]]
        self._fragments = plan_fragments(shapes.end, shapes.roots, triangles, TRIANGLES)
        self._above = {stop: fragment.root for fragment in self._fragments for stop in fragment.stops}
        self._by_root = {fragment.root: fragment for fragment in self._fragments}
        self._chunks = chunks_of_fragments(shapes, self._fragments)
        self._finished: dict[int, TaskResult] = {}

    def first(self) -> Iterator[Task]:
        """The tasks that wait for no other."""
        return (self._task(fragment) for fragment in self._fragments if not fragment.stops)

    def followers_of(self, result: TaskResult) -> list[Task]:
        """The tasks that can be made now that one more is finished."""
        root = int(result.task.payload["root"])
        self._finished[root] = result
        above = self._above.get(root)
        if above is None or not all(stop in self._finished for stop in self._by_root[above].stops):
            return []
        return [self._task(self._by_root[above])]

    def _task(self, fragment: Fragment) -> Task:
        below = [self._finished[stop] for stop in fragment.stops]
        chunks = self._chunks[fragment.root]
        found, offered = [self._pieces[chunk] for chunk in chunks], [self._shared[chunk] for chunk in chunks]
        payload = Payload(
            model=self._imported.record["model"]["digest"],
            hierarchy=self._tree.record["content"],
            options=self._options,
            root=fragment.root,
            stops=tuple(fragment.stops),
            heights=tuple(int(result.record["height"]) for result in below),
            below=tuple(result.record["content"] for result in below),
            chunks=tuple(chunks),
            pieces=tuple(result.record["content"] for result in found),
            shared=tuple(result.record["content"] for result in offered),
        )
        places = Places(
            model=self._imported.key,
            hierarchy=self._tree.key,
            below=tuple(result.key for result in below),
            pieces=tuple(result.key for result in found),
            shared=tuple(result.key for result in offered),
        )
        memory = (
            PROCESS
            + hierarchy.SHAPES_PER_PIECE * int(self._tree.record["counts"]["pieces"])
            + PER_TRIANGLE * fragment.triangles
        )
        return Task(STAGE, to_json(payload), to_json(places), memory)


def chunks_of_fragments(shapes: Shapes, fragments: Sequence[Fragment]) -> dict[int, list[int]]:
    """For the root of each fragment: the chunks of meshes, increasing, that the pieces in its own leaves are of."""
    counts = np.diff(shapes.start)
    chunk = np.searchsorted(shapes.chunk_start, shapes.placed["piece"][shapes.members], side="right") - 1
    owner = np.empty(len(shapes.end), np.int64)
    for number in range(len(fragments) - 1, -1, -1):  # those above others first
        root = fragments[number].root
        owner[root : int(shapes.end[root])] = number
    leaves = np.flatnonzero(shapes.leaf >= 0)
    of_leaf = np.empty(len(counts), np.int64)
    of_leaf[shapes.leaf[leaves]] = owner[leaves]
    pairs = np.unique(np.stack([np.repeat(of_leaf, counts), chunk], axis=1), axis=0)
    found: dict[int, list[int]] = {fragment.root: [] for fragment in fragments}
    for number, used in pairs.tolist():
        found[fragments[number].root].append(used)
    return found


def make_nodes(work: Assignment) -> dict[str, Any]:
    """The nodes of a fragment of a tree, from its leaves up to its root, and what the root offers."""
    from jobs.detail.offers import save_offers

    fragment = _Fragment(work.place, *work.read(Payload, Places))
    record = write_nodes(work, fragment.grid, fragment.made())
    (root,) = fragment.waiting
    save_offers(work.out / OFFERS, [root.offers])
    return {**record, "height": root.height}


class _Branch(NamedTuple):
    """A finished branch of a tree, as its parent sees it."""

    offers: list[Offer]
    height: int  # 0: a leaf


class _Fragment:
    """The nodes of one task, made one after the other."""

    def __init__(self, place: Workplace, payload: Payload, places: Places) -> None:
        self.waiting: list[_Branch] = []  # finished branches whose parents are not; at the end the root's alone
        self._place, self._root = place, payload.root
        self._model = imported_model(place, places.model)
        self.grid = self._model.grid
        self._shapes = Shapes.open(place, places.hierarchy)
        self._tops = frozenset(self._shapes.roots.tolist())
        self._crease = crease_cosine(payload.options)
        self._objects = self._shapes.object_of_placed()
        self._leaves_before: np.ndarray = np.cumsum(self._shapes.leaf >= 0) - (self._shapes.leaf >= 0)
        self._below = dict(zip(payload.stops, zip(places.below, payload.heights, strict=True), strict=True))
        self._pieces_of = dict(zip(payload.chunks, places.pieces, strict=True))
        self._shared_of = dict(zip(payload.chunks, places.shared, strict=True))

    def made(self) -> Iterator[MadeNode]:
        """All nodes that the task makes, children before parents: only unfinished branches' offers are held."""
        for node in self._postorder():
            levels: Node | None = None
            if node in self._below:
                branch = self.below(node)
            elif self._shapes.leaf[node] >= 0:
                branch, levels = self.leaf(node)
            else:
                branch, levels = self.inner(node, right=self.waiting.pop(), left=self.waiting.pop())
            self.waiting.append(branch)
            if levels is not None:
                yield MadeNode.whole(levels, branch.height, node, self._part_of(node))

    def below(self, node: int) -> _Branch:
        """A branch that another task has finished."""
        from jobs.detail.offers import load_offers

        key, height = self._below[node]
        (offers,) = load_offers(self._place.result(STAGE.name, key) / OFFERS)
        return _Branch(offers, height)

    def leaf(self, node: int) -> tuple[_Branch, Node | None]:
        """A leaf and its levels; None where they are shared, and made already."""
        from jobs.detail.leaf import MOST_LEVELS, gather, make_leaf

        number = int(self._shapes.leaf[node])
        own = self._members_of(number)
        if self._shapes.shared[number]:
            return _Branch(self._shared_offers(own[0]), 0), None
        patch = gather(self._model, [self._member(at) for at in own], self.grid.step, number)
        leaf = make_leaf(patch, self.grid.step, self._crease, MOST_LEVELS)
        return _Branch(leaf.offers, 0), leaf.node

    def inner(self, node: int, left: _Branch, right: _Branch) -> tuple[_Branch, Node]:
        """A node above two branches, and its levels."""
        from jobs.detail.inner import make_inner

        first = int(self._leaves_before[node])
        last = first + (int(self._shapes.end[node]) - node) // 2
        inner = make_inner([left.offers, right.offers], first, last, self.grid.step, self._crease, node in self._tops)
        return _Branch(inner.offers, 1 + max(left.height, right.height)), inner.node

    def _postorder(self) -> Iterator[int]:
        """The fragment's nodes and the roots below it, left before right before their parent."""
        order, todo = [], [self._root]
        while todo:
            node = todo.pop()
            order.append(node)
            if node not in self._below and self._shapes.leaf[node] < 0:
                todo += [node + 1, int(self._shapes.end[node + 1])]
        return reversed(order)

    def _members_of(self, number: int) -> list[int]:
        """The placed pieces of an object."""
        members: list[int] = self._shapes.members[self._shapes.start[number] : self._shapes.start[number + 1]].tolist()
        return members

    def _part_of(self, node: int) -> int:
        """The part that all of a leaf's pieces are of; NO_PART where they are of several, and for inner nodes."""
        from storage.model.tables import NO_PART

        number = int(self._shapes.leaf[node])
        if number < 0:
            return NO_PART
        parts = self._shapes.placed["part"][self._members_of(number)]
        return int(parts[0]) if (parts == parts[0]).all() else NO_PART

    def _chunk_of(self, at: int) -> int:
        """The chunk of meshes that a placed piece is of."""
        return int(np.searchsorted(self._shapes.chunk_start, self._shapes.placed["piece"][at], side="right")) - 1

    def _member(self, at: int) -> Member:
        """A placed piece as a leaf gathers it."""
        from jobs.detail.leaf import Member

        shapes, parts = self._shapes, self._model.parts
        piece, part = int(shapes.placed["piece"][at]), int(shapes.placed["part"][at])
        chunk = self._chunk_of(at)
        shift = int(shapes.part_start[part]) - int(shapes.mesh_start[parts["mesh"][part]])
        shift += int(shapes.chunk_start[chunk])
        return Member(
            found_pieces(self._place, self._pieces_of[chunk]),
            piece - int(shapes.chunk_start[chunk]),
            part,
            None if parts["identity"][part] else parts["matrix"][part],
            float(shapes.stretch[part]) * (1 + 1e-12),
            lambda pieces: self._objects[pieces.astype(np.int64) + shift],
        )

    def _shared_offers(self, at: int) -> list[Offer]:
        """What a placed piece with shared levels offers, where it is placed."""
        from jobs.detail.leaf import place_offer

        own = self._member(at)
        scale = float(own.set.pieces["scale"][own.piece])
        offers = shared_offers(self._place, self._shared_of[self._chunk_of(at)])[own.piece]
        return [place_offer(offer, scale, own, self.grid.step) for offer in offers]
