"""The node tree multiplied out: where each mesh is placed, instances included.

glTF 2.0, section 3.5; EXT_mesh_gpu_instancing; KHR_node_visibility. Nodes form a tree of any depth; one that is reached
a second time, by a cycle say, is counted and not followed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from jobs.importing.formats.gltf.accessors import Accessors, at
from jobs.importing.formats.gltf.header import INSTANCING, VISIBILITY, Json, name_of, unread_extensions
from jobs.importing.formats.gltf.poses import Poses, under
from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.source_scene import SourceNode
from storage.meshes.placement import IDENTITY

#: Attributes of instances, how many numbers each has, and what it is where it is absent.
_ATTRIBUTES = {"TRANSLATION": (0.0, 0.0, 0.0), "ROTATION": (0.0, 0.0, 0.0, 1.0), "SCALE": (1.0, 1.0, 1.0)}


def placements(poses: Poses, mesh_of: Callable[[int], tuple[int, bool] | None], tally: Tally) -> list[SourceNode]:
    """All placements of meshes in the file's scene, depth first.

    `mesh_of` a node's number: the mesh that it places, and whether a skin places it whatever the node; None for none.
    """
    header = poses.accessors.header
    mesh_names: dict[int | None, str] = {
        n: mesh["name"] for n, mesh in enumerate(header.get("meshes", ())) if mesh.get("name")
    }
    placed: list[SourceNode] = []
    seen: set[int] = set()
    stack = [(number, IDENTITY) for number in reversed(_roots(header))]
    while stack:
        number, parent = stack.pop()
        node = poses.nodes[at(number)]
        name = name_of(node, mesh_names.get(node.get("mesh"), f"node {number}"))
        if number in seen:
            tally.add(Defect.BROKEN, name)
            continue
        seen.add(number)
        extensions = node.get("extensions", {})
        if extensions.get(VISIBILITY, {}).get("visible") is False:
            tally.add(Defect.HIDDEN, name)
            continue
        matrix = under(parent, poses.local(number))
        if extensions:
            tally.add(Defect.UNSUPPORTED, name, len(unread_extensions(node)))
        mesh = mesh_of(number)
        if mesh is not None:
            index, is_posed = mesh
            instances = None if is_posed else extensions.get(INSTANCING)
            if instances is None:
                placed.append(SourceNode(index, name, IDENTITY if is_posed else matrix))
            else:
                matrices = _instances(poses.accessors, instances)
                if matrices is None:
                    tally.add(Defect.BROKEN, name)
                else:
                    placed.extend(SourceNode(index, name, under(matrix, instance)) for instance in matrices)
        stack.extend((child, matrix) for child in reversed(node.get("children", ())))
    return placed


def _roots(header: Json) -> list[int]:
    """The nodes at the top of the scene that a file shows."""
    if header.get("scenes"):
        roots: list[int] = header["scenes"][at(header.get("scene", 0))].get("nodes", [])
        return roots
    nodes = header.get("nodes", ())
    children = {child for node in nodes for child in node.get("children", ())}
    return [number for number in range(len(nodes)) if number not in children]


def _instances(accessors: Accessors, entry: Json) -> np.ndarray | None:
    """The (k, 3, 4) matrices of a node's instances, None if their attributes do not fit together."""
    given = entry.get("attributes", {})
    columns = {name: accessors.floats(given[name]) for name in _ATTRIBUTES if name in given}
    counts = {len(column) for column in columns.values()} or {accessors.count(number) for number in given.values()}
    if len(counts) != 1 or any(column.shape[1] != len(_ATTRIBUTES[name]) for name, column in columns.items()):
        return None
    count = counts.pop()
    shift, turn, scale = (columns.get(name, np.tile(plain, (count, 1))) for name, plain in _ATTRIBUTES.items())
    length = np.sqrt(((turn[:, 0] ** 2 + turn[:, 1] ** 2) + turn[:, 2] ** 2) + turn[:, 3] ** 2)
    x, y, z, w = (turn / np.where(length > 0, length, 1.0)[:, None]).T
    matrices = np.empty((count, 3, 4))
    matrices[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    matrices[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    matrices[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    matrices[:, :, :3] *= scale[:, None, :]
    matrices[:, :, 3] = shift
    return matrices


def count_instances(header: Json) -> int:
    """How many instances nodes place."""
    return sum(
        max((int(header["accessors"][number]["count"]) for number in entry["attributes"].values()), default=0)
        for node in header.get("nodes", ())
        if (entry := node.get("extensions", {}).get(INSTANCING)) is not None
    )
