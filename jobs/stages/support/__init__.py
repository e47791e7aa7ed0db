"""What stages stand on.

Read in this order:

    build_state       what a build was asked for, and the results so far: what tasks are made from
    code              which code decides what each stage gives: a part of its tasks' keys
    written_nodes     levels of nodes, to a geometry shard and to rows
    written_geometry  the geometry of a store that has no cells yet
"""
