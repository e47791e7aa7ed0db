"""Objects: what the model consists of, and the hierarchy above it. Boxes and triangles only: no files, no detail.

Read in this order:

    object_options  all parameters
    weld            vertices identified by position
    components      connected components of welded triangles
    flat_faces      what has no area on the grid
    partition       what is large is split
    find            all of these over a batch of meshes: its pieces
    clustering      what is small is joined
    tree            the hierarchy of boxes
    hierarchy       all of it, from placed pieces to trees of objects: of what is opaque, of what can be seen through
    fragments       the trees in parts for tasks
"""
