"""Components above a size, cut in space: median splits along the longest axis of the triangles' centres.

Triangles are never cut, so the pieces' borders run along edges and stay welded.
"""

from __future__ import annotations

import numpy as np


def median_split(centres: np.ndarray, limit: int) -> list[np.ndarray]:
    """Index sets, each sorted and at most `limit` (at least 1) long, that part the centres (m, 3) int64.

    Ties are broken by index: the same input gives the same parts on every machine.
    """
    done: list[np.ndarray] = []
    todo = [np.arange(len(centres))]
    while todo:
        part = todo.pop()
        if len(part) <= limit:
            done.append(part)
            continue
        inside = centres[part]
        axis = int(np.argmax(inside.max(axis=0) - inside.min(axis=0)))
        order = np.argsort(inside[:, axis], kind="stable")
        half = len(part) // 2
        todo.append(np.sort(part[order[half:]]))
        todo.append(np.sort(part[order[:half]]))
    return done
