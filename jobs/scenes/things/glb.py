"""Writing a scene as binary glTF 2.0 while it is being made: memory does not grow with the scene.

Vertex data go to a temporary file beside the output; so do the JSON's long lists, node by node. At the end header,
JSON and data are joined, and the file appears under its name in one step: no one ever sees half a scene.
Scenes are made with z up; glTF has y up: (x, y, z) becomes (x, z, -y) here and nowhere else.

Based on: Khronos Group, glTF 2.0 Specification (ISO/IEC 12113:2022), sections 3.6 (binary data) and 4 (GLB).
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jobs.scenes.things.solids import Mesh
from storage.base.errors import ParameterError

POSITION_STEPS = 2.0**14  # positions are rounded to 1/2^14 m: the same bytes whatever the machine's sine and cosine
NORMAL_STEPS = 2.0**20
GLB_LIMIT = 2**32 - 1  # bytes: the header's length field
_COPY = 8 << 20

_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def y_up(points: ArrayLike) -> NDArray[np.float64]:
    """Points (n, 3) of the z-up scene in glTF's axes."""
    return np.asarray(points, np.float64) @ _Y_UP.T + 0.0


class _List:
    """The items of one JSON list, kept on disk."""

    def __init__(self, folder: Path, name: str) -> None:
        self.path = folder / name
        self.file = self.path.open("wb", buffering=1 << 20)
        self.count = 0

    def add(self, item: str) -> int:
        """Append the JSON text `item`; its index."""
        self.file.write(b",\n" + item.encode() if self.count else item.encode())
        self.count += 1
        return self.count - 1


def _number(value: float) -> str:
    """The shortest JSON number of `value` rounded to a micrometre."""
    rounded = round(float(value), 6) + 0.0
    return str(int(rounded)) if rounded.is_integer() else repr(rounded)


class GlbWriter:
    """A GLB file in the making; use it as a context manager and call `finish` once.

    Nodes nest: what is placed between `begin` and `end` belongs to that node.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self.triangles = 0  # placed so far: every instance counts
        self.unique_triangles = 0  # in distinct meshes
        self._folder = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
        self._data = (self._folder / "data").open("wb", buffering=_COPY)
        self._offset = 0
        self._nodes, self._meshes, self._accessors, self._views = (
            _List(self._folder, name) for name in ("nodes", "meshes", "accessors", "bufferViews")
        )
        self._materials: list[dict[str, Any]] = []
        self._mesh_triangles: list[int] = []
        self._turns: dict[tuple[bytes, float], str] = {}  # the JSON of rotations that were used before
        self._open: list[tuple[str, str, list[int]]] = [("", "", [])]  # name, placement, children

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for file in (self._data, *(each.file for each in self._lists())):
            file.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _lists(self) -> tuple[_List, ...]:
        return self._nodes, self._meshes, self._accessors, self._views

    @property
    def nodes(self) -> int:
        """Nodes finished so far."""
        return self._nodes.count

    @property
    def meshes(self) -> int:
        """Distinct meshes written so far."""
        return self._meshes.count

    def material(self, name: str, colour: tuple[float, float, float], metal: float = 0.0, rough: float = 0.8) -> int:
        """A new material with the sRGB base colour `colour` (0 to 1 each); its index."""
        surface = {
            "baseColorFactor": [*(_linear(part) for part in colour), 1.0],
            "metallicFactor": metal,
            "roughnessFactor": rough,
        }
        self._materials.append({"name": name, "pbrMetallicRoughness": surface})
        return len(self._materials) - 1

    def _store(self, array: NDArray[Any], target: int) -> int:
        """Append `array` to the data, aligned to 4 bytes; the index of its buffer view."""
        size = array.nbytes
        if self._offset + size > GLB_LIMIT:
            raise ParameterError(
                f"{self.out}: the scene does not fit into one GLB file (4 GiB at most): ask for fewer triangles"
            )
        self._data.write(np.ascontiguousarray(array).data)
        view = self._views.add(f'{{"buffer":0,"byteOffset":{self._offset},"byteLength":{size},"target":{target}}}')
        padding = -size % 4
        if padding:
            self._data.write(bytes(padding))
        self._offset += size + padding
        return view

    def mesh(self, name: str, primitives: list[tuple[Mesh, int]]) -> int:
        """Write a mesh made of (mesh, material) pairs, to be placed by `place`; its index."""
        texts = []
        triangles = 0
        for mesh, material in primitives:
            positions = _rounded(mesh.positions, POSITION_STEPS)
            normals = _rounded(mesh.normals, NORMAL_STEPS)
            short = positions.shape[1] <= 65535
            indices = np.ascontiguousarray(mesh.triangles, "<u2" if short else "<u4")
            lo, hi = positions.min(axis=1).tolist(), positions.max(axis=1).tolist()
            count = positions.shape[1]
            place = self._accessors.add(
                f'{{"bufferView":{self._store(positions.T, 34962)},"componentType":5126,"count":{count},'
                f'"type":"VEC3","min":{lo},"max":{hi}}}'
            )
            facing = self._accessors.add(
                f'{{"bufferView":{self._store(normals.T, 34962)},"componentType":5126,"count":{count},"type":"VEC3"}}'
            )
            corners = self._accessors.add(
                f'{{"bufferView":{self._store(indices, 34963)},"componentType":{5123 if short else 5125},'
                f'"count":{indices.size},"type":"SCALAR"}}'
            )
            texts.append(
                f'{{"attributes":{{"POSITION":{place},"NORMAL":{facing}}},"indices":{corners},"material":{material}}}'
            )
            triangles += mesh.count
        self._mesh_triangles.append(triangles)
        self.unique_triangles += triangles
        return self._meshes.add(f'{{"name":{json.dumps(name)},"primitives":[{",".join(texts)}]}}')

    def triangles_of(self, mesh: int) -> int:
        """Triangles of mesh `mesh`."""
        return self._mesh_triangles[mesh]

    def begin(
        self, name: str, at: tuple[float, float, float] = (0.0, 0.0, 0.0), turn: NDArray[np.float64] | None = None
    ) -> None:
        """Open a node at a point of the node around it, under a rotation (3, 3)."""
        self._open.append((name, self._placement(at, turn, 1.0), []))

    def end(self) -> None:
        """Close the node opened last; one that holds nothing is left out."""
        name, placement, children = self._open.pop()
        if children:
            self._node(name, f',"children":{json.dumps(children, separators=(",", ":"))}{placement}')

    def place(
        self,
        name: str,
        mesh: int,
        at: tuple[float, float, float] = (0.0, 0.0, 0.0),
        turn: NDArray[np.float64] | None = None,
        scale: float = 1.0,
    ) -> None:
        """Place `mesh` at a point, under a rotation (3, 3) and a uniform scale."""
        self.triangles += self._mesh_triangles[mesh]
        self._node(name, f',"mesh":{mesh}{self._placement(at, turn, scale)}')

    def _placement(self, at: tuple[float, float, float], turn: NDArray[np.float64] | None, scale: float) -> str:
        """The JSON of a node's transform, or nothing for none."""
        x, y, z = map(_number, (at[0], at[2], -at[1]))
        if turn is None and scale == 1.0:
            return f',"translation":[{x},{y},{z}]' if any(at) else ""
        key = (b"" if turn is None else turn.tobytes(), scale)
        if key not in self._turns:
            linear = _Y_UP @ ((np.eye(3) if turn is None else turn) * scale) @ _Y_UP.T
            self._turns[key] = ",".join(",".join(map(_number, column)) + ",0" for column in linear.T.tolist())
        return f',"matrix":[{self._turns[key]},{x},{y},{z},1]'

    def add(self, name: str, mesh: Mesh, material: int) -> None:
        """Write `mesh` and place it once, where it is."""
        self.place(name, self.mesh(name, [(mesh, material)]))

    def _node(self, name: str, rest: str) -> None:
        self._open[-1][2].append(self._nodes.add(f'{{"name":{json.dumps(name)}{rest}}}'))

    def finish(self, extras: dict[str, Any]) -> int:
        """Join everything and put the file under its name; its size in bytes. `extras` go to the glTF scene."""
        for each in (self._data, *(each.file for each in self._lists())):
            each.flush()
        target = self._folder / "scene"
        head = {"asset": {"version": "2.0", "generator": "vlod demo-scene"}, "scene": 0}
        scene = {"nodes": self._open[0][2], "extras": extras}
        with target.open("wb", buffering=_COPY) as file:
            file.write(bytes(20))
            file.write(json.dumps(head, separators=(",", ":"))[:-1].encode())
            file.write(f',"scenes":{json.dumps([scene], separators=(",", ":"))}'.encode())
            file.write(f',"materials":{json.dumps(self._materials, separators=(",", ":"))}'.encode())
            for items in self._lists():
                file.write(f',"{items.path.name}":['.encode())
                _append(file, items.path)
                file.write(b"]")
            file.write(f',"buffers":[{{"byteLength":{self._offset}}}]}}'.encode())
            file.write(b" " * (-file.tell() % 4))
            json_bytes = file.tell() - 20
            size = file.tell() + 8 + self._offset
            if size > GLB_LIMIT:
                raise ParameterError(
                    f"{self.out}: the scene does not fit into one GLB file (4 GiB at most): ask for fewer triangles"
                )
            file.write(struct.pack("<I4s", self._offset, b"BIN\0"))
            _append(file, self._folder / "data")
            file.seek(0)
            file.write(struct.pack("<4sIII4s", b"glTF", 2, size, json_bytes, b"JSON"))
            file.flush()
            os.fsync(file.fileno())
        target.replace(self.out)
        return size


def _rounded(vectors: NDArray[np.float64], steps: float) -> NDArray[np.float32]:
    """`vectors` (n, 3), z up, rounded to 1/`steps` and turned y up: (3, n), without negative zeros."""
    scaled = vectors.T * steps
    np.rint(scaled, out=scaled)
    out = np.empty(scaled.shape, "<f4")
    np.divide(scaled[0], steps, out=out[0], casting="same_kind")
    np.divide(scaled[2], steps, out=out[1], casting="same_kind")
    np.divide(scaled[1], -steps, out=out[2], casting="same_kind")
    out += np.float32(0.0)
    return out


def _append(file: BinaryIO, path: Path) -> None:
    """Copy the file at `path` to the end of `file`."""
    with path.open("rb") as source:
        shutil.copyfileobj(source, file, _COPY)


def _linear(srgb: float) -> float:
    """Linear light of an sRGB value, both 0 to 1: what glTF's factors are. Rounded: bytes must not depend on pow."""
    return round(srgb / 12.92 if srgb <= 0.04045 else ((srgb + 0.055) / 1.055) ** 2.4, 6)
