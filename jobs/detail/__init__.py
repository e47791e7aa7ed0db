"""Detail: every node's levels, each with a certified error.

Read in this order, each on those before it:

    detail_options  how models are parted into pieces and simplified
    bounds/         certified distances: from positions to the grid, and between surfaces
    collapsing/     a mesh with fewer triangles, and what its vertices carry
    levels          the chain of levels of a leaf
    node            what a node consists of, and what it offers its parent
    offers          offers as they go from task to task
    pieces          meshes to pieces, ready to become leaves
    leaf            pieces to a leaf with its levels
    inner           what children offer to the node above them
    assemble        levels and their placements to the store's nodes and drawables
"""
