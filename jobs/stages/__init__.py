"""The stages of a build, one a file: what decides a task's result (Payload), where its inputs lie (Places), its tasks
with the memory that they may need, and its work, which runs in worker processes and imports heavy modules inside.

Read in this order, in which `jobs.pipeline` lists them:

    support/       what stages stand on: what the build has so far, keys, levels and geometry as written
    import_model   model files to parts
    pieces         parts to pieces, no larger than objects may be
    hierarchy      pieces to objects, and the trees above them
    shared         levels of what is placed several times
    nodes          levels of all other nodes, from the leaves up
    tables         nodes and drawables of the whole model
    cells          what can be seen from each view cell
    layout         the order of all cells, and which share a face
    shards         what can be seen from the cells, in cell shards
    packing/       the sequence in which meshes lie, meshes in it, and the tables of the store

A work is a `jobs.running.tasks.Work`: it gets an assignment, writes its result into a fresh directory and the store's
shards, and returns a small record. Stages name each other as modules, for their tasks; what reads another's result is
imported by its name, and counts as the reader's own code. What a stage's keys hash, its `code`, stands in
`support.code` where stages share it; that of a new stage may stand in its own file.
"""
