"""Detail: every object's chain of levels, each with a certified error.

Read in this order: pieces (the way from meshes to pieces with levels), levels (one piece's chain), simplify with
collapse_input (one level coarser), closest and hausdorff (the certified error), attributes (normals, colours,
vertices), normal_cone, and the small displacement (snapping) and borders (what pieces owe their neighbours).
"""
