"""Objects: what the model consists of, and the hierarchy above it. Boxes and triangles only: no files, no detail.

Read in this order: options (all parameters), weld (vertices identified by position), components (welded connected
components), flat_faces (what has no area on the grid), partition (large ones are split), find (all of these over a
batch of meshes), clustering (small ones are joined), tree (the box hierarchy), hierarchy (all of it, from placed pieces
to a tree of objects), fragments (the tree in parts for tasks).
"""
