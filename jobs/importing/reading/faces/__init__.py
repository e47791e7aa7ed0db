"""From the faces of a file to triangles and vertices.

Read in this order:

    corners   corners of faces become triangles and vertices
    turning   how polygons are to be cut: nearly all are fans
    polygons  polygons become triangles that cover what their outlines enclose
"""
