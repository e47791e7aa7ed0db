"""Opaque triangles and those that can be seen through share no vertex: each vertex's alpha says of which kind it is.

A triangle can be seen through where one of its corners or more has an alpha below OPAQUE. Then all three get less, and
a vertex that it shares with an opaque triangle is doubled. All that comes after an import relies on it: nothing is ever
both, and one corner tells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: The alpha of each vertex of what is opaque.
OPAQUE = 255


class TwoKinds(NamedTuple):
    """A mesh's colours and triangles once both kinds are apart."""

    doubled: np.ndarray  # (k,) int64, increasing: vertices that were added behind all others, by those they are like
    colours: np.ndarray  # (n + k, 4) uint8
    triangles: np.ndarray  # (m, 3): over these


def two_kinds(colours: np.ndarray, triangles: np.ndarray) -> TwoKinds:
    """Set triangles (m, 3) that can be seen through apart from opaque ones; colours (n, 4) uint8 of the vertices.

    What is opaque stays as it is. Vertices that no triangle uses count for nothing.
    """
    clear = (colours[:, 3] < OPAQUE)[triangles].any(axis=1)
    of_clear, of_opaque = (np.zeros(len(colours), bool) for _ in range(2))
    of_clear[triangles[clear]] = True
    of_opaque[triangles[~clear]] = True
    doubled = np.flatnonzero(of_clear & of_opaque)
    number = np.arange(len(colours))
    number[doubled] = len(colours) + np.arange(len(doubled))
    parted = triangles.copy()
    parted[clear] = number[triangles[clear]]
    colours = np.concatenate([colours, colours[doubled]])
    thinned = np.append(of_clear & ~of_opaque, np.ones(len(doubled), bool))
    colours[thinned, 3] = np.minimum(colours[thinned, 3], OPAQUE - 1)
    return TwoKinds(doubled, colours, parted)
