"""What vLOD stores, and how it is read and written. Imports neither `jobs` nor `player`.

Read in this order:
    tables      what is stored about a model, as numpy structured dtypes
    octree      keys of view cells, neighbours, point location
    tree        walking the hierarchy of nodes
    detail      which nodes stand for the model, and at which level
    store       opening a store and reading from it
    writer      writing one
    manifest    versions, and what makes a directory a store
    frames      shards: immutable files of checksummed frames; columns: tables as frames
    geometry    packs of meshes, made of
                mesh_order    the order that meshes compress well in
                connectivity  triangles as a byte each, and what they foretell of positions
                wedges        vertices that share a position
                normals       of triangles; unit vectors as two small integers
                planes        arrays as byte planes
    facets      triangles by direction, and what a cell can only see from behind
    deltas      changes between neighbouring cells; codecs/: their codes; spanning_tree: which of them rebuild a cell
    files       local and remote files; cache: what was decoded last; temporary: names of what is being written
    kernels     how inner loops are compiled
    errors      everything that can go wrong, as one tree
    command     `vlod`, the command line; info: `vlod info`
FORMAT.md describes the files byte by byte.
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
