"""From-region visibility: what can be seen from anywhere in a view cell.

Read in this order: `topology` (welding, edges, clusters), `soup` (the triangles of many drawables as one set of
arrays), `planes` (on which side of a triangle something lies), `ranges` (where a linear function is within a bound),
`mesh` (a soup's triangles as one cell sees them, worked out where they are looked at), `ray_tree` (trees of boxes, and
what rays meet), `clusters` (the clusters below such a tree), `cube_faces` (the image: projecting boxes, triangles and
inflated edges), `flood` (from a core to an occluder set), `silhouettes` (up to which depth pixels hide in spite of a
set's silhouettes), `layers` (what pixels hide, by all sets), `gaps` and `seals` (narrow gaps that may count as closed),
`occludees` (which boxes, clusters and triangles are hidden), `front_to_back` (clusters in the order in which they may
occlude), `occluders` (occluder sets drawn into layers), `item_buffer` (what images from the cell's corners show),
`aimed_rays` (what is proven visible, and sampling alone), `shafts` (what may lie between a part of the cell and a part
of a drawable), `closing_sets` (what closes a shaft, with the proof), `undecided` (shafts that are split until what
images leave open is hidden, or seen), `engine` (one cell, from a cut to its visible ids and certificate). Only `engine`
and `soup` are called from outside; the others are kernels: pure functions from arrays to arrays.

Beside them, to compare with, the vLOD paper's own method: `planar_polygons` (occluders), `projection_point` (where
they are drawn from, with the proof), `shrunk_depths` (drawing and testing), `shrunk_occluders` (one cell). `methods`
names both.
"""
