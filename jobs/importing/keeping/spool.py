"""Meshes that wait on disk: they come in one by one, and are read again one by one."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self, overload

import numpy as np

from jobs.importing.keeping.saved import COLUMNS, PER_VERTEX, MeshView


class Spool(Sequence[MeshView]):
    """Meshes in files of a folder that exists and is empty, one file for each kind of array; none is held in memory."""

    def __init__(self, folder: Path) -> None:
        self._ends = [(0, 0)]  # vertices and triangles up to each mesh
        with ExitStack() as stack:
            self._files = {name: stack.enter_context((folder / name).open("w+b")) for name in COLUMNS}
            self._open = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def add(self, mesh: MeshView) -> None:
        """Appends a mesh. Raises OSError as the file system does."""
        for name, file in self._files.items():
            file.seek(0, 2)
            file.write(np.ascontiguousarray(getattr(mesh, name), np.dtype(COLUMNS[name][0])).data.cast("B"))
        vertices, triangles = self._ends[-1]
        self._ends.append((vertices + len(mesh.positions), triangles + len(mesh.triangles)))

    def __len__(self) -> int:
        return len(self._ends) - 1

    @overload
    def __getitem__(self, index: int) -> MeshView: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[MeshView]: ...

    def __getitem__(self, index: int | slice) -> MeshView | Sequence[MeshView]:
        if isinstance(index, slice):
            return [self[at] for at in range(len(self))[index]]
        at = range(len(self))[index]
        return MeshView(**{name: self._read(name, at) for name in COLUMNS})

    def _read(self, name: str, mesh: int) -> np.ndarray:
        dtype, columns = COLUMNS[name]
        kind = 0 if name in PER_VERTEX else 1
        start, end = self._ends[mesh][kind], self._ends[mesh + 1][kind]
        width = max(columns, 1)
        file = self._files[name]
        file.seek(start * width * np.dtype(dtype).itemsize)
        values = np.fromfile(file, dtype, (end - start) * width)
        return values.reshape(-1, columns) if columns else values
