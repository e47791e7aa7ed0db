"""Certified distances, and what is lost besides.

Read in this order:

    displacement  positions snapped to the grid, and how far that moves them
    closest       the closest triangle to a point, by a tree of boxes
    cover         how far a triangle lies from a surface that extends above all of it
    parting       the same by parts, where that is not enough
    hausdorff     the bound of the distance between two surfaces
    coverage      thin things: kept as wide as they were, or how wide what was lost is
"""
