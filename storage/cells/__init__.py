"""View cells: where they lie, what changes between them, and how what is seen from each becomes bytes.

Read in this order:
    octree             keys of cells, their boxes and neighbours, and which cell holds a point
    deltas             what changes from one cell to another
    group              cells that are coded together, and what is known of them before
    decisions          how much it takes to tell what is seen from a cell
    codecs/            what is seen from a group of cells as bytes
"""
