"""Detail: every node's levels, each with a certified error.

Read in this order: pieces (meshes to pieces, ready to become leaves), leaf (pieces to a leaf with its levels), inner
(what children offer to the node above them), node (what a node consists of), offers (what goes from task to task),
levels (a leaf's chain), collapse (edges, and near_pairs of vertices, in the order of their error) and clean (what is
left in order), closest, hausdorff and cover (the certified error), attributes (normals, colours, vertices),
face_normals, options, and the small displacement (snapping) and borders (what a leaf owes its neighbours).
"""
