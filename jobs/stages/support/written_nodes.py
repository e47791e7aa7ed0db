"""The levels of nodes as they are made, to a draft of a shard and to rows: what shared and nodes share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jobs.detail.detail_options import DetailOptions
from jobs.running.arrays import save_array
from jobs.running.tasks import Assignment, content_of_arrays

if TYPE_CHECKING:
    from jobs.detail.assemble import PlacedNode, Placement
    from jobs.detail.node import Node
    from storage.meshes.pack import MeshArrays
    from storage.model.tables import Grid


class MadeNode(NamedTuple):
    """The levels of a node, and what they are drawn for."""

    levels: Node
    height: int  # of the node; 0: a leaf
    nodes: Sequence[int]  # of the tree: those that share the levels
    placements: Sequence[Placement]  # of each of them

    @staticmethod
    def whole(levels: Node, height: int, node: int, part: int) -> MadeNode:
        """A node that shares its levels with no other, and lies where the model's coordinates say."""
        from jobs.detail.assemble import Placement
        from storage.meshes.placement import IDENTITY

        return MadeNode(levels, height, [node], [Placement(part, -1, IDENTITY, 1.0)])


def write_nodes(work: Assignment, grid: Grid, made: Iterable[MadeNode]) -> dict[str, Any]:
    """Writes the levels of nodes, as they come, into a shard, and the rows of all of them; returns a task's record."""
    from jobs.detail.assemble import make_rows, place_levels
    from storage.geometry_writer import write_geometry_shard

    places: list[np.ndarray] = []
    placed: list[PlacedNode] = []

    def meshes() -> Iterator[tuple[int, list[MeshArrays]]]:
        geometries = 0
        for node in made:
            places.append(np.asarray(node.nodes, np.int64))
            placed.extend(place_levels(node.levels, node.placements, grid, geometries))
            geometries += len(node.levels.levels)
            yield node.height, _meshes_of(node.levels)

    shard = write_geometry_shard(work.place.drafts, meshes())
    joined = np.concatenate([np.zeros(0, np.int64), *places])
    nodes, drawables = make_rows(placed)
    save_array(work.out / "places.npy", joined)
    save_array(work.out / "nodes.npy", nodes)
    save_array(work.out / "drawables.npy", drawables)
    save_array(work.out / "geometry.npy", shard.geometry)
    save_array(work.out / "packs.npy", shard.packs)
    return {
        "drafts": [[shard.name, shard.bytes]],
        "content": content_of_arrays(joined, nodes, drawables, shard.geometry, shard.packs),
    }


def crease_cosine(options: DetailOptions) -> float:
    """The cosine of the sharpest angle between faces that is smoothed."""
    return float(np.cos(np.deg2rad(options.crease_angle)))


def _meshes_of(node: Node) -> list[MeshArrays]:
    from storage.meshes.pack import MeshArrays

    return [
        MeshArrays(level.positions, level.triangles, level.normals, level.colours, level.source_faces, node.scale)
        for level in node.levels
    ]
