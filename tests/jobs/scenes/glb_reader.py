"""A small reader of GLB files for tests, sharing no code with the writer."""

from __future__ import annotations

import json
import struct
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

COMPONENTS: dict[int, np.dtype[Any]] = {5126: np.dtype("<f4"), 5123: np.dtype("<u2"), 5125: np.dtype("<u4")}
WIDTHS = {"SCALAR": 1, "VEC3": 3}


class Glb:
    """The JSON and the data of a GLB file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        raw = path.read_bytes()
        self.header = struct.unpack("<4sIII4s", raw[:20])
        json_bytes = self.header[3]
        self.json: dict[str, Any] = json.loads(raw[20 : 20 + json_bytes])
        self.data_header = struct.unpack("<I4s", raw[20 + json_bytes : 28 + json_bytes])
        self.data = raw[28 + json_bytes :]

    def accessor(self, index: int) -> np.ndarray:
        accessor = self.json["accessors"][index]
        view = self.json["bufferViews"][accessor["bufferView"]]
        kind, width = COMPONENTS[accessor["componentType"]], WIDTHS[accessor["type"]]
        values: np.ndarray = np.frombuffer(self.data, kind, accessor["count"] * width, view["byteOffset"])
        return values.reshape(-1, width) if width > 1 else values

    def primitive(self, primitive: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        positions, normals = (self.accessor(primitive["attributes"][name]) for name in ("POSITION", "NORMAL"))
        return positions, normals, self.accessor(primitive["indices"]).reshape(-1, 3)

    def mesh_triangles(self) -> list[int]:
        accessors = self.json["accessors"]
        return [sum(accessors[p["indices"]]["count"] // 3 for p in mesh["primitives"]) for mesh in self.json["meshes"]]

    def mesh_uses(self) -> Counter[int]:
        return Counter(node["mesh"] for node in self.json["nodes"] if "mesh" in node)

    def expanded_triangles(self) -> int:
        triangles = self.mesh_triangles()
        return sum(triangles[mesh] * count for mesh, count in self.mesh_uses().items())

    def placements(self) -> list[tuple[int, np.ndarray, int]]:
        """Every node reached from the scene: index, matrix (4, 4) to the scene, depth."""
        found = []
        todo = [(root, np.eye(4), 1) for root in self.json["scenes"][self.json["scene"]]["nodes"]]
        while todo:
            index, around, depth = todo.pop()
            node = self.json["nodes"][index]
            local = np.eye(4)
            if "matrix" in node:
                local = np.array(node["matrix"], np.float64).reshape(4, 4).T
            local[:3, 3] += node.get("translation", (0.0, 0.0, 0.0))
            found.append((index, around @ local, depth))
            todo += [(child, around @ local, depth + 1) for child in node.get("children", ())]
        return found

    def depth(self) -> int:
        return max(depth for _, _, depth in self.placements())

    def soup(self) -> np.ndarray:
        """All placed triangles (n, 3, 3) float32."""
        corners = []
        for index, matrix, _ in self.placements():
            mesh = self.json["nodes"][index].get("mesh")
            for primitive in self.json["meshes"][mesh]["primitives"] if mesh is not None else ():
                positions, _, triangles = self.primitive(primitive)
                corners.append((positions @ matrix[:3, :3].T + matrix[:3, 3])[triangles])
        return np.concatenate(corners).astype(np.float32)

    def check_structure(self) -> None:
        """What the specification asks of the parts that the demo scenes use."""
        magic, version, length, _, json_kind = self.header
        assert (magic, version, json_kind) == (b"glTF", 2, b"JSON")
        assert length == self.path.stat().st_size
        assert length % 4 == self.header[3] % 4 == self.data_header[0] % 4 == 0
        assert self.data_header[1] == b"BIN\0"
        assert self.json["buffers"] == [{"byteLength": len(self.data)}]
        end = 0
        for view in self.json["bufferViews"]:
            assert view["byteOffset"] % 4 == 0
            assert view["byteOffset"] >= end
            end = view["byteOffset"] + view["byteLength"]
        assert end <= len(self.data)
        for index, accessor in enumerate(self.json["accessors"]):
            view = self.json["bufferViews"][accessor["bufferView"]]
            size = COMPONENTS[accessor["componentType"]].itemsize * WIDTHS[accessor["type"]]
            assert accessor["count"] * size == view["byteLength"]
            if "min" in accessor:
                values = self.accessor(index)
                assert values.min(axis=0).tolist() == accessor["min"]
                assert values.max(axis=0).tolist() == accessor["max"]
        for mesh in self.json["meshes"]:
            for primitive in mesh["primitives"]:
                positions, normals, triangles = self.primitive(primitive)
                assert "min" in self.json["accessors"][primitive["attributes"]["POSITION"]]
                assert len(positions) == len(normals) > int(triangles.max())
                assert 0 <= primitive["material"] < len(self.json["materials"])
        reached = [index for index, _, _ in self.placements()]
        assert sorted(reached) == list(range(len(self.json["nodes"])))
        for _, matrix, _ in self.placements():
            sizes = np.linalg.norm(matrix[:3, :3], axis=0)
            assert np.allclose(sizes, sizes[0], rtol=1e-4)
            assert np.linalg.det(matrix[:3, :3]) > 0
