"""What can be wrong with a model, and how often it is."""

from __future__ import annotations

from enum import StrEnum
from typing import Any


class Defect(StrEnum):
    """What can be wrong with a model and is repaired, removed or left out; the value is what a report calls it."""

    INDEX = "faces with an index out of range"
    NOT_FINITE = "faces with a position that is not finite"
    INVISIBLE = "invisible faces"
    NO_AREA = "faces without area"
    DUPLICATE = "duplicate faces"
    REVERSED = "duplicate faces of opposite winding"
    OTHER_SIDE = "faces left out that show another colour to the other side"
    EMPTY = "empty meshes"
    SINGULAR = "parts flattened by their transform"
    MISPLACED = "parts with a transform that is not finite"
    NO_TEXTURE = "missing textures"
    NO_LIBRARY = "missing material libraries"
    NO_MATERIAL = "unknown materials"
    COLOUR = "colours that are not finite"
    NORMAL = "normals without direction"
    NOT_TRIANGLES = "points, lines and other primitives without triangles"
    POLYGON = "faces with fewer than three corners"
    CROSSING = "outlines that cross themselves"
    FREE_FORM = "free-form curves and surfaces"
    UNKNOWN = "statements and elements that are not known"
    TRAILING = "bytes after the last facet"
    TRANSFORM = "parts left out for a transform that cannot be read"
    FAR = "parts far from all else"
    FAR_FACES = "faces far from all else"
    HIDDEN = "parts that the file hides"
    BROKEN = "broken elements"
    UNSUPPORTED = "unsupported features"


class Tally:
    """Counts of defects by part name."""

    def __init__(self) -> None:
        self._counts: dict[Defect, dict[str, int]] = {}

    def add(self, defect: Defect, part: str, count: int = 1) -> None:
        """Count a defect. A count of zero leaves no trace."""
        if count:
            parts = self._counts.setdefault(defect, {})
            parts[part] = parts.get(part, 0) + count

    def update(self, other: Tally, prefix: str) -> None:
        """Add another tally's counts, its part names prefixed."""
        for defect, parts in other._counts.items():
            for part, count in parts.items():
                self.add(defect, prefix + part, count)

    def report(self) -> dict[str, dict[str, Any]]:
        """{defect: {"total": n, "parts": {name: n}}}, in the order of `Defect`, part names sorted."""
        return {
            str(defect): {
                "total": sum(self._counts[defect].values()),
                "parts": dict(sorted(self._counts[defect].items())),
            }
            for defect in Defect
            if defect in self._counts
        }
