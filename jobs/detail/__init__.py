"""Detail: every object's chain of levels, each with a certified error.

Read in this order: pieces (the way from meshes to pieces with levels), simplify (one level coarser), closest and
hausdorff (the certified error), attributes (normals, colours, vertices), normal_cone.
"""
