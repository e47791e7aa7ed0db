"""From the faces of a file to triangles and vertices.

Read in this order:

    corners   corners of faces become triangles and vertices
    turning   which polygons a fan does not cover rightly
    polygons  polygons become triangles that cover what their outlines enclose
"""
