"""Demo scenes: generated models of any size for those without one at hand, and for scaling tests.

`write_scene` writes one, `viewpoints` tells where a person can stand in it. Read in this order: scene (the two
functions), solids (closed shapes as arrays), glb (streaming writer), stage (palette, stock, budget of triangles), the
stock itself (furnishings, equipment, street), rooms (what stands in them), and the scenes: offices, plant, city.
"""

from jobs.scenes.scene import KINDS, SceneRecord, viewpoints, write_scene

__all__ = ["KINDS", "SceneRecord", "viewpoints", "write_scene"]
