"""The ways to find what is hidden from a cell."""

from __future__ import annotations

#: The first is the one to use. The second is the vLOD paper's, to compare with: safe too, but slower and less tight.
METHODS = ("flooded-occluders", "shrunk-occluders")
