"""The geometry of a build under way: what the tables, and at last the index, leave for all that comes after them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from jobs.running.workplace import Workplace
from storage.base.typed_json import from_json

if TYPE_CHECKING:
    from storage.geometry_reader import Geometry
    from storage.shards.sections import GeometrySection

#: File of a task on tables: the manifest's section on geometry.
SECTION = "geometry.json"


def geometry_section_of(place: Workplace, stage: str, key: str) -> GeometrySection:
    """The manifest's section on geometry, from a task of a stage that writes tables."""
    from storage.shards.sections import GeometrySection

    path = place.result(stage, key) / SECTION
    return from_json(GeometrySection, json.loads(path.read_text()), str(path))


def open_drafted(place: Workplace, stage: str, key: str) -> Geometry:
    """The geometry itself, from a task of the stage of tables."""
    from storage.geometry_reader import open_geometry

    return open_geometry(place.drafts, geometry_section_of(place, stage, key))
