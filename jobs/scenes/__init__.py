"""Demo scenes: generated models of any size for those without one at hand, and for scaling tests.

`write_scene` writes one, `viewpoints` tells where a person can stand in it. Read in this order: solids (closed shapes
as arrays), glb (streaming writer), stage (palette, stock, budget), furnishings, then the scenes themselves: offices,
plant (with piping and equipment), city.
"""

from jobs.scenes.scene import KINDS, SceneRecord, viewpoints, write_scene

__all__ = ["KINDS", "SceneRecord", "viewpoints", "write_scene"]
