"""The vLOD paper's own method, to compare with: safe as well, but slower and less tight.

Read in this order:

    planar_polygons   occluders: triangles of one plane joined into convex polygons
    projection_point  where they are drawn from, with the proof
    shrunk_depths     drawing and testing
    shrunk_occluders  one cell
"""
