"""A model so small that a whole build of it takes a second: rooms with a door each, and boxes in them."""

from __future__ import annotations

from pathlib import Path

BOX = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def write_rooms(path: Path, rooms: int = 3, size: float = 4.0) -> Path:
    """Writes rooms x rooms rooms as an OBJ: about 100 triangles a room."""
    lines: list[str] = []
    vertices = 0

    def box(name, lo, hi):
        nonlocal vertices
        lines.append(f"o {name}")
        corners = [[(lo, hi)[number >> axis & 1][axis] for axis in range(3)] for number in range(8)]
        lines.extend("v {:.6f} {:.6f} {:.6f}".format(*corner) for corner in corners)
        lines.extend("f " + " ".join(str(vertices + 1 + corner) for corner in face) for face in BOX)
        vertices += 8

    edge = rooms * size
    box("floor", (0, 0, -0.1), (edge, edge, 0))
    for x in range(rooms):
        for y in range(rooms):
            left, near = x * size, y * size
            # Two walls a room; each leaves a door of one unit.
            box(f"wall {x} {y} a", (left, near, 0), (left + 0.1, near + size - 1, 2.5))
            box(f"wall {x} {y} b", (left, near, 0), (left + size - 1, near + 0.1, 2.5))
            for number, at in enumerate((0.4, 1.0, 1.6, 2.2, 2.8)):
                corner = (left + at, near + 2, 0)
                box(f"thing {x} {y} {number}", corner, (left + at + 0.3, near + 2.5, 0.3 + 0.2 * number))
    path.write_text("\n".join(lines) + "\n")
    return path
