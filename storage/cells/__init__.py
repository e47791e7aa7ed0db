"""View cells: where they lie, and how what is seen from each is kept as changes from its neighbours.

Read in this order:
    octree             keys of cells, their boxes and neighbours, and which cell holds a point
    deltas             what changes from one cell to another
    spanning_forest    which of the changes rebuild each cell of a shard
    codecs/            sets and changes as bytes
"""
