"""What vLOD stores, and how it is read and written. Imports neither `jobs` nor `player`.

Read in this order:
    model/             what a store holds of a model: its tables, its hierarchy, and cuts through it
    cells/             view cells: the octree that they lie in, changes between them, codecs of what is seen
    meshes/            packs of meshes, their place in model space, and their facets
    shards/            files: immutable shards of checksummed frames, and the manifest that names them
    geometry_reader    reading geometry
    known_cells        what is known of cells before it is read what can be seen from them
    vlod_reader        reading what can be seen from cells
    store              opening a store, and all that can be read from it
    versions           the versions of a store, and the shards that each names
    check              every byte of a store against its checksums; what is said to be see-through
    geometry_writer    writing geometry, and the order in which a store is written
    vlod_writer        writing what can be seen from cells
    cli/               `vlod`, the command line, `vlod info` and `vlod versions`
    base/              errors, kernels and other things that all of it uses

FORMAT.md describes the files byte by byte. The rooms model, cells, meshes and shards do not know of each other: the
modules beside them put them together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from storage.store import Store, open_store

__all__ = ["Store", "open_store"]


def __getattr__(name: str) -> Any:
    """Imports the public names on first use, so that the command line starts without numpy."""
    if name in __all__:
        from storage import store

        return getattr(store, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
