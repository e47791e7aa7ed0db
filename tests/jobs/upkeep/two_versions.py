"""A store with two versions that have some shards in common, and all that can be read of a store."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from storage import open_store
from storage.geometry_reader import Geometry
from storage.store import Store
from tests.storage.tiny_store import make_store, room_parts


def make_two_versions(root: Path) -> Path:
    """Writes two versions of a store: the same geometry, other cells."""

    def half(_geometry: Geometry, cell: np.ndarray, cut: np.ndarray) -> np.ndarray:
        return cut[int(cell["key"]) % 2 :: 2]

    make_store(root, room_parts()[4:], depth=1, cells_per_shard=4)
    make_store(root, room_parts()[4:], depth=1, cells_per_shard=2, visible=half, pixel_error=2.0)
    return root


def content(root: Path) -> dict[str, bytes]:
    """All files of a folder by their paths inside it."""
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def put(root: Path, files: dict[str, bytes]) -> Path:
    """Writes files into a folder, in place of all that is there."""
    shutil.rmtree(root, ignore_errors=True)
    for name, data in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(data)
    return root


def all_of(store: Store) -> list[np.ndarray]:
    """Every table, mesh, set and change of a store."""
    tables = [store.parts, store.instances, store.geometry, store.packs, store.nodes, store.drawables, store.cells]
    meshes = [array for drawable in range(len(store.drawables)) for array in store.mesh(drawable)]
    sets = [store.vlod(cell) for cell in range(len(store.cells))]
    pairs = [(cell, other) for cell in range(len(store.cells)) for other in store.neighbours(cell).tolist()]
    return [*tables, *meshes, *sets, *(array for pair in pairs for array in store.delta(*pair))]


def all_of_version(root: Path, version: int | None) -> list[np.ndarray]:
    """Every table, mesh, set and change of a version."""
    return all_of(open_store(root, version=version))
