"""Objects: what the model consists of.

Read in this order: weld (vertices identified by position), components (welded connected components), split (components
that are too large, cut in space), find (all three over a batch of meshes).
"""
