"""The work on levels of detail: of leaves that several placements share, of all other nodes, and the tables of all."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.running.arrays import save_array
from jobs.running.tasks import Assignment, content_key, content_of_arrays
from jobs.running.workplace import Workplace
from jobs.stages import NODES, PIECES, SHARED, TABLES
from jobs.stages.model import Shapes, detail_options, imported_model
from storage.base.typed_json import from_json, to_json

if TYPE_CHECKING:
    from jobs.detail.assemble import PlacedNode
    from jobs.detail.leaf import Member
    from jobs.detail.node import Node, Offer
    from jobs.detail.pieces import PieceSet
    from storage.shards.sections import GeometrySection

#: File of a tables task: the manifest's section on geometry.
SECTION = "geometry.json"


def make_shared(work: Assignment) -> dict[str, Any]:
    """Levels of instanced pieces that stay shared, the nodes of all their placements, and what these offer."""
    from jobs.detail.assemble import Placement, place_levels
    from jobs.detail.leaf import SHARED_LEVELS, Member, gather, make_leaf
    from jobs.detail.offers import affordable, save_offers

    model = imported_model(work.place, work.places["import"])
    shapes = Shapes.open(work.place, work.places["hierarchy"])
    pieces = _pieces(work.place, work.places["pieces"])
    crease = _crease(work)
    first = int(shapes.chunk_start[work.payload["chunk"]])
    users = _shared_users(shapes, first, first + len(pieces.pieces))
    instances = np.cumsum(~model.parts["identity"]) - 1
    out = _Output(work)
    offers: list[list[Offer]] = [[] for _ in pieces.pieces]

    def levels() -> Iterator[tuple[int, Node]]:
        for piece, nodes in users.items():
            scale = float(pieces.pieces["scale"][piece])
            patch = gather(model, [Member(pieces, piece, 0, None, 1.0, None)], scale, -1)
            leaf = make_leaf(patch, scale, crease, SHARED_LEVELS)
            offers[piece] = affordable(leaf.offers, len(patch.mesh.triangles), len(nodes))
            parts = shapes.placed["part"][shapes.members[shapes.start[shapes.leaf[nodes]]]].tolist()
            placements = [
                Placement(part, int(instances[part]), model.parts["matrix"][part], float(shapes.stretch[part]))
                for part in parts
            ]
            out.place(nodes, place_levels(leaf.node, placements, model.grid, out.geometries))
            yield 0, leaf.node

    record = out.write(levels())
    save_offers(work.out / "offers.npz", offers)
    return record


def make_nodes(work: Assignment) -> dict[str, Any]:
    """The nodes of a fragment of the tree, from its leaves up to its root, and what the root offers."""
    from jobs.detail.assemble import Placement, place_levels
    from jobs.detail.inner import make_inner
    from jobs.detail.leaf import MOST_LEVELS, Member, gather, make_leaf, place_offer
    from jobs.detail.offers import load_offers, save_offers
    from storage.meshes.placement import IDENTITY

    model = imported_model(work.place, work.places["import"])
    shapes = Shapes.open(work.place, work.places["hierarchy"])
    crease = _crease(work)
    grid = model.grid
    step = grid.step
    objects = shapes.object_of_placed()
    leaves_before: np.ndarray = np.cumsum(shapes.leaf >= 0) - (shapes.leaf >= 0)
    below = dict(zip(work.payload["stops"], work.places["below"], strict=True))
    root = int(work.payload["root"])
    pieces_of = dict(zip(work.payload["chunks"], work.places["pieces"], strict=True))
    shared_of = dict(zip(work.payload["chunks"], work.places["shared"], strict=True))
    out = _Output(work)

    def member(at: int) -> Member:
        row = shapes.placed[at]
        piece, part = int(row["piece"]), int(row["part"])
        chunk = int(np.searchsorted(shapes.chunk_start, piece, side="right")) - 1
        shift = int(shapes.part_start[part]) - int(shapes.mesh_start[model.parts["mesh"][part]])
        shift += int(shapes.chunk_start[chunk])
        return Member(
            _pieces(work.place, pieces_of[chunk]),
            piece - int(shapes.chunk_start[chunk]),
            part,
            None if model.parts["identity"][part] else model.parts["matrix"][part],
            float(shapes.stretch[part]) * (1 + 1e-12),
            lambda pieces: objects[pieces.astype(np.int64) + shift],
        )

    def shared_offers(at: int) -> list[Offer]:
        own = member(at)
        chunk = int(np.searchsorted(shapes.chunk_start, shapes.placed["piece"][at], side="right")) - 1
        offers = _shared_offers(work.place, shared_of[chunk])[own.piece]
        return [place_offer(offer, float(own.set.pieces["scale"][own.piece]), own, step) for offer in offers]

    def add(node: int, made: Node) -> None:
        whole = Placement(_part_of(shapes, node), -1, IDENTITY, 1.0)
        out.place([node], place_levels(made, [whole], grid, out.geometries))

    offered: list[list[Offer]] = []

    def nodes() -> Iterator[tuple[int, Node]]:
        # in postorder, so that only the offers of unfinished branches are held
        todo, kept = [(root, False)], offered
        heights: list[int] = []
        while todo:
            node, ready = todo.pop()
            if node in below and node != root:
                kept.append(load_offers(work.place.result(NODES.name, below[node]) / "offers.npz")[0])
                heights.append(int(work.payload["heights"][work.payload["stops"].index(node)]))
            elif (number := int(shapes.leaf[node])) >= 0:
                own = shapes.members[shapes.start[number] : shapes.start[number + 1]].tolist()
                heights.append(0)
                if shapes.shared[number]:
                    kept.append(shared_offers(own[0]))
                    continue
                patch = gather(model, [member(at) for at in own], step, number)
                leaf = make_leaf(patch, step, crease, MOST_LEVELS)
                kept.append(leaf.offers)
                add(node, leaf.node)
                yield 0, leaf.node
            elif not ready:
                todo += [(node, True), (int(shapes.end[node + 1]), False), (node + 1, False)]
            else:
                children = [kept.pop(), kept.pop()][::-1]
                height = 1 + max(heights.pop(), heights.pop())
                heights.append(height)
                first = int(leaves_before[node])
                last = first + (int(shapes.end[node]) - node) // 2
                inner = make_inner(children, first, last, step, crease, node == 0)
                kept.append(inner.offers)
                add(node, inner.node)
                yield height, inner.node
        out.extra["height"] = heights[0]

    record = out.write(nodes())
    save_offers(work.out / "offers.npz", offered)
    return record


def join_tables(work: Assignment) -> dict[str, Any]:
    """The small tables of all tasks on detail to the model's tables and the manifest's section on geometry."""
    from jobs.detail.assemble import join_nodes
    from storage.geometry_writer import GeometryShardRecord, geometry_section, join_geometry, write_tables_shard
    from storage.model.tables import INSTANCE, PART

    model = imported_model(work.place, work.places["import"])
    shapes = Shapes.open(work.place, work.places["hierarchy"])
    records, chunks = [], []
    for (stage, key), (name, size) in zip(work.places["detail"], work.payload["shards"], strict=True):
        folder = work.place.result(stage, key)
        geometry = np.load(folder / "geometry.npy")
        records.append(GeometryShardRecord(name, size, geometry, np.load(folder / "packs.npy")))
        chunks.append(
            (np.load(folder / "places.npy"), np.load(folder / "nodes.npy"), np.load(folder / "drawables.npy"))
        )
    sizes = [len(record.geometry) for record in records]
    nodes, drawables = join_nodes(np.asarray(shapes.end), chunks, sizes)
    geometry, packs, shards = join_geometry(records)

    triangles = model.meshes["triangles"][model.parts["mesh"]]
    parts = np.zeros(len(model.parts), PART)
    parts["mesh"], parts["faces"] = model.parts["mesh"], triangles
    placed = model.parts["matrix"][~model.parts["identity"]]
    instances = np.zeros(len(placed), INSTANCE)
    instances["matrix"] = placed
    names = [model.names[name] for name in model.parts["name"].tolist()]
    written = write_tables_shard(work.place.store, parts, names, instances, geometry, packs, nodes, drawables)
    section = geometry_section(model.grid.step, written, shards)
    content = to_json(section)
    (work.out / SECTION).write_text(json.dumps(content, sort_keys=True))
    tables = [section.tables.name, section.tables.bytes]
    return {"shards": [tables], "content": content_key(content), "counts": content["counts"]}


def geometry_section_of(place: Workplace, key: str) -> GeometrySection:
    """The manifest's section on geometry, from a tables task."""
    from storage.shards.sections import GeometrySection

    path = place.result(TABLES.name, key) / SECTION
    return from_json(GeometrySection, json.loads(path.read_text()), str(path))


@dataclass
class _Output:
    """Nodes as they are made: where they lie, and their geometry in a shard."""

    work: Assignment
    geometries: int = 0  # meshes placed so far
    places: list[np.ndarray] = field(default_factory=list)
    placed: list[PlacedNode] = field(default_factory=list)
    extra: dict[str, Any] = field(default_factory=dict)

    def place(self, nodes: Sequence[int], placed: Sequence[PlacedNode]) -> None:
        """Notes the nodes that one node's levels, written next, are drawn for, and where."""
        self.places.append(np.asarray(nodes, np.int64))
        self.placed += placed
        self.geometries += len(placed[0].triangles)

    def write(self, made: Iterator[tuple[int, Node]]) -> dict[str, Any]:
        """Writes the levels of all nodes, and the rows; returns the task's record."""
        from jobs.detail.assemble import make_rows
        from storage.geometry_writer import write_geometry_shard

        levels = (
            (
                height,
                [
                    (level.positions, level.triangles, level.normals, level.colours, level.source_faces, node.scale)
                    for level in node.levels
                ],
            )
            for height, node in made
        )
        shard = write_geometry_shard(self.work.place.store, levels)  # type: ignore[arg-type]
        places = np.concatenate([np.zeros(0, np.int64), *self.places])
        nodes, drawables = make_rows(self.placed)
        save_array(self.work.out / "places.npy", places)
        save_array(self.work.out / "nodes.npy", nodes)
        save_array(self.work.out / "drawables.npy", drawables)
        save_array(self.work.out / "geometry.npy", shard.geometry)
        save_array(self.work.out / "packs.npy", shard.packs)
        return {
            "shards": [[shard.name, shard.bytes]],
            "content": content_of_arrays(places, nodes, drawables, shard.geometry, shard.packs),
            **self.extra,
        }


def _crease(work: Assignment) -> float:
    return float(np.cos(np.deg2rad(detail_options(work.payload["options"]).crease_angle)))


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


def _part_of(shapes: Shapes, node: int) -> int:
    """The part that all of a leaf's pieces are of; NO_PART where they are of several, and for inner nodes."""
    from storage.model.tables import NO_PART

    number = int(shapes.leaf[node])
    if number < 0:
        return NO_PART
    parts = shapes.placed["part"][shapes.members[shapes.start[number] : shapes.start[number + 1]]]
    return int(parts[0]) if (parts == parts[0]).all() else NO_PART


@functools.lru_cache(maxsize=64)
def _pieces(place: Workplace, key: str) -> PieceSet:
    from jobs.detail.pieces import open_pieces

    return open_pieces(place.result(PIECES.name, key))


@functools.lru_cache(maxsize=16)
def _shared_offers(place: Workplace, key: str) -> list[list[Offer]]:
    from jobs.detail.offers import load_offers

    return load_offers(place.result(SHARED.name, key) / "offers.npz")
