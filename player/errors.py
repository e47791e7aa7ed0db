"""What can go wrong for a user of the player, beside what storage.base.errors names.

VlodError
├── GraphicsError   OpenGL is missing or too old, or there is no display (also a RuntimeError)
└── PathError       a path file that is not one, or does not fit (also a ValueError)
"""

from __future__ import annotations

from storage.base.errors import VlodError


class GraphicsError(VlodError, RuntimeError):
    """OpenGL is missing or too old, or there is no display. The message says what to do."""


class PathError(VlodError, ValueError):
    """A path file that is not one. The message names the file."""
