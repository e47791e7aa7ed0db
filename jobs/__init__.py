"""The job: from a model's files to a store, on one machine or on a cluster.

Read in this order:

    importing/     model files to parts
    objects/       parts to pieces, pieces to objects, and the tree above them
    detail/        levels of every node of the tree, each with a certified error
    assemble       levels and their placements to the store's nodes and drawables
    visibility/    what can be seen from a cell
    cells          subtrees of view cells
    pipeline       all of the above in order; stages/ holds the work of each task, plan their keys and sizes,
                   import_memory the size of an import
    tasks          what a task is, when it is finished; workplace holds their results, arrays writes them
    executors      tasks in this process, or elsewhere once they take long; ray_executor: tasks on a cluster (the only
                   module that knows Ray); choose_executor: which of them; compiling_signs: that workers compile
    verify         an oracle for finished stores
    commands       the command line

Nothing in here is needed to read or to play a store: `storage` never imports `jobs`, and `player` never does.
"""
