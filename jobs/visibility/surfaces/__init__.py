"""Surfaces: the triangles that the cells of a task share, and how one cell sees them.

Read in this order:

    ranges     where a linear function is within a bound
    planes     planes of triangles, and on which side of them something lies
    topology   welding, edges, clusters, sheets and boxes
    ray_tree   trees of boxes, and what rays meet
    clusters   clusters of triangles below such a tree
    gaps       narrow gaps, that may count as closed
    soup       the triangles of many drawables as one set of arrays
    inside     which drawables reach into a cell
    seen_mesh  a soup's triangles as one cell sees them, worked out where they are looked at
"""
