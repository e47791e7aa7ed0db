"""The kinds of tasks. Their work lies in `model` (import, pieces, hierarchy), `detail` (levels of nodes, tables) and
`cells` (view cells, their order, their shards): functions that run in worker processes and import heavy modules inside.

Each is a `jobs.running.tasks.Work`: it gets an assignment, writes its result into a fresh directory and the store's
shards, and returns a small record.
"""

from __future__ import annotations

from jobs.running.tasks import Stage

#: The reading and writing of stores decides what any stage gives.
_ALL = ("jobs.stages", "jobs.running.arrays", "storage")
_DETAIL = (*_ALL, "jobs.detail.assemble", "jobs.importing", "jobs.objects", "jobs.detail")
_CELLS = (*_ALL, "jobs.cells.subtree", "jobs.cells.budget", "jobs.visibility", "jobs.objects.weld")

IMPORT = Stage("import", "jobs.stages.model:import_files", (*_ALL, "jobs.importing"), ("numpy", "trimesh"))
PIECES = Stage("pieces", "jobs.stages.model:find_pieces", _DETAIL, ("numpy", "numba"))
HIERARCHY = Stage("hierarchy", "jobs.stages.model:make_hierarchy", _DETAIL, ("numpy", "numba"))
SHARED = Stage("shared", "jobs.stages.detail:make_shared", _DETAIL, ("numpy", "numba", "zstandard"))
NODES = Stage("nodes", "jobs.stages.detail:make_nodes", _DETAIL, ("numpy", "numba", "zstandard"))
TABLES = Stage("tables", "jobs.stages.detail:join_tables", _DETAIL, ("zstandard",))
CELLS = Stage("cells", "jobs.stages.cells:compute_cells", _CELLS, ("numpy", "numba"))
LAYOUT = Stage("layout", "jobs.stages.cells:lay_out_cells", _ALL)
SHARDS = Stage("shards", "jobs.stages.cells:write_cells", _ALL, ("zstandard",))

STAGES = (IMPORT, PIECES, HIERARCHY, SHARED, NODES, TABLES, CELLS, LAYOUT, SHARDS)
