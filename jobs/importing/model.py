"""The imported model: what the rest of the job works on.

import_model(inputs, out, options) -> ImportReport    model files to a directory
write_model(out, meshes, parts)                       arrays to such a directory
open_model(path) -> Model                             the directory, memory-mapped
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.importing.keeping.saved import (
    COLUMNS,
    DIRECTORY_FORMAT,
    IMPORTED_MESH,
    IMPORTED_PART,
    MeshView,
    Part,
    write_model,
)
from jobs.running.arrays import mapped_array
from storage.base.errors import ModelError
from storage.base.temporary import temporary_path
from storage.model.tables import Grid

if TYPE_CHECKING:
    from jobs.importing.reading.source_scene import SourceScene

__all__ = [
    "IMPORTED_MESH",
    "IMPORTED_PART",
    "ImportOptions",
    "ImportReport",
    "MeshView",
    "Model",
    "Part",
    "import_model",
    "open_model",
    "write_model",
]

Report = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class Model:
    """An imported model, memory-mapped and read-only. Lengths are in model units. See `jobs.importing.keeping.saved`.

    Pickles as its path, so it costs nothing to send to another process on the same file system.
    """

    path: Path
    positions: np.ndarray  # (n, 3) float64, local coordinates of each mesh
    normals: np.ndarray  # (n, 3) float32 unit, zeros where unknown
    colours: np.ndarray  # (n, 4) uint8 sRGB and alpha
    triangles: np.ndarray  # (m, 3) uint32, counted from the mesh's first vertex
    source_faces: np.ndarray  # (m,) uint32
    meshes: np.ndarray  # IMPORTED_MESH (k,)
    parts: np.ndarray  # IMPORTED_PART (p,)
    names: tuple[str, ...]  # parts["name"] counts into these
    origin: np.ndarray  # (3,) float64: input coordinates = model coordinates + origin
    up: str  # "x", "y" or "z"
    unit_in_metres: float  # length of a model unit in metres
    lo: np.ndarray  # (3,) float64 box of all parts in model space
    hi: np.ndarray  # (3,) float64
    digest: str  # sha256 of everything above
    triangle_count: int  # triangles of all parts, instances counted as often as they are placed
    report: Report  # repairs: {defect: {"total": n, "parts": {name: n}}}

    @property
    def grid(self) -> Grid:
        """The position grid that fits the model's box."""
        return Grid.for_extent(float(max(np.abs(self.lo).max(), np.abs(self.hi).max())))

    def mesh(self, index: int) -> MeshView:
        """One mesh, as views of the mapped arrays."""
        row = self.meshes[index]
        v, t = int(row["vertex_start"]), int(row["triangle_start"])
        vertices, triangles = slice(v, v + int(row["vertices"])), slice(t, t + int(row["triangles"]))
        return MeshView(
            self.positions[vertices],
            self.normals[vertices],
            self.colours[vertices],
            self.triangles[triangles],
            self.source_faces[triangles],
        )

    def part_name(self, part: int) -> str:
        """The name that a part bears in the input."""
        return self.names[int(self.parts["name"][part])]

    def __reduce__(self) -> tuple[Callable[[Path], Model], tuple[Path]]:
        return open_model, (self.path,)


@dataclass(frozen=True)
class ImportOptions:
    """What the input files do not say, or say wrongly."""

    units: str | float | None = None  # a unit ("mm", "m", "in", ...) or metres per unit; None: what the first file says
    up: str | None = None  # axis that points up, "x", "y" or "z"; None: what the first file says
    keep_far: bool = False  # also what lies absurdly far from nearly all else, at the cost of precision


@dataclass(frozen=True)
class ImportReport:
    """What an import found and did."""

    files: int  # model files read
    meshes: int
    parts: int
    triangles: int  # of all parts
    report: Report  # repairs: {defect: {"total": n, "parts": {name: n}}}


def open_model(path: Path) -> Model:
    """Open the imported model in the directory `path`. Raises ModelError if there is none or it is damaged."""
    try:
        header = json.loads((path / "model.json").read_text("ascii"))
        if header["format"] != DIRECTORY_FORMAT:
            raise ModelError(f"{path}: an imported model of another version of vLOD; import the files again")
        arrays = {name: mapped_array(path / f"{name}.npy") for name in COLUMNS}
        meshes, parts = np.load(path / "meshes.npy"), np.load(path / "parts.npy")
        if meshes.dtype != IMPORTED_MESH or parts.dtype != IMPORTED_PART:
            raise ValueError("unexpected columns")
        meshes.flags.writeable = parts.flags.writeable = False
        return Model(
            path=path,
            **arrays,
            meshes=meshes,
            parts=parts,
            names=tuple(header["names"]),
            origin=np.array(header["origin"], np.float64),
            up=header["up"],
            unit_in_metres=float(header["unit_in_metres"]),
            lo=np.array(header["lo"], np.float64),
            hi=np.array(header["hi"], np.float64),
            digest=header["digest"],
            triangle_count=int(header["triangles"]),
            report=header["report"],
        )
    except FileNotFoundError:
        raise ModelError(f"{path}: there is no imported model here; import the files first") from None
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{path}: the imported model is damaged ({error}); import the files again") from None


def import_model(
    inputs: Sequence[Path],
    out: Path,
    options: ImportOptions | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ImportReport:
    """Import model files, or folders of them, into the directory `out`, which appears whole or not at all.

    The first file gives model space its frame; the others are scaled and turned into it. `progress(done, total)` counts
    files, and one last step for writing. Memory is proportional to the largest mesh, and to the largest file of a
    format that is read whole (see `jobs.importing.read`); meshes that are done wait in a folder beside `out`. Raises
    ModelError, with one line that names the file, for what cannot be used.
    """
    from jobs.importing.far import Near, without_far
    from jobs.importing.join import join_scenes
    from jobs.importing.keeping.spool import Spool
    from jobs.importing.read import find_files, read_scene

    options = options or ImportOptions()
    files = find_files(inputs)
    tell = progress or (lambda _done, _total: None)

    def scenes() -> Iterator[SourceScene]:
        for done, (file, root) in enumerate(files):
            tell(done, len(files) + 1)
            yield read_scene(file, root)

    out.parent.mkdir(parents=True, exist_ok=True)
    folder = temporary_path(out.parent)
    folder.mkdir()
    try:
        with Spool(folder) as meshes:
            joined = join_scenes([file for file, _ in files], scenes(), options.units, options.up, meshes.add)
            tell(len(files), len(files) + 1)
            near = Near(meshes, joined.parts)
            if not options.keep_far:
                near = without_far(meshes, joined.parts, joined.shapes, joined.tally)
            report = joined.tally.report()
            write_model(out, near.meshes, near.parts, up=joined.up, unit_in_metres=joined.unit_in_metres, report=report)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    tell(len(files) + 1, len(files) + 1)
    model = open_model(out)
    return ImportReport(len(files), len(model.meshes), len(model.parts), model.triangle_count, report)
