"""The demo scenes: a new one is a file of its own, with a SCENE, and one line here."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jobs.scenes.things.draft import SceneKind

#: The name of each kind, and the module that makes it: imported when it is asked for.
KINDS = {
    "city": "jobs.scenes.city",
    "offices": "jobs.scenes.offices",
    "plant": "jobs.scenes.plant",
    "services": "jobs.scenes.services",
}


def scene_kind(name: str) -> SceneKind:
    """How scenes of a kind (one of KINDS) are made."""
    kind: SceneKind = importlib.import_module(KINDS[name]).SCENE
    return kind
