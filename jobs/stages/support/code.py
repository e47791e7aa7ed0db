"""The code that decides what stages give: changed code never meets old results, and other code throws none away.

A stage's `code` names modules and rooms; what these import is named as well, or stands apart: it has no say in a single
byte of the result. tests/test_walls.py holds that. What is made before a stage has no say in it either: the content of
what it reads is in its payload.
"""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

#: What may change without a result: words of errors, names of what is being written, where files lie and what is kept
#: of them (bytes are checked against checksums), the making and the running of tasks.
APART = (
    "jobs.parameters",
    "jobs.running.executors",
    "jobs.running.memory",
    "jobs.running.tasks",
    "jobs.running.workplace",
    "jobs.stages.support.build_state",
    "jobs.stages.support.code",
    "storage.base.compiling",
    "storage.base.errors",
    "storage.base.temporary",
    "storage.shards.cache",
    "storage.shards.files",
    "storage.shards.manifest",
    "storage.shards.shard_files",
)

#: How payloads are read, and arrays written.
_ANY = ("jobs.running.arrays", "storage.base.typed_json")

#: The model's tables, and how positions are placed.
_MODEL = ("storage.base.kernels", "storage.meshes.placement", "storage.model.tables")

#: Shards, and tables in them.
_SHARDS = ("storage.shards.columns", "storage.shards.sections", "storage.shards.shards")

IMPORT = (*_ANY, *_MODEL, "jobs.stages.import_model", "jobs.importing")

#: An imported model is read by all stages on detail; what made it is not.
_IMPORTED = ("jobs.stages.import_model", "jobs.importing.model", "jobs.importing.keeping.saved")
IMPORTERS = (
    "jobs.importing.far",
    "jobs.importing.formats",
    "jobs.importing.import_memory",
    "jobs.importing.inputs",
    "jobs.importing.join",
    "jobs.importing.keeping.spool",
    "jobs.importing.read",
    "jobs.importing.reading",
)

PIECES = (*_ANY, *_MODEL, *_IMPORTED, "jobs.stages.pieces", "jobs.detail", "jobs.objects", "storage.meshes.normals")
HIERARCHY = (*PIECES, "jobs.stages.hierarchy")

#: Levels are packed into shards.
_LEVELS = (
    *HIERARCHY,
    *_SHARDS,
    "jobs.stages.support.written_nodes",
    "storage.geometry_writer",
    "storage.meshes",
    "storage.model.tree",
)
SHARED = (*_LEVELS, "jobs.stages.shared")
NODES = (*SHARED, "jobs.stages.nodes")
TABLES = (*_LEVELS, "jobs.stages.tables", "jobs.stages.support.written_geometry")

CELLS = (
    *_ANY,
    *_SHARDS,
    "jobs.stages.cells",
    "jobs.stages.support.written_geometry",
    "jobs.cells",
    "jobs.visibility",
    "jobs.objects.weld",
    "storage.base.kernels",
    "storage.cells.octree",
    "storage.geometry_reader",
    "storage.meshes",
    "storage.model",
)
#: Meshes are copied from packs to packs.
_PACKS = (*_ANY, *_MODEL, *_SHARDS, "jobs.stages.support.written_geometry", "storage.geometry_reader", "storage.meshes")
_WRITTEN = ("storage.geometry_writer", "storage.model.tree")
ORDER = (*_PACKS, *_WRITTEN, "jobs.stages.packing.order", "jobs.ordering")
PACKS = (*_PACKS, *_WRITTEN, "jobs.stages.packing.packs")
INDEX = (*_PACKS, *_WRITTEN, "jobs.stages.packing.index")

LAYOUT = (*_ANY, "jobs.stages.layout", "storage.cells.octree")

#: The modules of the codec that a shard is written in join these: see `with_imports`. Others have no say.
SHARDS = (
    *_ANY,
    *_SHARDS,
    "jobs.stages.shards",
    "jobs.stages.support.written_geometry",
    "storage.base.kernels",
    "storage.cells.decisions",
    "storage.cells.deltas",
    "storage.cells.group",
    "storage.cells.octree",
    "storage.geometry_reader",
    "storage.known_cells",
    "storage.meshes",
    "storage.model",
    "storage.vlod_writer",
)
CODECS = ("storage.cells.codecs",)


def with_imports(module: str, room: str) -> tuple[str, ...]:
    """A module, and all modules of a room that it imports, or that those import, sorted."""
    found: set[str] = set()
    todo = [module]
    while todo:
        name = todo.pop()
        spec = importlib.util.find_spec(name)
        if name in found or spec is None or spec.origin is None:
            continue
        found.add(name)
        tree = ast.walk(ast.parse(Path(spec.origin).read_text()))
        imported = [node.module or "" for node in tree if isinstance(node, ast.ImportFrom)]
        todo += [module for module in imported if module.startswith(f"{room}.")]
    return tuple(sorted(found))
