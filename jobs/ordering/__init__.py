"""An order of the drawables in which what changes together stands together: a short tour through sparse columns.

Read in this order:

    columns       for each drawable where it changes: its column
    distances     in how many places two columns differ
    identical     columns that are the same, of which one stands for all
    signatures    MinHash: short signatures that are alike where columns are
    nearest       for each column the nearest of those with a signature like its own
    sampled       the vLOD paper's own way: the nearest of one sample
    fragments     the shortest edges, put together to one path
    improvement   2-opt and Or-opt on a block of a path
    tour          all of it: columns to an order
    insertion     new columns in an order that others have already
    packing       where packs and shards begin along an order of meshes

What takes long is done block by block: the nearest columns of some, the improvement of a stretch of the path. A block's
result follows from the block alone, so the order is the same whoever works on them, and in which sequence.
"""
