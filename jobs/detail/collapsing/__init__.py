"""A mesh with fewer triangles, and what its vertices carry.

Read in this order:

    near_pairs    vertices that may be joined though no edge does
    collapse      edges, and such pairs, in the order of their error
    clean         what is left, without triangles that are nothing or there twice
    borders       what the levels of a piece owe its neighbours
    face_normals  normals of triangles, and angles between them
    attributes    normals, colours and vertices of what is left
"""
