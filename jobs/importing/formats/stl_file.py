"""Reader of STL files, binary and text (.stl), through trimesh.

Face k is the k-th facet of its solid. Facet normals are left aside: they say no more than the corners do.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from jobs.importing.reading.content import Content, whole
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.scene import SourceMesh, SourceNode, SourceScene
from storage.base.errors import ModelError
from storage.meshes.placement import IDENTITY

_HEADER, _FACET = 84, 50


def read(file: Path, content: Content, resources: Resources) -> SourceScene:  # noqa: ARG001  STL names no other files
    """Read an STL file. Raises ModelError if it is cut short."""
    from trimesh.exchange.stl import load_stl

    data = whole(content)
    _check(file, data)
    found = load_stl(io.BytesIO(data))
    solids = found.get("geometry", {"": found})
    meshes = [
        SourceMesh(
            str(name).strip() or file.stem,
            np.asarray(solid["vertices"], np.float64),
            np.asarray(solid["faces"], np.int64),
        )
        for name, solid in ((entry.get("metadata", {}).get("name") or key, entry) for key, entry in solids.items())
        if len(solid["faces"])
    ]
    return SourceScene(file, meshes, [SourceNode(i, mesh.name, IDENTITY) for i, mesh in enumerate(meshes)])


def _check(file: Path, content: bytes) -> None:
    """Raise ModelError unless every facet that the file promises is there: trimesh would leave out what is not."""
    facets = int.from_bytes(content[80:_HEADER], "little") if len(content) >= _HEADER else 0
    expected = _HEADER + _FACET * facets
    if len(content) >= _HEADER and len(content) == expected:
        return
    text = content.lower()
    if not text.lstrip().startswith(b"solid"):
        raise ModelError(
            f"{file}: {len(content)} bytes, but an STL file of {facets} facets has {expected}; "
            "it is cut short or not an STL file"
        )
    last = text.rfind(b"endsolid")
    if last < 0 or b"facet" in text[last:]:
        raise ModelError(f"{file}: a text STL file without its last line (endsolid); it is cut short, export it again")
    if text.count(b"vertex") != 3 * text.count(b"endfacet"):
        raise ModelError(f"{file}: not every facet has three vertices; the file is damaged, export it again")
