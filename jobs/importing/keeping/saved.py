"""An imported model on disk: a directory of arrays, written once, whole or not at all.

    positions.npy     float64 (n, 3)  all meshes' vertices, each mesh in its own local coordinates
    normals.npy       float32 (n, 3)  unit length; zeros where the file gave none
    colours.npy       uint8 (n, 4)    red, green, blue, alpha; sRGB
    triangles.npy     uint32 (m, 3)   vertex indices, counted from the mesh's first vertex
    source_faces.npy  uint32 (m,)     face number within the mesh as it was loaded, before any repair
    meshes.npy        IMPORTED_MESH   where each mesh lies in the arrays above
    parts.npy         IMPORTED_PART   placements of meshes in model space
    model.json        names, frame, box, digest, report of repairs

Model space is the frame of the (first) input file minus `origin`. A mesh that is placed once is *baked*: its positions
are model-space positions and its part is an identity. A mesh that is placed twice or more stays in local coordinates,
moved near their origin if they lie far from it; its parts carry matrices, which may mirror.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from storage.base.errors import ModelError
from storage.base.temporary import temporary_path
from storage.meshes.placement import IDENTITY, normal_matrix, transform_points

IMPORTED_MESH = np.dtype(
    [
        ("vertex_start", "<u8"),
        ("vertices", "<u8"),
        ("triangle_start", "<u8"),
        ("triangles", "<u8"),
    ]
)

IMPORTED_PART = np.dtype(
    [
        ("mesh", "<u4"),  # index into IMPORTED_MESH
        ("name", "<u4"),  # index into model.json's names
        ("matrix", "<f8", (3, 4)),  # local to model space
        ("identity", "?"),  # the mesh lies in model space already
    ]
)

#: The arrays per vertex and per triangle, with dtype and columns.
COLUMNS = {
    "positions": ("<f8", 3),
    "normals": ("<f4", 3),
    "colours": ("|u1", 4),
    "triangles": ("<u4", 3),
    "source_faces": ("<u4", 0),
}

#: Those of them that have a row for each vertex; the others have one for each triangle.
PER_VERTEX = ("positions", "normals", "colours")

#: Format number of the directory.
DIRECTORY_FORMAT = 1

#: Positions that are transformed at once.
_BATCH = 1 << 17

#: Coordinates farther than this many extents from zero are brought near it by an origin.
_FAR = 4.0


@dataclass(frozen=True, eq=False)
class MeshView:
    """One mesh. Lengths are in local units."""

    positions: np.ndarray  # (n, 3) float64
    normals: np.ndarray  # (n, 3) float32 unit, zeros where unknown
    colours: np.ndarray  # (n, 4) uint8 sRGB and alpha
    triangles: np.ndarray  # (m, 3) uint32 into positions
    source_faces: np.ndarray  # (m,) uint32 face number in the mesh as it was loaded

    @staticmethod
    def of(
        positions: np.ndarray,
        triangles: np.ndarray,
        *,
        normals: np.ndarray | None = None,
        colours: np.ndarray | None = None,
        source_faces: np.ndarray | None = None,
    ) -> MeshView:
        """A mesh with defaults for what is not given: no normals, opaque light grey, faces numbered in order."""
        n, m = len(positions), len(triangles)
        return MeshView(
            np.ascontiguousarray(positions, np.float64).reshape(n, 3),
            np.zeros((n, 3), np.float32) if normals is None else np.ascontiguousarray(normals, np.float32),
            np.full((n, 4), (204, 204, 204, 255), np.uint8)
            if colours is None
            else np.ascontiguousarray(colours, np.uint8),
            np.ascontiguousarray(triangles, np.uint32).reshape(m, 3),
            np.arange(m, dtype=np.uint32) if source_faces is None else np.ascontiguousarray(source_faces, np.uint32),
        )


@dataclass(frozen=True, eq=False)
class Part:
    """A named mesh placed in the frame of the input file."""

    mesh: int  # index into the list of meshes
    name: str
    matrix: np.ndarray  # (3, 4) float64, local units to model units; identity for a mesh placed as it is


def write_model(
    out: Path,
    meshes: Sequence[MeshView],
    parts: Sequence[Part] | None = None,
    *,
    up: str = "z",
    unit_in_metres: float = 1.0,
    report: Mapping[str, Any] | None = None,
) -> None:
    """Write meshes and the parts that place them as an imported model at `out`.

    Chooses the origin, bakes meshes that are placed once, drops those that are never placed. Without `parts` every
    mesh is placed once as it is. The meshes must be free of defects: finite positions, indices within range, one
    triangle or more each. They are asked for one by one, two or three times each, and none is kept. `report` is kept as
    it is: {defect: {"total": n, "parts": {name: n}}}.

    No reader can observe a partially written model: everything goes to a temporary directory beside `out`, which is
    renamed when complete and removed if anything fails. Raises ModelError if there is nothing to write or something is
    at `out` already, and OSError as the file system raises it (no space, no permission).
    """
    if parts is None:
        parts = [Part(i, f"mesh {i}", IDENTITY) for i in range(len(meshes))]
    if not parts:
        raise ModelError(f"{out}: a model needs at least one triangle")
    parts = [Part(p.mesh, p.name, np.asarray(p.matrix, np.float64)) for p in parts]
    found = _survey(meshes, parts)
    origin = _origin(found.lo, found.hi)
    parts = [_shifted(p, -origin) for p in parts]
    if origin.any():
        found = _survey(meshes, parts)
    row_of = {mesh: row for row, mesh in enumerate(found.used)}

    names = list(dict.fromkeys(p.name for p in parts))
    name_index = {name: i for i, name in enumerate(names)}
    rows = np.zeros(len(parts), IMPORTED_PART)
    baking: dict[int, np.ndarray] = {}
    for row, p in zip(rows, parts, strict=True):
        mesh = row_of[p.mesh]
        row["mesh"], row["name"] = mesh, name_index[p.name]
        if found.placed[mesh] == 1:
            row["identity"], row["matrix"] = True, IDENTITY
            baking[mesh] = p.matrix
        else:
            row["matrix"] = p.matrix
            if found.centres[mesh].any():
                row["matrix"][:, 3] = transform_points(p.matrix, found.centres[mesh][None])[0]

    out.parent.mkdir(parents=True, exist_ok=True)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ModelError(f"{out}: there is something here already; remove it or choose another place")
    temporary = temporary_path(out.parent)
    temporary.mkdir()
    try:
        digests = _write_arrays(temporary, meshes, found, baking)
        digests["meshes"] = _write_whole(temporary / "meshes.npy", found.table)
        digests["parts"] = _write_whole(temporary / "parts.npy", rows)
        header = {
            "origin": origin.tolist(),
            "up": up,
            "unit_in_metres": float(unit_in_metres),
            "names": names,
            "lo": found.lo.tolist(),
            "hi": found.hi.tolist(),
        }
        content = json.dumps({"arrays": digests, **header}, sort_keys=True, ensure_ascii=True)
        header["digest"] = hashlib.sha256(content.encode()).hexdigest()
        header["format"] = DIRECTORY_FORMAT
        header["triangles"] = int(found.table["triangles"][rows["mesh"]].sum())
        header["report"] = dict(report or {})
        (temporary / "model.json").write_text(json.dumps(header, indent=1, ensure_ascii=True), "ascii")
        temporary.rename(out)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def bake(mesh: MeshView, matrix: np.ndarray) -> MeshView:
    """The mesh under a (3, 4) matrix, in float64. A mirroring matrix also turns the faces, so fronts stay fronts."""
    if np.array_equal(matrix, IDENTITY):
        return mesh
    if np.array_equal(matrix[:, :3], IDENTITY[:, :3]):
        moved = transform_points(matrix, mesh.positions)
        return MeshView(moved, mesh.normals, mesh.colours, mesh.triangles, mesh.source_faces)
    linear, mirrored = normal_matrix(matrix)
    return MeshView(
        transform_points(matrix, mesh.positions),
        turned(mesh.normals, linear),
        mesh.colours,
        np.ascontiguousarray(mesh.triangles[:, ::-1]) if mirrored else mesh.triangles,
        mesh.source_faces,
    )


def turned(normals: np.ndarray, linear: np.ndarray) -> np.ndarray:
    """Normals (n, 3) under a (3, 3) matrix, float32, scaled to unit length; zeros stay zeros."""
    scale = float(np.abs(linear).max())
    turned = transform_points(np.column_stack([linear / scale, np.zeros(3)]), normals)
    length = np.sqrt((turned[:, 0] ** 2 + turned[:, 1] ** 2) + turned[:, 2] ** 2)
    return (turned / np.where(length > 0, length, 1.0)[:, None]).astype(np.float32)


def _shifted(part: Part, shift: np.ndarray) -> Part:
    matrix = part.matrix.copy()
    matrix[:, 3] += shift
    return Part(part.mesh, part.name, matrix)


class _Survey(NamedTuple):
    """What is known of all meshes that are placed, after each was looked at once."""

    used: list[int]  # which are placed, increasing: the rows of what follows
    table: np.ndarray  # IMPORTED_MESH (k,)
    placed: np.ndarray  # (k,) int64 times that each is placed
    centres: np.ndarray  # (k, 3) float64 what is taken off the local coordinates of those placed several times
    lo: np.ndarray  # (3,) float64 box of all placed vertices, exactly as they are placed
    hi: np.ndarray  # (3,) float64


def _survey(meshes: Sequence[MeshView], parts: Sequence[Part]) -> _Survey:
    users: dict[int, list[np.ndarray]] = {}
    for p in parts:
        users.setdefault(p.mesh, []).append(p.matrix)
    used = sorted(users)
    table = np.zeros(len(used), IMPORTED_MESH)
    centres = np.zeros((len(used), 3))
    lo, hi = np.full(3, np.inf), np.full(3, -np.inf)
    for mesh, matrices in users.items():
        view, row = meshes[mesh], bisect_left(used, mesh)
        points = view.positions
        table["vertices"][row], table["triangles"][row] = len(points), len(view.triangles)
        if len(matrices) > 1:
            centres[row] = _origin(points.min(axis=0), points.max(axis=0))
        batch = max(_BATCH // len(points), 1)
        for start in range(0, len(matrices), batch):
            placed = transform_points(np.stack(matrices[start : start + batch])[:, None], points)
            lo, hi = np.minimum(lo, placed.min(axis=(0, 1))), np.maximum(hi, placed.max(axis=(0, 1)))
    table["vertex_start"][1:] = np.cumsum(table["vertices"])[:-1]
    table["triangle_start"][1:] = np.cumsum(table["triangles"])[:-1]
    return _Survey(used, table, np.array([len(users[mesh]) for mesh in used]), centres, lo, hi)


def _origin(lo: np.ndarray, hi: np.ndarray) -> np.ndarray:
    """Zero, or for boxes far from zero their centre, rounded to a multiple of a power of two of about their extent."""
    extent = float((hi - lo).max())
    if extent == 0 or max(float(np.abs(lo).max()), float(np.abs(hi).max())) <= _FAR * extent:
        return np.zeros(3)
    step = float(2.0 ** int(np.frexp(extent)[1] - 1))
    return np.rint((lo / 2 + hi / 2) / step) * step


def _write_arrays(
    folder: Path, meshes: Sequence[MeshView], found: _Survey, baking: Mapping[int, np.ndarray]
) -> dict[str, str]:
    """Write the arrays of COLUMNS mesh by mesh; returns the hash of each one's data. `baking` goes by row."""
    files: dict[str, BinaryIO] = {}
    hashes = {name: hashlib.sha256() for name in COLUMNS}
    try:
        for name, (dtype, columns) in COLUMNS.items():
            count = int(found.table["vertices" if name in PER_VERTEX else "triangles"].sum())
            files[name] = (folder / f"{name}.npy").open("wb")
            _write_header(files[name], (count, columns) if columns else (count,), np.dtype(dtype))
        for row, number in enumerate(found.used):
            mesh = meshes[number]
            if row in baking:
                mesh = bake(mesh, baking[row])
            elif found.centres[row].any():
                mesh = bake(mesh, np.column_stack([np.eye(3), -found.centres[row]]))
            for name, (dtype, _) in COLUMNS.items():
                data = np.ascontiguousarray(getattr(mesh, name), np.dtype(dtype)).data.cast("B")
                hashes[name].update(data)
                files[name].write(data)
    finally:
        for file in files.values():
            file.close()
    return {name: digest.hexdigest() for name, digest in hashes.items()}


def _write_header(file: BinaryIO, shape: tuple[int, ...], dtype: np.dtype) -> None:
    header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)


def _write_whole(path: Path, array: np.ndarray) -> str:
    with path.open("wb") as file:
        _write_header(file, array.shape, array.dtype)
        file.write(array.tobytes())
    return hashlib.sha256(array.tobytes()).hexdigest()
