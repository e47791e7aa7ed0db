"""Demo scenes: generated models of any size for those without one at hand, and for scaling tests.

`write_scene` writes one, `viewpoints` tells where a person can stand in it.

Read in this order:

    kinds        the list of all scenes: a new one is its own file and one line here
    demo_scene   writing a scene of a given kind, size and seed
    things/      what scenes are made of
    offices      towers of offices
    plant        an industrial plant
    city         blocks with buildings one can walk into
    services     pipes, rods, cables and ducts of a service floor
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from jobs.scenes.kinds import KINDS

if TYPE_CHECKING:
    from jobs.scenes.demo_scene import SceneRecord, viewpoints, write_scene

__all__ = ["KINDS", "SceneRecord", "viewpoints", "write_scene"]


def __getattr__(name: str) -> Any:
    """Imports what makes scenes on first use: the command line, which needs their names, starts without numpy."""
    if name in __all__:
        from jobs.scenes import demo_scene

        return getattr(demo_scene, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
