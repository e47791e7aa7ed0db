"""Meshes: packed into few bytes, placed in model space, and parted into facets.

Read in this order:
    pack            packs of meshes: the frames that hold them
    arrangement     the order in which a mesh compresses best, made of
    mesh_order      triangles along strips, vertices by first use
    connectivity    triangles as a byte each, and what they foretell of positions
    wedges          vertices that share a position
    normals         of triangles; unit vectors as two small integers; what a shape foretells of them
    byte_planes     arrays as byte planes
    placement       how matrices move positions and normals
    mesh            meshes as they are given out: local, or in model space
    facets          the triangles of closed meshes parted by direction, and which are seen from behind
    turned_away     the same for the drawables of a cell
"""
