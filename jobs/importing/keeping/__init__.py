"""What is kept of a model on disk.

Read in this order:

    saved  the imported model: a directory of arrays
    spool  meshes that wait, while a model is imported, until all are known
"""
