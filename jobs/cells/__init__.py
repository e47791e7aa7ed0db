"""View cells: which there are, and what can be seen from each.

Read in this order:

    parameters   what decides the cells and what they hold
    task_keys    which cells a task works out
    cuts         the drawables that stand for the whole model in a cell, visible or not
    gather       the triangles of drawables, as the engine takes them
    needs        what a task will need, before any cut is chosen
    budget       the most triangles that a cell may report: coarser cuts
    subtree      the cells of one task
"""
