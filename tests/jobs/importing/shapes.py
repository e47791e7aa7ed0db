"""Shapes and files that the tests of the import share."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

from jobs.importing.model import ImportOptions, Model, import_model, open_model

BOX = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def box(size=1.0, at=(0.0, 0.0, 0.0)):
    """(8, 3) float64 and (12, 3) int64 of an axis-aligned box."""
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], np.float64) * size + np.array(at)
    triangles = [triangle for a, b, c, d in BOX for triangle in ((a, b, c), (a, c, d))]
    return corners, np.array(triangles, np.int64)


def terrain(n=9, seed=3):
    """A bumpy (n x n) grid without any defect."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(n, dtype=np.float64), np.arange(n, dtype=np.float64))
    points = np.stack([x.ravel(), y.ravel(), random.random(n * n)], axis=1).astype(np.float32).astype(np.float64)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    triangles = np.concatenate([np.stack([a, a + 1, a + n + 1], axis=1), np.stack([a, a + n + 1, a + n], axis=1)])
    return points, triangles


def imported(path, out: Path, **options) -> Model:
    """Import a file or some files into a fresh directory."""
    inputs = path if isinstance(path, list) else [path]
    import_model(inputs, out, ImportOptions(**options))
    return open_model(out)


def corners_of(model: Model) -> np.ndarray:
    """(t, 3, 3) corner positions of all parts' triangles in input coordinates, mirrored parts turned back."""
    found = []
    for part in model.parts:
        mesh = model.mesh(int(part["mesh"]))
        matrix = part["matrix"]
        placed = mesh.positions @ matrix[:, :3].T + matrix[:, 3] + model.origin
        triangles = mesh.triangles[:, ::-1] if np.linalg.det(matrix[:, :3]) < 0 else mesh.triangles
        found.append(placed[triangles])
    return np.concatenate(found)


def canonical(corners: np.ndarray) -> np.ndarray:
    """Triangles (t, 9), each turned to begin with its smallest corner, and sorted: equal for equal surfaces."""
    corners = np.asarray(corners, np.float64)
    keys = [[tuple(c) for c in triangle] for triangle in corners.tolist()]
    turned = [t[t.index(min(t)) :] + t[: t.index(min(t))] for t in keys]
    return np.array(sorted(sum(t, ()) for t in turned)).reshape(-1, 9)


def total(model: Model, defect: str) -> int:
    """How often a defect was counted."""
    return model.report[defect]["total"] if defect in model.report else 0


class Glb:
    """A GLB file put together by hand."""

    def __init__(self) -> None:
        self.header = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            "nodes": [],
            "meshes": [],
            "accessors": [],
            "bufferViews": [],
            "materials": [],
        }
        self.data = b""

    def view(self, data: bytes, **extra) -> int:
        self.header["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **extra})
        self.data += data + bytes(-len(data) % 4)
        return len(self.header["bufferViews"]) - 1

    def accessor(self, array, **extra) -> int:
        array = np.asarray(array)
        kinds = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        entry = {"bufferView": self.view(array.tobytes()), "componentType": kinds[array.dtype.str[1:]]}
        self.header["accessors"].append({**entry, "count": len(array), "type": kind, **extra})
        return len(self.header["accessors"]) - 1

    def primitive(self, positions, triangles=None, **extra) -> dict:
        """`extra`: attributes as arrays or accessor numbers (capitals), the rest as they are."""
        attributes = {"POSITION": self.accessor(np.asarray(positions, "<f4"))}
        rest = {}
        for key, value in extra.items():
            if key.isupper() or "_" in key:
                attributes[key] = value if isinstance(value, int) else self.accessor(value)
            else:
                rest[key] = value
        if triangles is not None:
            rest["indices"] = self.accessor(np.asarray(triangles, "<u4").reshape(-1))
        return {"attributes": attributes, **rest}

    def mesh(self, *primitives: dict, **extra) -> int:
        self.header["meshes"].append({"primitives": list(primitives), **extra})
        return len(self.header["meshes"]) - 1

    def node(self, root=True, **node) -> int:
        self.header["nodes"].append(node)
        if root:
            self.header["scenes"][0]["nodes"].append(len(self.header["nodes"]) - 1)
        return len(self.header["nodes"]) - 1

    def content(self) -> bytes:
        buffers = [{"byteLength": len(self.data)}, *self.header.get("buffers", [])]
        header = {key: value for key, value in {**self.header, "buffers": buffers}.items() if value != []}
        return packed(json.dumps(header).encode(), self.data)

    def write(self, path: Path) -> Path:
        path.write_bytes(self.content())
        return path


def packed(text: bytes, data: bytes) -> bytes:
    """A GLB file of a JSON chunk and a binary chunk."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
