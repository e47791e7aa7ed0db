"""Where meshes lie for good: once it is known what is seen from where, they are copied into packs along a tour.

Read in this order, in which `jobs.pipeline` lists them:

    order   the sequence in which meshes lie
    packs   meshes in that sequence, in geometry shards
    index   where each mesh lies: the tables of the store
"""
