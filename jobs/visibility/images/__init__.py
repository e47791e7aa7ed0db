"""Images on the six faces of a cube around a cell, and what their pixels hide.

Read in this order:

    cube_faces   the faces: projecting boxes, triangles and inflated edges, with the proof
    raster       triangles drawn into an image
    silhouettes  up to which depth pixels hide in spite of a set's silhouettes
    layers       what pixels hide, by all sets
"""
