"""From-region visibility: what can be seen from anywhere in a view cell.

Read in this order: `topology` (welding, edges, clusters), `soup` (the triangles of many drawables as one set of
arrays), `ranges` (where a linear function is within a bound), `cube_faces` (the image: projecting boxes, triangles and
inflated edges), `flood` (from a core to an occluder set), `silhouettes` (up to which depth pixels hide in spite of a
set's silhouettes), `layers` (what pixels hide, by all sets), `gaps` and `seals` (narrow gaps that may count as closed),
`occluders` (occluder sets drawn into layers), `occludees` (which clusters and triangles are hidden), `item_buffer`
(what images from the cell's corners show), `ray_tree` (what rays meet), `aimed_rays` (what is proven visible, and
sampling alone), `shafts` (what is still open is hidden, or seen), `engine` (one cell, from a cut to its visible ids and
certificate). Only `engine` and `soup` are called from outside; the others are kernels: pure functions from arrays to
arrays.

Beside them, to compare with, the vLOD paper's own method: `planar_polygons` (occluders), `projection_point` (where
they are drawn from, with the proof), `shrunk_depths` (drawing and testing), `shrunk_occluders` (one cell). `methods`
names both.
"""
