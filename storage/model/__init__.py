"""What a store holds of a model.

Read in this order:
    tables    its parts, meshes, nodes, drawables, cells: numpy structured dtypes, field by field
    tree      walking the hierarchy of nodes
    descent   from the roots down to the nodes that are fine enough, compiled
    cut       which nodes stand for the model as seen from a cell, and at which level
"""
