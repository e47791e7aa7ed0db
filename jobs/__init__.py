"""The job: from a model's files to a store, on one machine or on a cluster.

Read in this order:

    pipeline      all of it in order: the list of stages
    stages/       the stages, one a file: their tasks and the work of each
    parameters    what a build is asked for: all groups of
    options/      parameters and the options of the command line that set them
    importing/    model files to parts
    objects/      parts to pieces, pieces to objects, and the tree above them
    detail/       levels of every node of the tree, each with a certified error
    visibility/   what can be seen from a cell
    cells/        which cells there are: subtrees of the octree
    ordering/     drawables in an order in which what changes together stands together
    running/      tasks, their results, and who does them
    report/       what a build did, for people
    checking/     an oracle for finished stores
    upkeep/       finished stores kept small and sound: what nobody needs goes, what is damaged is mended
    scenes/       models to try things with
    commands      the command line

Nothing in here is needed to read or to play a store: `storage` never imports `jobs`, and `player` never does.
"""
